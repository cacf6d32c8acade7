"""Test whether the distances show how far events are from real ones: the experiment of Table 3.2, on any pair.

    python recipes/validate_metrics.py --real recording.aedat --video shown.avi --seconds 4

Emulated events are made worse in three ways, each in steps: coordinates on a coarser lattice (SD),
frames merged (TD), noise at a share of the pixels of each frame (AN). With each step the Chamfer distance
and EMD should grow and the repeatability fall. Without --real, a stand-in for a camera is emulated from the
video, with lower thresholds that differ per pixel, noise and a refractory period. It shows the method only.
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

Figures = dict[str, Any]
EPSILON = 2.5  # of Table 3.2
# of the stand-in: like a real camera, it gives more events than the emulator
FLAWS = {"threshold": 0.12, "mismatch": 0.15, "noise_rate": 2.0, "refractory": 1000, "seed": 1}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--video", type=Path, required=True)
    parser.add_argument("--real", type=Path, help="recording of a camera that saw the video")
    parser.add_argument("--preset", choices=PRESETS, default="table-3.3-row-5")
    parser.add_argument("--size", default="240x180", help="sensor of the stand-in (default 240x180)")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--offset", type=int, default=0, help="µs to add to the recording's times")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
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
    figures: list[Figures] = []
    for name, events in distorted(emulated, pair.fps, np.random.default_rng(args.seed)):
        found = metrics.compare(events, pair.real, pair.fps, offset=args.offset, epsilon=EPSILON)
        values = (found.chamfer.value, found.repeatability.value, found.emd.value)
        rows.append((name, *(f"{value:.3f}" for value in values)))
        figures.append({"events": name, "chamfer": values[0], "repeatability": values[1], "emd": values[2]})
    print(aligned(rows))
    wrong = exceptions(figures)
    print("every step changes all three as in Table 3.2" if not wrong else "not as in Table 3.2: " + "; ".join(wrong))
    if args.out:
        put(args.out, json.dumps(figures, indent=1).encode())


def distorted(events: Events, fps: float, rng: np.random.Generator) -> Iterator[tuple[str, Events]]:
    """Names and events of the table's rows."""
    yield "original", events
    for factor in (2, 3, 4):
        width, height = (side // factor for side in events.sensor_size)
        yield f"SD {width}x{height}", coarser(events, factor)
    for factor in (2, 3):
        yield f"TD fps/{factor}", slower(events, fps, factor)
    for share in (0.01, 0.03, 0.05, 0.07):
        yield f"AN {share:.0%}", noisier(events, fps, share, rng)


def coarser(events: Events, factor: int) -> Events:
    """Coordinates on a lattice of `factor` pixels, scaled back up."""
    x, y = ((column // factor * factor + factor // 2) for column in (events.x, events.y))
    width, height = events.sensor_size
    return Events(
        events.t, np.minimum(x, width - 1), np.minimum(y, height - 1), events.p, events.sensor_size, start=events.start
    )


def slower(events: Events, fps: float, factor: int) -> Events:
    """Events of `factor` frames merged, and repeated in each of them."""
    length = 1e6 / fps
    group = np.maximum(events.t - events.start - 1, 0) // (factor * length)
    moments = [events.start + ((group * factor + n + 0.5) * length).astype(np.int64) for n in range(factor)]
    x, y, p = (np.tile(column, factor) for column in (events.x, events.y, events.p))
    return Events(np.concatenate(moments), x, y, p, events.sensor_size, start=events.start)


def noisier(events: Events, fps: float, share: float, rng: np.random.Generator) -> Events:
    """One more event, of random polarity, at a share of the pixels of each frame."""
    width, height = events.sensor_size
    edges = events.start + frame_edges(int(events.t[-1]) - events.start, fps)
    count = round(share * width * height)
    t = np.repeat((edges[:-1] + edges[1:]) // 2, count)
    where = np.concatenate([rng.choice(width * height, count, replace=False) for _ in edges[1:]])
    columns = (
        (events.t, t),
        (events.x, where % width),
        (events.y, where // width),
        (events.p, rng.integers(0, 2, t.size)),
    )
    return Events(*(np.concatenate(pair) for pair in columns), events.sensor_size, start=events.start)


def exceptions(figures: list[Figures]) -> list[str]:
    """Steps, from the original on in each kind, in which a distance changes the other way than in Table 3.2."""
    kinds: dict[str, list[Figures]] = {}
    for row in figures[1:]:
        kinds.setdefault(str(row["events"])[:2], [figures[0]]).append(row)
    found = []
    for before, after in (pair for rows in kinds.values() for pair in pairwise(rows)):
        for name, sign in (("chamfer", 1), ("repeatability", -1), ("emd", 1)):
            if sign * (after[name] - before[name]) < 0:
                found.append(
                    f"{name} from {before['events']} to {after['events']}: {before[name]:.4f} to {after[name]:.4f}"
                )
    return found


if __name__ == "__main__":
    main()
