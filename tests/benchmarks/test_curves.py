"""Fronts and exponents of hand-made lines."""

import math
from dataclasses import replace

import pytest

from nvsdata.benchmarks import curves
from nvsdata.benchmarks.measurement import Measurement


def line(seconds, *, events=0, error=None, benchmark="w", task="decode", library="nvsdata", **settings):
    axis = next(iter(settings), "events" if events else "")
    return Measurement(
        task=task, benchmark=benchmark, library=library, version="1", seconds=seconds, p95=seconds, p99=seconds, runs=3,
        settings=settings, size={"events": events} if events else {}, axis=axis, error=error,
    )  # fmt: skip


def test_the_front_has_what_nothing_surpasses():
    points = [(0.5, 1.0), (0.0, 9.0), (0.2, 9.5), (0.2, 4.0), (0.5, 2.0), (0.9, 0.5), (0.95, 0.5)]
    assert curves.pareto_indices(points) == [1, 3, 0, 5]


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law(power):
    lines = [line(1e-3 * size**power, events=size) for size in (1, 10, 100, 1000)]
    assert curves.exponent(lines) == pytest.approx(power)


def test_the_exponent_leaves_out_calls_that_cost_more_than_their_work():
    lines = [line(1e-5, events=1), line(1.1e-5, events=10), line(1e-3, events=1000), line(1e-2, events=10_000)]
    assert curves.exponent(lines) == pytest.approx(1)
    assert math.isnan(curves.exponent(lines[:1]))
    assert curves.exponent(lines[:2]) == pytest.approx(math.log10(1.1))


def test_a_line_bends_upward_only_if_it_grows_ever_faster_than_its_size():
    straight = [line(1e-3 * n, events=n) for n in (1, 10, 100, 1000)]
    square = [line(1e-3 * n**2, events=n) for n in (1, 10, 100, 1000)]
    bent = [line(1e-3 * (n + n**2 / 30), events=n) for n in (1, 10, 100, 1000)]
    flat = [line(1e-3 * (1 + n / 100), events=n) for n in (1, 10, 100, 1000)]
    assert [curves.bends_upward(lines) for lines in (straight, square, bent, flat)] == [False, False, True, False]
    assert not curves.bends_upward(bent[:2])
    # each tenth more events have a hundred times the edges, and they take the time
    counts = [1, 30, 3_000, 300_000]
    counted = [replace(line, counters={"edges": count}) for line, count in zip(bent, counts, strict=False)]
    assert not curves.bends_upward(counted)
    few = [replace(line, counters={"edges": 5, "none": 0}) for line in bent]
    assert curves.bends_upward(few)


def test_works_stay_together_in_their_order():
    lines = [
        line(1, benchmark="b"),
        line(2, benchmark="a"),
        line(3, benchmark="b"),
        line(4, benchmark="a", task="graph"),
    ]
    assert [[one.seconds for one in group] for group in curves.by_benchmark(lines)] == [[1, 3], [2], [4]]


def test_what_is_drawn_as_a_tradeoff():
    assert curves.is_tradeoff([line(1, error=0.0, k=1), line(2, error=0.1, k=2)])
    assert not curves.is_tradeoff([line(1, error=0.1, k=1), line(2, error=0.1, k=2)])
    assert not curves.is_tradeoff([line(1, error=0.0, events=10), line(2, error=0.1, events=20)])
    assert not curves.is_tradeoff([line(1, error=0.0), line(2, error=0.1, library="peer", k=1)])
