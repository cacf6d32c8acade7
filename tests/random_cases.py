"""Random transforms: how to read the drawn numbers off a result, how these are distributed, what follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from graphs import scattered

from nvsdata import Events
from nvsdata import transforms as T

COUNT = 2_000
ERRORS = 4.5  # standard errors; 7 in a million fair draws are further off


def even(values, beyond=0.002):
    """Numbers scaled to [0, 1) are uniform: Kolmogorov-Smirnov at 0.1%, the mean, both ends within 2%.

    `beyond`: how far outside they may seem to be, if they are only estimated.
    """
    values = np.sort(values)
    assert -beyond < values[0] < 0.02
    assert 0.98 < values[-1] < 1 + beyond
    assert abs(values.mean() - 0.5) < ERRORS * math.sqrt(1 / 12 / COUNT)
    assert abs(values - (np.arange(COUNT) + 0.5) / COUNT).max() < 1.95 / math.sqrt(COUNT)


def one_of(n):
    """Each of 0 to n - 1 is equally likely, and nothing else occurs."""

    def check(values):
        values = np.asarray(values)
        assert set(values.tolist()) == set(range(n))
        for value in range(n):
            chance(1 / n)(values == value)

    return check


def chance(p):
    """Something happens with probability p."""

    def check(values):
        assert abs(np.mean(values) - p) < ERRORS * math.sqrt(p * (1 - p) / COUNT)

    return check


@dataclass(frozen=True)
class Case:
    transform: Any
    sample: Any
    read: Callable[[Any], tuple]  # the numbers that were drawn
    drawn: tuple[Callable[[list], None], ...]  # how each of them is distributed
    follows: Callable[..., Any]  # the result, from these numbers
    independent: bool = True


GRAPH = replace(scattered(60, y=3), sensor_size=(50, 34))
CENTER = torch.tensor([24.5, 16.5])
FAR = int((GRAPH.pos - CENTER).norm(dim=1).argmax())


def at(graph, pos):
    """The graph with other positions, and signed pseudo-coordinates by their definition."""
    source, target = graph.edge_index
    return replace(graph, pos=pos, edge_attr=((pos[source] - pos[target]) / 6 + 0.5).clamp(0, 1))


def factor(graph):
    return float((graph.pos[FAR] - CENTER).norm() / (GRAPH.pos[FAR] - CENTER).norm())


def angle(graph):
    """Degrees from the x axis towards the y axis, of the furthest node."""
    (x, y), (u, v) = (GRAPH.pos[FAR] - CENTER).tolist(), (graph.pos[FAR] - CENTER).tolist()
    return math.degrees(math.atan2(x * v - y * u, x * u + y * v))


def turned(degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y = (GRAPH.pos - CENTER).T
    return at(GRAPH, torch.stack((c * x - s * y, s * x + c * y), 1) + CENTER)


def mirrored_graph(axis):
    pos = GRAPH.pos.clone()
    pos[:, axis] = (49, 33)[axis] - pos[:, axis]
    return at(GRAPH, pos)


def flips(axis, p):
    across = mirrored_graph(axis)
    return Case(
        T.RandomFlip(axis, p),
        GRAPH,
        lambda graph: (int(graph is not GRAPH),),
        (chance(p),),
        lambda mirrored: across if mirrored else GRAPH,
    )


WIDE = Events(
    np.arange(50) + 10**15,
    *(np.random.default_rng(side).integers(side - 1_500, side + 1_500, 50) for side in (4_000, 3_000)),
    np.arange(50) % 2,
    (8_001, 6_001),
    start=10**15 - 7,
    end=10**15 + 99,
)


def mirrored_events(axis):
    columns = list(WIDE.columns)
    columns[1 + axis] = (8_000, 6_000)[axis] - columns[1 + axis]
    return Events(*columns, WIDE.sensor_size, start=WIDE.start, end=WIDE.end)


def event_flips(axis, p):
    across = mirrored_events(axis)
    return Case(
        T.RandomFlip(axis, p),
        WIDE,
        lambda ev: (int(ev != WIDE),),
        (chance(p),),
        lambda mirrored: across if mirrored else WIDE,
    )


def affine_settings(ev):
    """Factor, degrees, shift, slant and stretch, from all events by least squares; in shares of their ranges."""
    before = np.stack((WIDE.x - 4_000, WIDE.y - 3_000.0, np.ones(50)), 1)
    after = (ev.x - 4_000) + 1j * (ev.y - 3_000.0)
    (turn, upright, moved), *_ = np.linalg.lstsq(before + 0j, after, rcond=None)
    degrees = math.degrees(math.atan2(turn.imag, turn.real))
    lean = upright / turn  # where a unit of y goes, in the turned and scaled axes
    shares = (abs(turn) - 0.5) / 0.7, (degrees + 30) / 60, (moved.real + 50) / 100, (moved.imag + 50) / 100
    return *shares, (lean.real + 0.2) / 0.4, (lean.imag - 0.7) / 0.6


def affine(share, turn, right, down, slant, stretch):
    """The events at the nearest pixels; t, p and span as they were."""
    by = (0.5 + 0.7 * share) * np.exp(1j * math.radians(60 * turn - 30))
    lean = 0.4 * slant - 0.2 + 1j * (0.7 + 0.6 * stretch)
    place = by * (WIDE.x - 4_000 + lean * (WIDE.y - 3_000.0)) + 100 * (right + 1j * down) - 50 * (1 + 1j)
    columns = WIDE.t, *whole(place.real + 4_000, place.imag + 3_000), WIDE.p
    return Events(*columns, WIDE.sensor_size, start=WIDE.start, end=WIDE.end)


def whole(*columns):
    return (np.rint(column).astype(np.int16) for column in columns)


DENSE = Events(np.arange(120) + 10**15, np.arange(120) % 34, np.arange(120) % 20, np.arange(120) % 2, (34, 20))
IMAGE = torch.arange(2 * 9 * 14.0).reshape(2, 9, 14)  # a value names its place
FRAMES = torch.arange(20.0).reshape(20, 1, 1).expand(20, 2, 3)
LINE = Events(np.arange(16) * 200, np.full(16, 3), np.full(16, 5), np.arange(16) % 2, (34, 34))
MANY = Events(
    np.arange(20_000) + 10**15, np.arange(20_000) % 34, np.arange(20_000) % 20, np.arange(20_000) % 2, (34, 20)
)
FEW = Events(np.arange(41), np.arange(41), np.arange(41) % 3, np.arange(41) % 2, (41, 3))


def rows(ev):
    """The events as points, by their definition."""
    width, height = ev.sensor_size
    since = (ev.t - ev.t[0]) / (ev.t[-1] - ev.t[0])
    return torch.from_numpy(np.stack((ev.x / (width - 1), ev.y / (height - 1), since, 2.0 * ev.p - 1), 1)).float()


ENDS = Events([10**15] * 2 + [10**15 + 10**9], [1, 2, 3], [4, 5, 6], [0, 1, 1], (34, 20))
ONE = Events([10**15], [4_000], [3_000], [1], (8_001, 6_001), start=0, end=2 * 10**15)
NONE = Events.empty((6, 5), 10**15, 10**15 + 9)
GRID = Events(np.arange(680), np.arange(680) % 34, np.arange(680) // 34, np.arange(680) % 2, (34, 20))
POLARITIES = T.SelectPolarity(0), T.SelectPolarity(1), T.SelectPolarity(1)


def share_below(deviations):
    """Of a normal distribution."""
    return 0.5 * (1 + math.erf(deviations / math.sqrt(2)))


def with_one_at(t, x, y):
    return Events([t], [x], [y], [1], ONE.sensor_size, start=ONE.start, end=ONE.end)


def backwards(ev):
    columns = ev.start + ev.end - ev.t[::-1], ev.x[::-1], ev.y[::-1], 1 - ev.p[::-1]
    return Events(*columns, ev.sensor_size, start=ev.start, end=ev.end)


def missing_rectangle(ev):
    gone = np.setdiff1d(GRID.t, ev.t)
    return int((gone % 34).min()), int((gone // 34).min())


def without(x, y):
    inside = (x <= GRID.x) & (x + 17 > GRID.x) & (y <= GRID.y) & (y + 10 > GRID.y)
    return GRID[~inside]


def parted(ev):
    """Which of the polarities was kept."""
    return 0 if ev.p.max() == 0 else 1


def put_out(drawn):
    out = torch.zeros(2, 4, 5)
    out[0, 2, 3] = drawn
    return out


CASES = [
    Case(
        T.RandomTimeScale(0.5, 1.5),
        ENDS,
        lambda ev: ((ev.end - 10**15) / 10**9 - 0.5,),
        (even,),
        lambda share: Events([10**15] * 2 + [10**15 + round((0.5 + share) * 10**9)], *ENDS.columns[1:], (34, 20)),
    ),
    Case(
        # two of eight ticks have passed
        T.FilterCascade(1, decay=8.0),
        Events([0], [3], [2], [1], (5, 4), start=0, end=2_999),
        lambda out: (int(out[0, 2, 3]),),
        (chance(0.75),),
        put_out,
    ),
    Case(
        T.RandomPolarityFlip(0.3),
        DENSE,
        lambda ev: (int(ev != DENSE),),
        (chance(0.3),),
        lambda flipped: DENSE.of(DENSE.columns._replace(p=1 - DENSE.p)) if flipped else DENSE,
    ),
    Case(
        T.RandomTimeFlip(0.3),
        DENSE,
        lambda ev: (int(ev != DENSE),),
        (chance(0.3),),
        lambda flipped: backwards(DENSE) if flipped else DENSE,
    ),
    Case(
        T.TimeJitter(10_000),
        ONE,
        lambda ev: (share_below((ev.t[0] - 10**15) / 10_000), ev.t[0]),
        (even, lambda _: None),
        lambda _, t: with_one_at(t, 4_000, 3_000),
        independent=False,
    ),
    Case(
        T.SpatialJitter(500),
        ONE,
        lambda ev: (*(share_below((at[0] - middle) / 500) for at, middle in ((ev.x, 4_000), (ev.y, 3_000))), ev),
        (even, even, lambda _: None),
        lambda *drawn: with_one_at(10**15, drawn[2].x[0], drawn[2].y[0]),
        independent=False,
    ),
    Case(
        T.UniformNoise(1),
        NONE,
        lambda ev: (int(ev.t[0]) - 10**15, int(ev.x[0]), int(ev.y[0]), int(ev.p[0])),
        (one_of(10), one_of(6), one_of(5), one_of(2)),
        lambda t, x, y, p: Events([10**15 + t], [x], [y], [p], (6, 5), start=NONE.start, end=NONE.end),
    ),
    Case(
        T.DropByTime(0.25),
        DENSE,
        lambda ev: (int(np.setdiff1d(DENSE.t, ev.t)[0]) - 10**15,),
        (one_of(91),),
        lambda start: DENSE[(DENSE.t < 10**15 + start) | (DENSE.t >= 10**15 + start + 30)],
    ),
    Case(T.DropByArea(0.25), GRID, missing_rectangle, (one_of(18), one_of(11)), without),
    Case(
        T.RandomRun(100),
        DENSE,
        lambda ev: (int(ev.t[0]) - 10**15,),
        (one_of(21),),
        lambda first: DENSE[first : first + 100],
    ),
    Case(
        T.RandomApply(T.SelectPolarity(1), 0.3),
        DENSE,
        lambda ev: (int(ev != DENSE),),
        (chance(0.3),),
        lambda applied: DENSE[DENSE.p == 1] if applied else DENSE,
    ),
    Case(
        T.RandomChoice(POLARITIES),
        DENSE,
        lambda ev: (parted(ev),),
        (chance(2 / 3),),
        lambda polarity: DENSE[DENSE.p == polarity],
    ),
    Case(
        T.RandomScale(0.5, 1.5),
        GRAPH,
        lambda graph: (factor(graph) - 0.5,),
        (even,),
        lambda share: at(GRAPH, (GRAPH.pos - CENTER) * (0.5 + share) + CENTER),
    ),
    Case(
        T.RandomRotate(40),
        GRAPH,
        lambda graph: ((angle(graph) + 40) / 80,),
        (even,),
        lambda share: turned(80 * share - 40),
    ),
    Case(
        T.RandomTranslate(3),
        GRAPH,
        lambda graph: tuple(((graph.pos[FAR] - GRAPH.pos[FAR] + 3) / 6).tolist()),
        (even, even),
        lambda right, down: at(GRAPH, GRAPH.pos + 6 * torch.tensor([right, down]) - 3),
    ),
    *(flips(axis, p) for axis, p in ((0, 0.5), (1, 0.5), (0, 0.2), (1, 0.9))),
    *(event_flips(axis, p) for axis, p in ((0, 0.3), (1, 0.5))),
    Case(T.RandomAffine((0.5, 1.2), 30, 50, 0.2, 0.3), WIDE, affine_settings, (even,) * 6, affine),
    Case(
        T.RandomWindow(60),
        DENSE,
        lambda ev: (ev.start - 10**15,),
        (one_of(61),),
        lambda start: DENSE.window(start + 10**15, start + 60 + 10**15),
    ),
    Case(
        T.RandomWindow(60, within=(0.25, 0.75)),
        DENSE,
        lambda ev: (ev.start - 10**15 - 15,),
        (one_of(30),),
        lambda start: DENSE.window(start + 15 + 10**15, start + 75 + 10**15),
    ),
    Case(
        T.RandomWindows(4, 20),
        DENSE,
        lambda windows: tuple(ev.start - 10**15 - 30 * n for n, ev in enumerate(windows)),
        (one_of(11),) * 4,
        lambda *starts: [
            DENSE.window(10**15 + 30 * n + start, 10**15 + 30 * n + start + 20) for n, start in enumerate(starts)
        ],
    ),
    Case(
        T.RandomTemporalCrop(12),
        FRAMES,
        lambda frames: (int(frames[0, 0, 0]),),
        (one_of(9),),
        lambda start: FRAMES[start : start + 12],
    ),
    Case(
        T.RandomCrop(4),
        IMAGE,
        lambda image: (int(image[0, 0, 0]) // 14, int(image[0, 0, 0]) % 14),
        (one_of(6), one_of(11)),
        lambda y, x: IMAGE[:, y : y + 4, x : x + 4],
    ),
    *(
        Case(
            T.RandomFlip(0, p),
            IMAGE,
            lambda image: (int(image[0, 0, 0] != 0),),
            (chance(p),),
            lambda mirrored: IMAGE.flip(2) if mirrored else IMAGE,
        )
        for p in (0.5, 0.2)
    ),
    Case(
        T.NonUniformSample(8),
        LINE,
        lambda ev: (int(ev.t[0]) // 200, int(ev.t[1]) // 200 - 8),
        (one_of(8), one_of(8)),
        lambda first, second: LINE[np.array([first, 8 + second])],
    ),
    Case(
        T.DropEvents(0.3),
        MANY,
        lambda ev: ((1 - len(ev) / 20_000) / 0.3, ev.t),
        # of 20,000 events a share of 0.3 is known to 0.003
        (partial(even, beyond=0.05), lambda _: None),
        lambda _, t: MANY[np.isin(MANY.t, t)],
        independent=False,
    ),
    Case(
        T.Points(8),
        FEW,
        lambda points: tuple(np.isin(np.arange(41), np.rint(points[:, 2].numpy() * 40)).tolist()),
        (chance(8 / 41),) * 41,
        lambda *taken: rows(FEW)[list(taken)],
        independent=False,
    ),
]
