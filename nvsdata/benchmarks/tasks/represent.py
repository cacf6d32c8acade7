"""Benchmarks of converting events to tensors, and of filters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from nvsdata import transforms as T
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import SENSOR, random_events, sensor_recording
from nvsdata.benchmarks.peers.readers import differing
from nvsdata.benchmarks.peers.representations import PEERS, Peer
from nvsdata.data.camera_model import CameraModel
from nvsdata.data.events import Events

Run = Callable[[Events], Any]
COUNT, FEW, DURATION = 200_000, 20_000, 1_000_000
CAMERA = CameraModel(SENSOR, (200.0, 200.0, 120.0, 90.0), (-0.3, 0.1, 0.0, 0.0))
GROWING: dict[str, Run] = {
    "frames": T.ToFrames(16),
    "a voxel grid": T.VoxelGrid(16),
    "TORE": T.TORE(),
    "HATS": T.HATS(),
}


def cases(options: Options) -> list[Case]:
    """Return the cases: transforms, compared with other libraries; interpolation of voxel grids; larger inputs."""
    return [*_all(options), *_interpolations(options), *_growing(options)]


def _all(options: Options) -> Iterator[Case]:
    for benchmark, (transform, count) in TRANSFORMS.items():
        reference = EXACT.get(benchmark)
        kind = "" if reference is None else "number of events" if benchmark == "refractory period" else "largest value"
        kind = kind and f"difference from the definition in NumPy: {kind}"
        case = partial(Case, "represent", benchmark, size={"events": count}, error_kind=kind)
        yield case(partial(_ready, count, transform, reference), default=True)
        for library, prepare in PEERS.get(benchmark, {}).items():
            exact = PEER_EXACT.get((benchmark, library), reference)
            yield case(partial(_peer, count, prepare, exact), library=library)


def _interpolations(options: Options) -> Iterator[Case]:
    """Yield cases of voxel grids by interpolation in time."""
    for interpolation in ("linear", "nearest"):
        make = partial(_interpolated, options, interpolation)
        yield Case(
            *("represent", "voxel grids of a recording", make),
            settings={"interpolation": interpolation},
            axis="interpolation",
            default=interpolation == "linear",
            error_kind="mean difference from linear interpolation in float64, relative to the mean",
        )


def _growing(options: Options) -> Iterator[Case]:
    top = 6 if options.quick else 8
    for (name, transform), power in product(GROWING.items(), range(3, top + 1)):
        if 10**power <= (10**5 if options.quick else 10**7) or not isinstance(transform, T.HATS):
            yield Case(
                *("represent", f"growing numbers of events to {name}", partial(_ready, 10**power, transform, None)),
                size={"events": 10**power},
                axis="events",
                alone=True,
            )


TRANSFORMS: dict[str, tuple[Run, int]] = {
    "frames, 16 bins": (T.ToFrames(16), COUNT),
    "voxel grid, 16 bins": (T.VoxelGrid(16), COUNT),
    "time surface, 16 times": (T.TimeSurface(every=DURATION // 16), COUNT),
    "time surface, at the end": (T.TimeSurface(), COUNT),
    "surface of each event, 5x5": (T.EventSurfaces(), COUNT),
    "HATS": (T.HATS(), FEW),
    "TORE": (T.TORE(), FEW),
    "TAF": (T.TAF(), COUNT),
    "ERGO-12": (T.ERGO12(), COUNT),
    "group tokens": (T.GroupTokens(), 50_000),
    "filter cascade": (T.FilterCascade(), COUNT),
    "four channels": (T.FourChannels(), COUNT),
    "leaky frame": (T.LeakyFrame(), COUNT),
    "refractory period": (T.RefractoryPeriod(10_000), COUNT),
    "background activity": (T.BackgroundActivity(10_000), COUNT),
    "corners": (T.Corners(), COUNT),
    "plane flow": (T.PlaneFlow(), COUNT),
    "downsample": (T.Downsample(2), COUNT),
    "undistort": (T.Undistort(CAMERA), COUNT),
    "time jitter": (T.TimeJitter(100), COUNT),
    "spatial jitter": (T.SpatialJitter(1), COUNT),
    "uniform noise": (T.UniformNoise(1_000), COUNT),
    "center crop": (T.CenterCrop(100), COUNT),
}


def _ready(count: int, transform: Run, reference: Run | None) -> PreparedCase:
    events = random_events(count)
    return PreparedCase(partial(transform, events), _error_against(events, reference))


def _peer(count: int, prepare: Peer, reference: Run | None) -> PreparedCase:
    events = random_events(count)
    return PreparedCase(prepare(events), _error_against(events, reference))


def _error_against(events: Events, reference: Run | None) -> Callable[[Any], float] | None:
    if reference is None:
        return None
    expected = reference(events)

    def error(found: Any) -> float:
        if isinstance(expected, Events):
            return differing(expected, found)
        found = np.asarray(found.numpy() if hasattr(found, "numpy") else found, np.float64).reshape(expected.shape)
        return float(np.abs(found - expected).max())

    return error


def _frames(events: Events) -> np.ndarray:
    """Count events with NumPy, ON first: [16, 2, H, W]."""
    width, height = events.sensor_size
    counts = np.zeros((16, 2, height, width))
    span = events.end - events.start
    bins = np.minimum((events.t - events.start) * 16 // span, 15)
    np.add.at(counts, (bins, 1 - events.p, events.y, events.x), 1)
    return counts


def _voxels(events: Events, interpolation: str = "linear") -> np.ndarray:
    """Compute the voxel grid of Zhu et al. 2019 in float64: [16, H, W]."""
    width, height = events.sensor_size
    grid = np.zeros((16, height, width))
    place = 15 * (events.t - events.t[0]) / (events.t[-1] - events.t[0])
    lower = np.floor(place).astype(int)
    sign = 2.0 * events.p - 1
    for bin_, fraction in ((lower, 1 - (place - lower)), (lower + 1, place - lower)):
        inside = bin_ < 16
        np.add.at(grid, (bin_[inside], events.y[inside], events.x[inside]), (sign * fraction)[inside])
    return grid


def _refractory(events: Events) -> Events:
    """Apply a refractory period of 10 ms event by event in Python."""
    last: dict[tuple[int, int], int] = {}
    kept = np.zeros(len(events), bool)
    for i, (t, x, y) in enumerate(zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), strict=True)):
        if t - last.get((x, y), -(2**62)) >= 10_000:
            kept[i], last[x, y] = True, t
    return events[kept]


EXACT: dict[str, Run] = {"frames, 16 bins": _frames, "voxel grid, 16 bins": _voxels, "refractory period": _refractory}
# these have OFF first
PEER_EXACT: dict[tuple[str, str], Run] = {
    ("frames, 16 bins", library): lambda events: _frames(events)[:, ::-1] for library in ("tonic", "evlib")
}


def _interpolated(options: Options, interpolation: str) -> PreparedCase:
    events = sensor_recording(options)
    expected = _voxels(events)
    return PreparedCase(
        partial(T.VoxelGrid(16, interpolation), events),  # type: ignore[arg-type]
        lambda found: float(np.abs(found.numpy().reshape(expected.shape) - expected).mean() / np.abs(expected).mean()),
    )
