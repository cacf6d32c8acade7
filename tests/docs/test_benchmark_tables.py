"""Tables that the site makes from measurements."""

import figures

from nvsdata.benchmarks.measurement import OURS, read_measurements


def test_each_ratio_is_that_of_the_measured_times():
    head, *rows = figures.comparison()
    measured = read_measurements(figures.BENCHMARKS)
    for _, benchmark, _, ratios, _ in rows:
        seconds = {one.library: one.seconds for one in measured if one.benchmark == benchmark}
        for cell in ratios.split("; "):
            library = cell.split(": ")[0].split(" (")[0]
            assert f"{seconds[library] / seconds[OURS]:.2f}" == cell.split(": ")[1].split(",")[0]
    assert len(head) == 5
    assert len(rows) > 30


def test_growth_ends_at_the_largest_size():
    rows = figures.growth()[1:]
    assert rows
    for _, benchmark, ends, exponent, _ in rows:
        sizes = [one.place for one in read_measurements(figures.BENCHMARKS) if one.benchmark == benchmark]
        assert ends.startswith(f"{min(sizes):,.0f} and {max(sizes):,.0f} ")
        assert -0.5 < float(exponent) < 2.5
