"""Benchmarks of distances between event streams."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from nvsdata import metrics
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import SENSOR, random_events, sensor_recording
from nvsdata.data.events import Events
from nvsdata.kernels.metrics.distances import least_work

RELATIVE = "relative difference from the exact distance"
FRAMES = 4  # the distance is the mean over these
SPIKES = 60_000


def cases(options: Options) -> list[Case]:
    """Return the cases: nearest spikes and EMD, compared with other libraries; approximations; larger inputs."""
    return [*_nearest(options), *_emd(options), *_approximations(options), *_growing(options)]


def _nearest(options: Options) -> Iterator[Case]:
    size = {"spikes": SPIKES // 10 if options.quick else SPIKES}
    case = partial(Case, "metrics", "the nearest spike to each spike", size=size, error_kind="largest difference")
    yield case(partial(_near, size["spikes"], _ours_nearest), default=True)
    yield case(partial(_near, size["spikes"], _tree), library="scipy")


def _emd(options: Options) -> Iterator[Case]:
    for count in (300, 1_000):
        benchmark = f"EMD of {count} and {count + count // 10} spikes"
        case = partial(Case, "metrics", benchmark, error_kind="relative difference from SciPy's assignment")
        yield case(partial(_transport, count, False), default=True)
        yield case(partial(_transport, count, True), library="POT", package="pot")


def _approximations(options: Options) -> Iterator[Case]:
    """Yield cases of approximate distances between a recording and a changed copy, measured by time and error."""
    for blocks in (1, 4, 16, 64):
        yield _approximation(
            options, "EMD by blocks", {"blocks": blocks}, partial(metrics.emd, blocks=blocks), blocks == 16
        )
    for cell in (1, 2, 3, 4, 8):
        moved = partial(metrics.emd, blocks=1, cell=cell)
        yield _approximation(options, "EMD by cells, in one block", {"cell": cell}, moved, cell == 1)
    for step in (1, 2, 4, 8, 16):
        run = partial(_sampled_chamfer, step)
        yield _approximation(options, "Chamfer distance by samples", {"one spike in": step}, run, step == 1)


def _approximation(
    options: Options, benchmark: str, settings: dict[str, Any], run: Callable[..., Any], default: bool
) -> Case:
    make = partial(_pair, options, run, benchmark.startswith("EMD"))
    return Case(
        "metrics", benchmark, make, settings=settings, axis=next(iter(settings)), default=default, error_kind=RELATIVE
    )


def _growing(options: Options) -> Iterator[Case]:
    top = 5.0 if options.quick else 6.0
    for power in np.arange(3, top + 0.1, 0.5).tolist():
        count = round(10**power)
        make = partial(_near, count, _ours_nearest, checked=False)
        yield Case("metrics", "growing numbers of spikes, nearest", make, size={"spikes": count}, axis="spikes")
    for power, cell in product(np.arange(2, 4.1 - options.quick / 2, 0.5).tolist(), (1, 4)):
        count = round(10**power)
        benchmark = "growing numbers of spikes, EMD" + (f" by cells of {cell}" if cell > 1 else "")
        make = partial(_growing_emd, count, cell)
        yield Case("metrics", benchmark, make, size={"spikes": count}, axis="spikes", alone=True)


def _side(count: int, seed: int, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and signed counts of spikes at random pixels, in raster order."""
    random = np.random.default_rng(seed)
    where = np.sort(random.choice(size[0] * size[1], count, replace=False))
    return where % size[0], where // size[0], random.choice([-3, -2, -1, 1, 2, 3], count)


def _near(count: int, run: Callable[..., Callable[[], Any]], *, checked: bool = True) -> PreparedCase:
    size = (1280, 960)
    a, b = _side(count, 0, size), _side(count, 1, size)
    expected = _tree(a, b, size)() if checked else None
    error = None if expected is None else lambda found: np.abs(found - expected).max()
    return PreparedCase(run(a, b, size), error)


