"""Tables that the site makes from measurements."""

import json
import re
import runpy
import sys
from statistics import mean

import figures
import pytest

from nvsdata.benchmarks.measurement import OURS, read_measurements


def test_each_ratio_is_that_of_the_measured_times():
    head, *rows = figures.comparison()
    measured = read_measurements(figures.BENCHMARKS)
    for _, benchmark, _, ratios, _ in rows:
        # of several settings, the defaults
        group = sorted((one for one in measured if one.benchmark == benchmark), key=lambda one: one.default)
        seconds = {one.library: one.seconds for one in group}
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


@pytest.mark.parametrize("study", ["ablation", "ablation-degree"])
def test_ablation_studies_compare_runs_of_one_seed(study):
    head, first, *rows = figures.ablation(study)
    assert (len(head), first[0], first[3:5]) == (7, "default", ("", ""))
    _, *lines = map(json.loads, figures.ACCURACY.with_name(f"{study}.jsonl").read_text().splitlines())
    runs = {(line["settings"], line["seed"]): line for line in lines}
    assert len(rows) + 1 == len({settings for settings, _ in runs})
    for settings, one, vote, *differences, _, _ in rows:
        for cell, difference, kind in ((one, differences[0], "one"), (vote, differences[1], "five")):
            values = [runs[settings, seed][kind] for seed in range(3)]
            assert cell.startswith(f"{mean(values):.3f} ± ")
            own = [100 * (value - runs["default", seed][kind]) for seed, value in enumerate(values)]
            assert difference.startswith(f"{mean(own):+.1f} (")


def test_tables_of_accuracy_are_made_from_reports():
    for table, rows in json.loads(figures.ACCURACY.read_bytes()).items():
        head, *cells = figures.accuracy(table)
        assert head[5:7] == ("weights", "operations")
        for row, (name, runs) in zip(cells, rows.items(), strict=True):
            assert len(row) == len(head)
            assert row[0].startswith(f"{name}<details>")
            assert f"<code>{runs[0]['command']}</code> ({runs[0]['commit'][:8]}" in row[0]
            assert row[5:7] == (f"{runs[0]['weights'] / 1e6:.2f} M", f"{runs[0]['operations'] / 1e6:,.0f} M")
            assert row[3].startswith(f"{mean(run['window'][0] for run in runs):.3f}")
            for run in runs:
                value, low, high = run["window"]
                assert low < value < high


def test_the_table_of_robustness_has_every_cell():
    head, *rows = figures.robustness()
    cells = json.loads(figures.ROBUSTNESS.read_bytes())["cells"]
    assert len(rows) * len(head[2:]) == len(cells)
    for cell in cells:
        row = next(row for row in rows if row[:2] == (cell["corruption"], f"{cell['strength']:g}"))
        value, low, high = cell["accuracy"]
        assert row[head.index(cell["network"])] == f"{value:.3f} ({low:.3f} to {high:.3f})"


def test_runs_are_added_with_their_command_and_without_their_folders(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "ACCURACY", tmp_path / "accuracy.json")
    (tmp_path / "run").mkdir()
    command = ["recipes/train_objects.py", "--root", "a b", "--out=runs/1", "--seed", "3", "--k", "8"]
    run = {"command": command, "commit": "c" * 40, "machine": "m", "epoch": 2, "epoch_chosen_by": "validation accuracy"}
    run["window_ms"] = 2.34
    report = {
        "run": run,
        "data": {"hash": "h", "root": "x", "seed": 3},
        "tested_on": "test",
        "recordings": 9,
        "windows": 1,
    }
    report["accuracy"] = {"window": [0.5, 0.3, 0.7], "vote": [0.5, 0.3, 0.7]}
    (tmp_path / "run/report.json").write_text(json.dumps(report))
    lines = [{"seconds": 30, "validation_accuracy": 0.25}, {"seconds": 60, "validation_accuracy": 0.75}]
    (tmp_path / "run/log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    figures.add_runs("T", "row", [tmp_path / "run"])
    (kept,) = json.loads(figures.ACCURACY.read_bytes())["T"]["row"]
    assert kept["command"] == "train_objects.py --k 8"
    assert kept["split_hashes"] == {"hash": "h"}
    row, *cells = figures.accuracy("T")[1]
    assert row == "row<details><summary>command</summary><code>train_objects.py --k 8</code> (cccccccc)</details>"
    assert cells == ["3", "0.750", "0.500 (0.300 to 0.700)", "", "", "", "1.5", "2.3"]
    with pytest.raises(ValueError, match="one command line with different seeds"):
        figures.add_runs("T", "row", [tmp_path / "run"] * 2)


@pytest.mark.parametrize(
    ("report", "reason"), [(None, "/report.json: No such file"), ("{}", ": isn't the folder of a run: KeyError")]
)
def test_a_folder_without_a_run_ends_with_one_line(tmp_path, monkeypatch, report, reason):
    if report is not None:
        (tmp_path / "report.json").write_text(report)
        (tmp_path / "log.jsonl").touch()
    monkeypatch.setattr(sys, "argv", ["docs/figures.py", "T", "row", str(tmp_path)])
    with pytest.raises(SystemExit, match=rf"^figures\.py: {re.escape(str(tmp_path))}{reason}.*$"):
        runpy.run_path(figures.__file__, run_name="__main__")
