"""Run time of event representations, as ratios to tonic's in the same run.

    python recipes/bench/representations.py --out representations.json

200,000 random events at 240x180 in one second (20,000 where the peer takes long), one core. Each pair of times is the
median over rounds in which ours and the peer take turns. Without tonic there are only our times.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nvsdata import Events
from nvsdata import transforms as T

SIZE, COUNT, DURATION = (240, 180), 200_000, 1_000_000
Run = Callable[[Any], Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    parser.add_argument("--rounds", type=int, default=7, help="default 7")
    args = parser.parse_args()
    torch.set_num_threads(1)
    events, peers = random_events(), tonic_transforms()
    rows = [
        line(name, ours, peers.get(name), events[:count], args.rounds) for name, (ours, count) in TRANSFORMS.items()
    ]
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    if args.out:
        machine = {"processor": platform.processor() or platform.machine(), "torch": torch.__version__}
        args.out.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1))


TRANSFORMS: dict[str, tuple[Run, int]] = {
    "frames, 16 bins": (T.ToFrames(16), COUNT),
    "voxel grid, 16 bins": (T.VoxelGrid(16), COUNT),
    "time surface, 16 times": (T.TimeSurface(every=DURATION // 16), COUNT),
    "time surface, at the end": (T.TimeSurface(), COUNT),
    "surface of each event, 5x5": (T.EventSurfaces(), COUNT),
    "HATS": (T.HATS(), 20_000),
    "four channels": (T.FourChannels(), COUNT),
    "leaky frame": (T.LeakyFrame(), COUNT),
}


def tonic_transforms() -> dict[str, Run]:
    """tonic's transforms of the same work, by name; none if it isn't installed."""
    try:
        from tonic import transforms
    except ImportError:
        return {}
    sensor = {"sensor_size": (*SIZE, 2)}
    return {
        "frames, 16 bins": transforms.ToFrame(**sensor, n_time_bins=16),
        "voxel grid, 16 bins": transforms.ToVoxelGrid(**sensor, n_time_bins=16),
        "time surface, 16 times": transforms.ToTimesurface(**sensor, dt=DURATION // 16, tau=50_000),
        "HATS": transforms.ToAveragedTimesurface(
            **sensor, cell_size=10, surface_size=7, time_window=100_000, tau=1e9, decay="exp"
        ),
    }


def random_events() -> Events:
    random = np.random.default_rng(0)
    t = np.sort(random.integers(0, DURATION, COUNT))
    return Events(t, *(random.integers(0, high, COUNT) for high in (*SIZE, 2)), SIZE)


def line(name: str, ours: Run, theirs: Run | None, events: Events, rounds: int) -> dict[str, Any]:
    """A row: median times in ms and their ratio."""
    types = np.dtype([("x", int), ("y", int), ("t", int), ("p", int)])
    works = [lambda: ours(events)]
    if theirs is not None:
        structured = events.to_structured().astype(types)
        works.append(lambda: theirs(structured))
    times: list[list[float]] = [[] for _ in works]
    for round in range(rounds + 1):
        for work, spent in zip(works, times, strict=True):
            begin = time.perf_counter()
            work()
            # the first one compiles
            if round:
                spent.append(1e3 * (time.perf_counter() - begin))
    medians = [statistics.median(spent) for spent in times]
    row: dict[str, Any] = {"what": name, "events": len(events), "ours_ms": round_to(medians[0])}
    return row | {"tonic_ms": round_to(medians[1]), "ratio": round_to(medians[1] / medians[0])} if theirs else row


def round_to(value: float) -> float:
    """Three digits."""
    return float(f"{value:.3g}")


if __name__ == "__main__":
    main()