def _ours_nearest(a: Any, b: Any, size: tuple[int, int]) -> Callable[[], Any]:
    from nvsdata.kernels.metrics.distances import nearest_spikes

    given: Any = *a, *b, size[::-1], 3.0, np.inf
    return lambda: np.sqrt(nearest_spikes(*given))


def _tree(a: Any, b: Any, size: tuple[int, int]) -> Callable[[], Any]:
    """Return a function that queries a k-d tree; building the tree isn't measured."""
    from scipy.spatial import cKDTree

    scale = np.array([1, 1, 3**0.5])
    tree, points = cKDTree(np.stack(b, 1) * scale), np.stack(a, 1) * scale
    return lambda: tree.query(points)[0]


def _transport(count: int, pot: bool) -> PreparedCase:
    (ax, ay, am), (bx, by, bm) = (_side(n, n, (160, 68)) for n in (count, count + count // 10))
    am, bm = np.abs(am), np.abs(bm)
    points: Any = (ax.astype(float), ay.astype(float), am, bx.astype(float), by.astype(float), bm)
    exact = _assigned(*points)
    if not pot:
        return PreparedCase(lambda: least_work(*points), lambda found: abs(found - exact) / exact)
    import ot

    a, b, costs = am.astype(float), bm.astype(float), np.hypot(ax[:, None] - bx, ay[:, None] - by)
    surplus = a.sum() - b.sum()
    # POT moves all mass, so an additional point takes the surplus of one side at no cost
    if surplus > 0:
        b, costs = np.append(b, surplus), np.pad(costs, ((0, 0), (0, 1)))
    elif surplus < 0:
        a, costs = np.append(a, -surplus), np.pad(costs, ((0, 1), (0, 0)))
    # the cost matrix is computed before the timed call
    return PreparedCase(lambda: ot.emd2(a, b, costs, numItermax=10**7), lambda found: abs(found - exact) / exact)


def _assigned(ax: np.ndarray, ay: np.ndarray, am: np.ndarray, bx: np.ndarray, by: np.ndarray, bm: np.ndarray) -> float:
    """Return the EMD by SciPy, which assigns each unit of mass of one side to a unit of the other."""
    ax, ay, bx, by = np.repeat(ax, am), np.repeat(ay, am), np.repeat(bx, bm), np.repeat(by, bm)
    costs = np.hypot(ax[:, None] - bx, ay[:, None] - by)
    return float(costs[linear_sum_assignment(costs)].sum())


def _moved_copy(events: Events) -> Events:
    """Shift events one pixel to the left, and replace one in ten with a random event."""
    random = np.random.default_rng(0)
    kept = random.random(len(events)) < 0.9
    noise = random_events(int((~kept).sum()), events.sensor_size, duration=events.duration, seed=1)
    t = np.concatenate([events.t[kept], noise.t + events.start])
    x = np.concatenate([np.maximum(events.x[kept] - 1, 0), noise.x])
    y, p = (np.concatenate([getattr(events, name)[kept], getattr(noise, name)]) for name in "yp")
    return Events(t, x, y, p, events.sensor_size)


def _pair(options: Options, run: Callable[..., Any], moved: bool) -> PreparedCase:
    events = sensor_recording(options)
    duration = 20_000 if moved and options.quick else 33_333
    first = events.window(events.start, events.start + FRAMES * duration)
    other = _moved_copy(first)
    compare = partial(run, first, other, fps=1e6 / duration)
    exact = partial(metrics.emd, blocks=1) if moved else metrics.chamfer
    expected = float(exact(first, other, fps=1e6 / duration))
    return PreparedCase(compare, lambda found: abs(float(found) - expected) / expected)


def _sampled_chamfer(step: int, emulated: Events, real: Events, *, fps: float) -> float:
    """Compute the Chamfer distance of every n-th emulated event to all real ones."""
    return float(metrics.chamfer(emulated[::step], real, fps=fps))


def _growing_emd(count: int, cell: int) -> PreparedCase:
    a, b = (random_events(count, SENSOR, seed=seed) for seed in (0, 1))
    return PreparedCase(partial(metrics.emd, a, b, blocks=1, cell=cell))
