"""Tables made from measurements in `docs/figures/`.

    python docs/figures.py "N-CARS" "RG-CNN, a node per pixel" runs/n-cars-0 runs/n-cars-1

adds a row to the table "N-CARS" of `accuracy.json`: the figures of runs of a recipe that differ in their seed.
"""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from statistics import mean
from typing import Any

from nvsdata import training
from nvsdata.benchmarks.curves import by_benchmark, exponent, is_scaling
from nvsdata.benchmarks.measurement import OURS, Measurement, read_measurements
from nvsdata.benchmarks.table import duration, number
from nvsdata.common.errors import FormatError
from nvsdata.common.files import put
from nvsdata.metrics import Accuracy
from nvsdata.metrics.seeds import by_settings, points_apart, spread

BENCHMARKS = Path(__file__).parent / "figures" / "benchmarks.json"
ACCURACY = BENCHMARKS.with_name("accuracy.json")
ROBUSTNESS = BENCHMARKS.with_name("robustness.json")
DEFAULT = "default"  # the settings from which runs of the ablation study differ
ROUNDING = 1e-4  # errors up to this are rounding of float32


def comparison() -> list[tuple[str, ...]]:
    """Return a row for each benchmark that other libraries ran, too, after a head."""
    rows = [("task", "benchmark", "nvsdata", "other libraries: ratio", "meaning of a difference")]
    for group in by_benchmark(read_measurements(BENCHMARKS)):
        # the defaults, if there are several settings
        ours = min((one for one in group if one.library == OURS), key=lambda one: not one.default)
        if others := [one for one in group if one.library != OURS]:
            ratios = "; ".join(_ratio(one, ours) for one in others)
            kind = ours.error_kind if any(map(_differs, others)) else ""
            rows.append((ours.task, ours.benchmark, duration(ours.seconds), ratios, kind))
    return rows


def _ratio(other: Measurement, ours: Measurement) -> str:
    version = f" ({other.version})" if other.version else ""
    differs = f", differs by {number(other.error)}" if _differs(other) else ""
    return f"{other.library}{version}: {other.seconds / ours.seconds:.2f}{differs}"


def _differs(one: Measurement) -> bool:
    return one.error is not None and one.error > ROUNDING


def growth() -> list[tuple[str, ...]]:
    """Return a row for each benchmark of growing inputs, after a head."""
    rows = [("task", "input that grows", "smallest and largest", "exponent", "time and memory at the largest")]
    for group in by_benchmark(read_measurements(BENCHMARKS)):
        if is_scaling(group):
            ours = sorted((one for one in group if one.library == OURS), key=lambda one: one.place)
            first, last = ours[0], ours[-1]
            ends = f"{first.place:,.0f} and {last.place:,.0f} {last.axis}"
            memory = "" if last.peak_memory is None else f", {number(last.peak_memory / 1e6)} MB"
            cost = f"{duration(last.seconds)}{memory}"
            rows.append((last.task, last.benchmark, ends, f"{exponent(ours):.2f}", cost))
    return rows


def accuracy(table: str) -> list[tuple[str, ...]]:
    """Return a row for each group of runs in a table of `accuracy.json`, after a head."""
    head = ("network", "seeds", "validation", "test: one window", "test: vote", "weights", "operations")
    rows = [(*head, "minutes per run", "ms per window")]
    for name, runs in json.loads(ACCURACY.read_bytes())[table].items():
        row = [
            f"{name}{_command(runs)}",
            ", ".join(str(run["seed"]) for run in runs),
            spread([run["validation"] for run in runs if run["validation"] is not None]),
            _with_intervals([run["window"] for run in runs]),
            _with_intervals([run["vote"] for run in runs]) if runs[0]["windows"] > 1 else "",
            *(_millions(runs[0].get(kind), digits) for kind, digits in (("weights", 2), ("operations", 0))),
            f"{mean(run['minutes'] for run in runs):.1f}",
            _milliseconds([run.get("window_ms") for run in runs]),
        ]
        rows.append(tuple(row))
    return rows


def _command(runs: list[dict[str, Any]]) -> str:
    """Return the command line and the commits of runs, which a click unfolds."""
    commits = ", ".join(dict.fromkeys(run["commit"][:8] for run in runs))
    return f"<details><summary>command</summary><code>{runs[0]['command']}</code> ({commits})</details>"


