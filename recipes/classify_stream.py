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
from nvsdata import transforms as T
from nvsdata.commands.options import at_least_1, positive
from nvsdata.training import run
from nvsdata.transforms.looking_back import LookingBack


def main() -> None:
    args = arguments()
    trained = models.load(args.model)
    live = models.stream(trained.model, **followed(trained.transform, args.window))
    events = nvsdata.read(args.recording)
    for line in decisions(live, events, trained.classes, every=args.every, speed=args.speed, behind=args.behind):
        print(json.dumps(line), flush=True)


def followed(transform: Any, window: int | None) -> dict[str, Any]:
    """What `models.stream` needs besides the network; ValueError for a transform with steps that can't stream."""
    found: dict[str, Any] = {"window": window}
    for step in transform.transforms if isinstance(transform, T.Compose) else [transform]:
        if isinstance(step, T.RandomWindow):
            found["window"] = window or step.duration
        elif isinstance(step, T.RadiusGraph):
            found["graph"] = step
        elif isinstance(step, LookingBack):
            found["sampler"] = step
        else:
            raise ValueError(f"{step} can't stream: the network was trained on windows that it changes as a whole")
    return found


def decisions(
    live: Any, events: Events, classes: tuple[str, ...], *, every: int, speed: float | None, behind: int
) -> Iterator[dict[str, Any]]:
    """A line per decision."""
    began, work, skipped = time.perf_counter(), 0.0, 0
    for start in range(events.start, events.end + 1, every):
        piece = events.window(start, start + every)
        due = began + (start + every - events.start) / 1e6 / speed if speed else 0.0
        if speed:
            time.sleep(max(due - time.perf_counter(), 0))
        started = time.perf_counter()
        live.feed(piece)
        if speed and time.perf_counter() - due > behind / 1e6:
            skipped += 1
            work += time.perf_counter() - started
            continue
        scores = live.scores().softmax(0)
        count = len(live)
        now = time.perf_counter()
        best = int(scores.argmax())
        line: dict[str, Any] = {"time": start + every, "class": classes[best] if classes else str(best)}
        line |= {"probability": round(float(scores[best]), 4), "events": count}
        line["work"] = round(1e6 * (work + now - started))
        if speed:
            line |= {"behind": max(round(1e6 * (now - due)), 0), "skipped": skipped}
        work, skipped = 0.0, 0
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
