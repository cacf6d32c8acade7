"""What a network sees in a recording that goes on: a line of JSON per decision.

    python recipes/classify_stream.py 00112.bin --model runs/digits/model.safetensors
    python recipes/classify_stream.py 00112.bin --model runs/digits/model.safetensors --speed 1 --every 500

Events come in pieces of --every µs; the network follows them (docs/streaming.md) in the window, on the graph and with
the sampler that it was trained with. With --speed they come as fast as they were recorded, or so many times faster: a
decision that is late by more than --behind µs is skipped, events never are, and each line says how late it is.

A line has `time` (µs, the recording's), `class`, `probability`, `events` in the window, `work` (µs since the last
decision) and, with --speed, `behind` (µs) and `skipped` (decisions before it).
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
    """A line per decision."""
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
    add("recording", type=Path)
    add("--model", type=Path, required=True, help="of `nvsdata.models.save`, with its transform")
    add("--every", type=at_least_1, default=1_000, help="µs between decisions (default 1,000)")
    add("--window", type=at_least_1, help="µs that the network sees (default: as it was trained)")
    add("--speed", type=positive, help="times the recording's own (default: as fast as possible)")
    add("--behind", type=at_least_1, default=10_000, help="µs by which a decision may be late (default 10,000)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