def ablation(study: str) -> list[tuple[str, ...]]:
    """Return a row for each setting of an ablation study, `STUDY.jsonl`, after a head.

    Differences from the defaults are those of `points_apart`. Votes are left out if a single window votes.
    """
    _, *lines = map(json.loads, ACCURACY.with_name(f"{study}.jsonl").read_text().splitlines())
    kinds = {"one": "one window", "five": "vote"}
    if all(line["one"] == line["five"] for line in lines):
        del kinds["five"]
    runs = by_settings(lines, (*kinds, "minutes", "window_ms"))
    rows = []
    for settings, found in runs.items():
        means = [spread(found[kind].values()) for kind in kinds]
        apart = ["" if settings == DEFAULT else points_apart(found[kind], runs[DEFAULT][kind]) for kind in kinds]
        costs = [f"{mean(found[cost].values()):.1f}" for cost in ("minutes", "window_ms")]
        rows.append((settings, *means, *apart, *costs))
    points = [f"points from the defaults: {kind}" for kind in kinds.values()]
    head = ("changed settings", *kinds.values(), *points, "minutes", "ms per window")
    return [head, *sorted(rows, key=lambda row: (row[0] != DEFAULT, row[0]))]


def robustness() -> list[tuple[str, ...]]:
    """Return a row for each corruption and strength in `robustness.json` of `recipes/robustness.py`, after a head."""
    cells = json.loads(ROBUSTNESS.read_bytes())["cells"]
    networks = list(dict.fromkeys(cell["network"] for cell in cells))
    found: dict[tuple[str, str], dict[str, str]] = {}
    for cell in cells:
        row = found.setdefault((cell["corruption"], f"{cell['strength']:g}"), {})
        row[cell["network"]] = f"{Accuracy(*cell['accuracy']):.3f}"
    rows = [(*key, *(row[network] for network in networks)) for key, row in found.items()]
    return [("corruption", "strength", *networks), *rows]


def _millions(count: int | None, digits: int) -> str:
    return f"{count / 1e6:,.{digits}f} M" if count else ""


def _milliseconds(times: list[float | None]) -> str:
    known = [one for one in times if one is not None]
    return f"{mean(known):.1f}" if len(known) == len(times) else ""


def _with_intervals(accuracies: list[list[float]]) -> str:
    values, lows, highs = zip(*accuracies, strict=True)
    return f"{spread(values)} ({min(lows):.3f} to {max(highs):.3f})"


def add_runs(table: str, row: str, folders: list[Path]) -> None:
    """Add the figures of runs to `accuracy.json`, or replace those of the row."""
    runs = [_run(folder) for folder in folders]
    if len({run["command"] for run in runs}) != 1 or len({run["seed"] for run in runs}) < len(runs):
        raise ValueError(f"{', '.join(map(str, folders))} must be runs of one command line with different seeds")
    known = json.loads(ACCURACY.read_bytes()) if ACCURACY.exists() else {}
    known.setdefault(table, {})[row] = runs
    put(ACCURACY, f"{json.dumps(known, indent=1)}\n".encode())


def _run(folder: Path) -> dict[str, Any]:
    try:
        report = json.loads((folder / "report.json").read_bytes())
        lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
        run = report["run"]
        return {
            "command": shlex.join(_without_folders(run["command"])),
            "seed": report["data"]["seed"],
            "validation": lines[run["epoch"] - 1].get("validation_accuracy"),
            "window": report["accuracy"]["window"],
            "vote": report["accuracy"]["vote"],
            "tested_on": report["tested_on"],
            "recordings": report["recordings"],
            "windows": report["windows"],
            **{name: run.get(name) for name in ("window_ms", "weights", "operations")},
            "epoch": run["epoch"],
            "epoch_chosen_by": run["epoch_chosen_by"],
            "minutes": round(sum(line["seconds"] for line in lines) / 60, 2),
            "commit": run["commit"],
            "machine": run["machine"],
            "split_hashes": {name: value for name, value in report["data"].items() if "hash" in name},
        }
    except (ValueError, LookupError, TypeError) as error:
        raise FormatError(folder, f"isn't the folder of a run: {error!r}") from None


def _without_folders(words: list[str]) -> list[str]:
    """Return a command line without --out, --root, --seed and the folder of the recipe."""
    kept, skip = [Path(words[0]).name], False
    for word in words[1:]:
        option = word.split("=")[0] in ("--out", "--root", "--seed")
        if not (skip or option):
            kept.append(word)
        skip = option and "=" not in word
    return kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", help="name of the table")
    parser.add_argument("row", help="name of the row, which is added or replaced")
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="folder of a run")
    args = parser.parse_args()
    add_runs(args.table, args.row, args.folders)


if __name__ == "__main__":
    training.run(main)
