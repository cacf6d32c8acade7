"""Transforms of other libraries that compute what transforms of nvsdata do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from nvsdata.benchmarks.inputs import SECOND, SENSOR
from nvsdata.benchmarks.peers.readers import TONIC
from nvsdata.data.events import Events

Peer = Callable[[Events], Callable[[], Any]]
BINS = 16


def _tonic(name: str, events: Events, **settings: Any) -> Callable[[], Any]:
    from tonic import transforms

    return partial(getattr(transforms, name)(**settings), events.to_structured().astype(TONIC))


def _eventcv(name: str, events: Events, **settings: Any) -> Callable[[], Any]:
    import eventcv

    columns = np.stack([events.x, events.y, events.t, events.p], 1)
    stream = eventcv.from_numpy(columns, sensor_size=events.sensor_size, time_unit="us")
    return partial(getattr(stream, name), **settings)


def _eventcv_undistorted(events: Events) -> Callable[[], Any]:
    import eventcv

    return _eventcv("undistort", events, camera=eventcv.Camera(200.0, 200.0, 120.0, 90.0, k1=-0.3, k2=0.1))


def _evlib(kind: str, events: Events, made: dict[str, Any], dense: dict[str, Any]) -> Callable[[], Any]:
    """Return a function that makes a table of what isn't zero, and the dense array of it."""
    import evlib
    import polars

    t = polars.Series(events.t).cast(polars.Duration("us"))
    table = polars.DataFrame({"t": t, "x": events.x, "y": events.y, "polarity": events.p.astype(np.int8)})
    sides = {"height": events.sensor_size[1], "width": events.sensor_size[0]}
    create, densify = getattr(evlib, f"create_{kind}"), getattr(evlib, f"densify_{kind}")
    return lambda: densify(create(table, **sides, **made), **sides, **dense)


def _evlib_bins(kind: str, events: Events, **dense: Any) -> Callable[[], Any]:
    return _evlib(kind, events, {"n_time_bins": BINS}, {"n_time_bins": BINS, **dense})


def _evlib_surface(events: Events) -> Callable[[], Any]:
    times = {"dt": SECOND // BINS, "tau": 50_000}
    return _evlib(
        "time_surface", events, times, {"n_slices": BINS, "n_polarities": 2, "start_t": events.start, **times}
    )


SEEN: dict[str, Any] = {"sensor_size": (*SENSOR, 2)}
PEERS: dict[str, dict[str, Peer]] = {
    "frames, 16 bins": {
        "tonic": partial(_tonic, "ToFrame", **SEEN, n_time_bins=BINS),
        "evlib": partial(_evlib_bins, "event_frame", n_polarities=2),
    },
    "voxel grid, 16 bins": {
        "tonic": partial(_tonic, "ToVoxelGrid", **SEEN, n_time_bins=BINS),
        "evlib": partial(_evlib_bins, "voxel_grid"),
        "eventcv": partial(_eventcv, "voxel", bins=BINS),
    },
    "time surface, 16 times": {
        "tonic": partial(_tonic, "ToTimesurface", **SEEN, dt=SECOND // BINS, tau=50_000),
        "evlib": _evlib_surface,
    },
    "time surface, at the end": {"eventcv": partial(_eventcv, "tsurf", tau_us=50_000)},
    "HATS": {
        "tonic": partial(
            _tonic,
            "ToAveragedTimesurface",
            **SEEN,
            cell_size=10,
            surface_size=7,
            time_window=100_000,
            tau=1e9,
            decay="exp",
        )
    },
    "refractory period": {
        "tonic": partial(_tonic, "RefractoryPeriod", delta=10_000),
        "eventcv": partial(_eventcv, "refractory_filter", dt=10_000),
    },
    "background activity": {
        "tonic": partial(_tonic, "Denoise", filter_time=10_000),
        "eventcv": partial(_eventcv, "background_activity_filter", dt=10_000),
    },
    "corners": {"eventcv": partial(_eventcv, "efast")},
    "downsample": {
        "tonic": partial(_tonic, "Downsample", spatial_factor=0.5),
        "eventcv": partial(_eventcv, "resize", width=SENSOR[0] // 2, height=SENSOR[1] // 2),
    },
    "undistort": {"eventcv": _eventcv_undistorted},
    # tonic leaves the times unsorted
    "time jitter": {
        "tonic": partial(_tonic, "TimeJitter", std=100),
        "eventcv": partial(_eventcv, "time_jitter", sigma_us=100),
    },
    "spatial jitter": {
        "tonic": partial(_tonic, "SpatialJitter", **SEEN, var_x=1, var_y=1, clip_outliers=True),
        "eventcv": partial(_eventcv, "spatial_jitter", sigma=1),
    },
    "uniform noise": {"tonic": partial(_tonic, "UniformNoise", **SEEN, n=1_000)},
    "center crop": {
        "tonic": partial(_tonic, "CenterCrop", **SEEN, size=(100, 100)),
        "eventcv": partial(_eventcv, "crop", x0=70, y0=40, w=100, h=100),
    },
}
