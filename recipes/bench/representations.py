"""Run time of representations and transforms of events, as ratios to tonic's in the same run.

    python recipes/bench/representations.py --out representations.json

200,000 random events at 240x180 in one second (20,000 where the peer takes long). Time of one core, so that other work
doesn't count. Ours and the peer take turns of about 30 ms, at least one call each; each figure is the median over
turns of the mean over calls. Without tonic there are only our times.
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
TURN = 0.03  # s
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
    "TORE": (T.TORE(), 20_000),
    "TAF": (T.TAF(), COUNT),
    "ERGO-12": (T.ERGO12(), COUNT),
    "group tokens": (T.GroupTokens(), 50_000),
    "filter cascade": (T.FilterCascade(), COUNT),
    "four channels": (T.FourChannels(), COUNT),
    "leaky frame": (T.LeakyFrame(), COUNT),
    "refractory period": (T.RefractoryPeriod(10_000), COUNT),
    "background activity": (T.BackgroundActivity(10_000), COUNT),
    "downsample": (T.Downsample(2), COUNT),
    "time jitter": (T.TimeJitter(100), COUNT),
    "spatial jitter": (T.SpatialJitter(1), COUNT),
    "uniform noise": (T.UniformNoise(1_000), COUNT),
    "center crop": (T.CenterCrop(100), COUNT),
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
        "refractory period": transforms.RefractoryPeriod(10_000),
        "background activity": transforms.Denoise(filter_time=10_000),
        "downsample": transforms.Downsample(spatial_factor=0.5),
        # its times stay unsorted
        "time jitter": transforms.TimeJitter(std=100),
        "spatial jitter": transforms.SpatialJitter(**sensor, var_x=1, var_y=1, clip_outliers=True),
        "uniform noise": transforms.UniformNoise(**sensor, n=1_000),
        "center crop": transforms.CenterCrop(**sensor, size=(100, 100)),
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
    for work in works:
        # compiles
        work()
    calls = [max(1, int(TURN / seconds(work, 1))) for work in works]
    times = [[seconds(work, count) / count for work, count in zip(works, calls, strict=True)] for _ in range(rounds)]
    medians = [1e3 * statistics.median(spent) for spent in zip(*times, strict=True)]
    row: dict[str, Any] = {"what": name, "events": len(events), "ours_ms": round_to(medians[0])}
    return row | {"tonic_ms": round_to(medians[1]), "ratio": round_to(medians[1] / medians[0])} if theirs else row


def seconds(work: Callable[[], Any], calls: int) -> float:
    """Time of a core that calls take."""
    begin = time.process_time()
    for _ in range(calls):
        work()
    return time.process_time() - begin


def round_to(value: float) -> float:
    """Three digits."""
    return float(f"{value:.3g}")


if __name__ == "__main__":
    main()
