"""Benchmarks of converting events to graphs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from nvsdata import transforms as T
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import SENSOR, WINDOW, digits, random_events, sensor_recording
from nvsdata.data.events import Events
from nvsdata.transforms.events.sampling import BETA

DIFFERENT = "edges that differ from an exhaustive search"
RADIUS, DEGREE = 3.0, 32


def cases(options: Options) -> list[Case]:
    """Return the cases: windows, compared with other libraries; larger windows; events on a part of the sensor."""
    return [*_windows(options), *_growing(options), *_occupied(options)]


def _windows(options: Options) -> Iterator[Case]:
    for name, source in (("N-MNIST", _digit), ("a DAVIS240", _scene)):
        case = partial(Case, "graph", f"a window of {name} to a graph", error_kind=DIFFERENT)
        yield case(partial(_ready, options, source, T.RadiusGraph()), default=True)
        yield case(partial(_ready, options, source, _by_pyg), library="torch_geometric")
        yield case(partial(_ready, options, source, _by_tree), library="scipy")
        knn = partial(Case, "graph", f"a window of {name} to a nearest-neighbor graph")
        yield knn(partial(_ready, options, source, T.KNNGraph(), checked=False))
        sample = partial(Case, "graph", f"a window of {name} sampled")
        for k in (1, 2, 4, 8, 16):
            make = partial(_ready, options, source, T.NonUniformSample(k), checked=False)
            yield sample(make, settings={"k": k}, axis="k")


def _growing(options: Options) -> Iterator[Case]:
    """Yield cases with more and more events.

    Either the sensor grows with them, or its size is constant, so that nodes get more edges.
    """
    top = 5 if options.quick else 6
    works: dict[str, Callable[[Events], Any]] = {
        "radius graphs": T.RadiusGraph(),
        "radius graphs with D_max 8": T.RadiusGraph(max_degree=8),
        "nearest-neighbor graphs": T.KNNGraph(),
        "samples": T.NonUniformSample(8),
    }
    for (benchmark, transform), source, power in product(
        works.items(), (_larger, _denser), np.arange(3, top + 0.1, 0.5)
    ):
        count = round(10 ** float(power))
        make = partial(_ready, options, partial(source, count), transform, checked=False)
        name = f"{benchmark} of {'growing' if source is _larger else 'ever denser'} windows"
        yield Case("graph", name, make, size={"events": count}, axis="events", alone=True)


def _occupied(options: Options) -> Iterator[Case]:
    """Yield cases with a constant number of events on parts of the sensor."""
    for fraction in (0.01, 0.03, 0.1, 0.3, 1.0):
        make = partial(_ready, options, partial(_within, fraction), T.RadiusGraph(max_degree=8), checked=False)
        settings = {"fraction of the sensor": fraction}
        yield Case(
            "graph", "20,000 events on a part of the sensor", make, settings=settings, axis="fraction of the sensor"
        )


def _digit(options: Options) -> Events:
    events = digits(options, 1)[0]
    return events.window(events.start, events.start + WINDOW)


def _scene(options: Options) -> Events:
    events = sensor_recording(options)
    middle = (events.start + events.end) // 2
    return events.window(middle, middle + WINDOW)


def _larger(count: int, options: Options) -> Events:
    """Return `count` events on a sensor of ten times as many pixels."""
    side = max(round((10 * count) ** 0.5), 1)
    return random_events(count, (side, side), duration=WINDOW)


def _denser(count: int, options: Options) -> Events:
    return random_events(count, (1280, 720), duration=WINDOW)


def _within(fraction: float, options: Options) -> Events:
    width, height = (max(int(side * fraction**0.5), 1) for side in SENSOR)
    events = random_events(20_000, (width, height), duration=WINDOW)
    return Events(events.t, events.x, events.y, events.p, SENSOR)


def _ready(
    options: Options,
    source: Callable[[Options], Events],
    transform: Callable[[Events], Any],
    *,
    checked: bool = True,
) -> PreparedCase:
    events = source(options)
    run = transform(events) if transform in (_by_pyg, _by_tree) else partial(transform, events)
    counters = None if checked or isinstance(transform, T.NonUniformSample) else _edges
    return PreparedCase(run, partial(_differing, events) if checked else None, counters=counters)


def _edges(graph: Any) -> dict[str, int]:
    return {"edges": graph.edge_index.shape[1]}


def _differing(events: Events, found: Any) -> float:
    """Count the edges that only one of the two graphs has."""
    edges = found.edge_index.numpy() if hasattr(found, "edge_index") else np.asarray(found)
    if edges.shape[1] and edges[0].max() >= len(events):
        return float("inf")
    expected = _edges_of_all_pairs(events)
    ours = set(map(int, edges[0].astype(np.int64) * len(events) + edges[1]))
    return float(len(ours ^ expected))


def _edges_of_all_pairs(events: Events) -> set[int]:
    """Find the edges by comparing all pairs of events; return source * len(events) + target of each."""
    t, x, y = (column.astype(np.float64) for column in (events.t - events.start, events.x, events.y))
    found: set[int] = set()
    for target in range(len(events)):
        squared = (x - x[target]) ** 2 + (y - y[target]) ** 2 + BETA * (t - t[target]) ** 2
        near = np.flatnonzero(squared <= RADIUS**2)
        near = near[near != target]
        order = np.lexsort((near, np.abs(t[near] - t[target]), squared[near]))
        found.update((near[order[:DEGREE]] * len(events) + target).tolist())
    return found


def _by_pyg(events: Events) -> Callable[[], Any]:
    from nvsdata.benchmarks.peers.pyg import radius_graphs

    return radius_graphs(events, RADIUS, DEGREE, BETA)


def _by_tree(events: Events) -> Callable[[], Any]:
    """Return a function that finds neighbors with SciPy's k-d tree, as a user without a graph library would."""
    from scipy.spatial import cKDTree

    def run() -> Any:
        points = np.stack([events.x, events.y, (events.t - events.start) * BETA**0.5], 1)
        distance, source = cKDTree(points).query(points, DEGREE + 1, distance_upper_bound=RADIUS * (1 + 1e-9))
        target = np.broadcast_to(np.arange(len(points))[:, None], source.shape)
        kept = np.isfinite(distance) & (source != target)
        return np.stack([source[kept], target[kept]])

    return run
