"""Test whether distances grow with the error of events (Table 3.2 of the thesis), on any pair of recording and video.

    python recipes/validate_metrics.py --real recording.aedat --video shown.avi --seconds 4

Emulated events are distorted in three ways, each in steps: coordinates are rounded to a coarser grid (SD), frames are
merged (TD), or noise is added at a fraction of the pixels of each frame (AN). With each step the Chamfer distance and
EMD should grow, and the repeatability should fall. Without --real, a camera is simulated: events are emulated from the
video with lower thresholds that differ between pixels, noise and a refractory period. That only demonstrates the
method.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import nvsdata
from nvsdata import Events, metrics
from nvsdata.common.files import put
from nvsdata.common.text import aligned
from nvsdata.data.frame_edges import frame_edges
from nvsdata.emulation import PRESETS
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.training import run

Results = dict[str, Any]
EPSILON = 2.5  # pixels, as in Table 3.2
# settings of the simulated camera, which has more events than the emulator, like a real one
FLAWS = {"threshold": 0.12, "mismatch": 0.15, "noise_rate": 2.0, "refractory": 1000, "seed": 1}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--video", type=Path, required=True, help="video from which events are emulated")
    parser.add_argument("--real", type=Path, help="recording of a camera in front of the video (default: simulated)")
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        default="table-3.3-row-5",
        help="settings of PIX2NVS; `nvsdata convert-videos --settings-help` describes them (default table-3.3-row-5)",
    )
    parser.add_argument(
        "--size", default="240x180", help="sensor size of the simulated camera in pixels (default 240x180)"
    )
    parser.add_argument("--seconds", type=float, default=2.0, help="compare the first seconds only (default 2)")
    parser.add_argument("--offset", type=int, default=0, help="µs to add to the recording's times (default 0)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the noise (default 0)")
    parser.add_argument("--out", type=Path, help="JSON file for the distances")
    args = parser.parse_args()

    settings = PRESETS[args.preset]
    if args.real is None:
        width, height = map(int, args.size.split("x"))
        real = replace(settings, **FLAWS).emulate(args.video, size=(width, height))
    else:
        real = nvsdata.open(args.real)
    pair = TuningPair(real, args.video, seconds=args.seconds, offset=args.offset)
    emulated = pair.emulate(settings)

    rows: list[tuple[str, ...]] = [("", "Chamfer", f"{EPSILON}-Rep.", "EMD")]
    results: list[Results] = []
    for name, events in distort(emulated, pair.fps, np.random.default_rng(args.seed)):
        found = metrics.compare(events, pair.real, pair.fps, offset=args.offset, epsilon=EPSILON)
        values = (found.chamfer.value, found.repeatability.value, found.emd.value)
        rows.append((name, *(f"{value:.3f}" for value in values)))
        results.append({"events": name, "chamfer": values[0], "repeatability": values[1], "emd": values[2]})
    print(aligned(rows))
    wrong = exceptions(results)
    print(
        "all distances change in each step as in Table 3.2"
        if not wrong
        else "different from Table 3.2: " + "; ".join(wrong)
    )
    if args.out:
        put(args.out, json.dumps(results, indent=1).encode())


def distort(events: Events, fps: float, rng: np.random.Generator) -> Iterator[tuple[str, Events]]:
    """Yield the events, and distorted copies of them, each with its name in the table."""
    yield "original", events
    for factor in (2, 3, 4):
        width, height = (side // factor for side in events.sensor_size)
        yield f"SD {width}x{height}", coarser(events, factor)
    for factor in (2, 3):
        yield f"TD fps/{factor}", slower(events, fps, factor)
    for fraction in (0.01, 0.03, 0.05, 0.07):
        yield f"AN {fraction:.0%}", noisier(events, fps, fraction, rng)


def coarser(events: Events, factor: int) -> Events:
    """Round coordinates to a grid of `factor` pixels."""
    x, y = ((column // factor * factor + factor // 2) for column in (events.x, events.y))
    width, height = events.sensor_size
    return Events(
        events.t, np.minimum(x, width - 1), np.minimum(y, height - 1), events.p, events.sensor_size, start=events.start
    )


def slower(events: Events, fps: float, factor: int) -> Events:
    """Merge the events of `factor` frames, and repeat them in each of these frames."""
    length = 1e6 / fps
    group = np.maximum(events.t - events.start - 1, 0) // (factor * length)
    moments = [events.start + ((group * factor + n + 0.5) * length).astype(np.int64) for n in range(factor)]
    x, y, p = (np.tile(column, factor) for column in (events.x, events.y, events.p))
    return Events(np.concatenate(moments), x, y, p, events.sensor_size, start=events.start)


def noisier(events: Events, fps: float, fraction: float, rng: np.random.Generator) -> Events:
    """Add an event of random polarity at a fraction of the pixels of each frame."""
    width, height = events.sensor_size
    edges = events.start + frame_edges(int(events.t[-1]) - events.start, fps)
    count = round(fraction * width * height)
    t = np.repeat((edges[:-1] + edges[1:]) // 2, count)
    where = np.concatenate([rng.choice(width * height, count, replace=False) for _ in edges[1:]])
    columns = (
        (events.t, t),
        (events.x, where % width),
        (events.y, where // width),
        (events.p, rng.integers(0, 2, t.size)),
    )
    return Events(*(np.concatenate(pair) for pair in columns), events.sensor_size, start=events.start)


def exceptions(results: list[Results]) -> list[str]:
    """Return the steps of each kind in which a distance changes in the other direction than in Table 3.2."""
    kinds: dict[str, list[Results]] = {}
    for row in results[1:]:
        kinds.setdefault(str(row["events"])[:2], [results[0]]).append(row)
    found = []
    for before, after in (pair for rows in kinds.values() for pair in pairwise(rows)):
        for name, sign in (("chamfer", 1), ("repeatability", -1), ("emd", 1)):
            if sign * (after[name] - before[name]) < 0:
                found.append(
                    f"{name} from {before['events']} to {after['events']}: {before[name]:.4f} to {after[name]:.4f}"
                )
    return found


if __name__ == "__main__":
    run(main, "run the command again")
