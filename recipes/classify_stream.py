"""Classify a stream of events: a line of JSON per decision.

    python recipes/classify_stream.py 00112.bin --model runs/digits/model.safetensors
    python recipes/classify_stream.py 00112.bin --model runs/digits/model.safetensors --speed 1 --every 500

The network gets the events in pieces of --every µs and updates its scores incrementally (docs/streaming.md), with the
window, the graph and the sampling of its training. With --speed X the events arrive X times as fast as they were
recorded. Then a decision that is late by more than --behind µs is skipped; events are never skipped.

A line has `time` (µs, in the recording's clock), `class`, `probability`, `events` (number in the window), `work`
(computing time in µs since the last decision) and, with --speed, `behind` (delay in µs) and `skipped` (number of
skipped decisions before this one).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nvsdata
from nvsdata import Events, models
from nvsdata.commands.options import at_least_1, positive
from nvsdata.training import run


def main() -> None:
    args = arguments()
    decider = models.OnlineClassifier(models.load(args.model), args.window)
    decider.prepare()
    events = nvsdata.read(args.recording)
    for line in decisions(decider, events, every=args.every, speed=args.speed, behind=args.behind):
        print(json.dumps(line), flush=True)


def decisions(
    decider: models.OnlineClassifier, events: Events, *, every: int, speed: float | None, behind: int
) -> Iterator[dict[str, Any]]:
    """Yield a line of results for each decision."""
    began, skipped = time.perf_counter(), 0
    for start in range(events.start, events.end + 1, every):
        piece = events.window(start, start + every)
        due = began + (start + every - events.start) / 1e6 / speed if speed else 0.0
        if speed:
            time.sleep(max(due - time.perf_counter(), 0))
        decider.feed(piece)
        if speed and time.perf_counter() - due > behind / 1e6:
            skipped += 1
            continue
        line = decider.decide(start + every)
        if speed:
            line |= {"behind": max(round(1e6 * (time.perf_counter() - due)), 0), "skipped": skipped}
        skipped = 0
        yield line


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("recording", type=Path, help="recording to classify")
    add("--model", type=Path, required=True, help="file of `nvsdata.models.save`, with its transform")
    add("--every", type=at_least_1, default=1_000, help="µs between decisions (default 1,000)")
    add("--window", type=at_least_1, help="length of the window in µs (default: that of the training)")
    add(
        "--speed", type=positive, help="speed relative to the recording, 1 for real time (default: as fast as possible)"
    )
    add("--behind", type=at_least_1, default=10_000, help="largest delay of a decision in µs (default 10,000)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
