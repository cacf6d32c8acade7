"""Files of lines, tables and pages."""

import json
import re
from dataclasses import replace

import pytest

from nvsdata.benchmarks import table
from nvsdata.benchmarks.measurement import Measurement, read_measurements, write_measurements
from nvsdata.benchmarks.page import benchmark_page

M = Measurement
LINES = [
    M("graph", "windows", "nvsdata", "0.1", 0.002, 0.003, 0.004, 9, {"k": 1}, {"events": 7}, "k", True, 0.0, "e"),
    M("graph", "windows", "nvsdata", "0.1", 0.001, 0.003, 0.004, 9, {"k": 2}, {"events": 7}, "k", False, 0.5, "e"),
    M("graph", "windows", "peer", "2", 0.008, 0.009, 0.01, 9, {"k": 1}, {"events": 7}, "k", False, 0.25, "e", 10**6),
]  # fmt: skip


def grown(seconds):
    one = replace(LINES[0], benchmark="growing", settings={}, axis="events", error=None)
    return [replace(one, size={"events": 10**n}, seconds=value) for n, value in enumerate(seconds)]


def test_lines_survive_their_file(tmp_path):
    write_measurements(LINES, tmp_path / "a.json")
    assert read_measurements(tmp_path / "a.json") == LINES


def test_lines_of_later_versions_are_read_without_what_is_new(tmp_path):
    write_measurements(LINES, tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    content["measurements"][0]["joules"] = 1.5
    (tmp_path / "a.json").write_text(json.dumps(content))
    assert read_measurements(tmp_path / "a.json") == LINES


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format": "other"}', '{"format": "nvsdata-bench", "measurements": [{}]}']
)
def test_other_files_are_refused_by_name(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError, match=r"a\.json: not a file of `nvsdata bench --json`: "):
        read_measurements(tmp_path / "a.json")


def test_a_table_has_times_errors_and_ratios_to_the_same_settings_of_ours():
    assert table.benchmark_table(LINES).splitlines() == [
        "graph: windows               error  median   p95    p99  runs    peak  ratio to ours",
        "  nvsdata 0.1 k 1, 7 events      0    2 ms  3 ms   4 ms     9",
        "  nvsdata 0.1 k 2, 7 events    0.5    1 ms  3 ms   4 ms     9",
        "  peer 2 k 1, 7 events        0.25    8 ms  9 ms  10 ms     9  1.0 MB           4.00",
        "  error: e",
    ]


def test_a_table_of_sizes_says_how_cost_grows():
    assert "  grows as events^1.00" in table.benchmark_table(grown([1e-3, 1e-2, 1e-1, 1])).splitlines()
    assert table.benchmark_table(grown([1e-3, 1e-2, 1, 100])).endswith(", and bends upward")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(2, "2 s"), (1, "1 s"), (0.9994, "999 ms"), (1e-3, "1 ms"), (1e-6, "1 µs"), (9.87654e-7, "988 ns")],
)
def test_durations(seconds, text):
    assert table.duration(seconds) == text


def test_a_comparison_marks_what_changed_and_leaves_out_what_is_new():
    now = [replace(LINES[0], seconds=0.004), replace(LINES[1], error=0.75), replace(LINES[2], benchmark="new")]
    text = table.comparison(now, [replace(line, commit="abc", date="2026-01-01", machine="M") for line in LINES])
    first, _, slower, same = text.splitlines()
    assert first == "before: commit abc, 2026-01-01, M"
    assert slower.split()[-3:] == ["ms", "2.00", "slower"]
    assert same.split()[-3:] == ["1.00", "0.5", "0.75"]
    assert "faster" in table.comparison(LINES[:1], now[:1])
    assert table.comparison(now[2:], LINES) == "the earlier file has none of these measurements"


def test_a_page_has_a_curve_per_work_and_its_table_and_needs_no_other_file():
    text = benchmark_page([*LINES, *grown([1e-3, 1e-2, 1, 100])])
    assert text.count("<svg") == 2
    assert text.count("<pre>") == 2
    assert "the default is on the Pareto front" in text
    assert "and bends upward" in text
    assert not re.search(r'(src|href)="(?!#)', text)


def test_a_page_says_if_a_default_is_surpassed():
    worse = [
        replace(LINES[0], seconds=0.01, error=0.6),
        LINES[1],
        replace(LINES[2], library="nvsdata", settings={"k": 3}),
    ]
    assert "the default is not on the Pareto front" in benchmark_page(worse)


def test_a_chart_of_several_libraries_names_them():
    one, other = grown([1e-3, 1e-2]), [replace(line, library="peer") for line in grown([2e-3, 2e-2])]
    assert ">peer<" in benchmark_page([*one, *other]).split("<pre>")[0]
    assert ">nvsdata<" not in benchmark_page(one).split("<pre>")[0]


def test_names_are_escaped():
    assert "<b>" not in benchmark_page([replace(LINES[0], benchmark="<b>", machine="<b>")])
