"""Compare two networks by their predictions for the same test recordings.

    python recipes/compare_runs.py runs/rgcnn runs/gcnn

A and B are each the folder of a run of `train_objects.py` or `train_actions.py`, or a folder of such folders, for
example of several seeds. All runs must have the same test recordings. Several runs count as several predictions for
each recording, and their mean and standard deviation are printed. Then the runs of a folder are compared as an
ensemble, which votes by the sum of their log-probabilities.

Intervals are 95% intervals over recordings, because windows of one recording are correlated. The test is exact and
paired by recording: with one vote per recording it is McNemar's. Both are about these trained networks: the variation
between trainings isn't in them, so compare the standard deviations over several seeds, too.
"""

from __future__ import annotations

import argparse
import csv
import math
from pathlib import Path
from statistics import mean, stdev
from zipfile import BadZipFile

import numpy as np

from nvsdata import FormatError, metrics
from nvsdata.common.errors import shown
from nvsdata.training import run
from nvsdata.training.report import PREDICTIONS, SCORES
from nvsdata.training.summary import COLUMNS

KINDS = {"Single windows": ("right_windows", "windows"), "Votes": ("right_votes", "votes")}
Rows = dict[tuple[str, ...], dict[str, int]]  # by recording, part and class


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("A", type=Path, help="folder of a run, or of several")
    parser.add_argument("B", type=Path, help="folder of a run, or of several, to compare with")
    args = parser.parse_args()
    folders = {name: runs_in(getattr(args, name)) for name in "AB"}
    tables = {name: [read(folder) for folder in folders[name]] for name in "AB"}
    recordings = same_recordings({name: getattr(args, name) for name in "AB"}, tables)
    print(f"A: {shown(args.A)}\nB: {shown(args.B)}\n{len(recordings)} test recordings")
    for kind, columns in KINDS.items():
        print(f"\n{kind}")
        runs = {name: [outcomes(rows, recordings, *columns) for rows in tables[name]] for name in "AB"}
        right = {name: np.concatenate(of_seeds) for name, of_seeds in runs.items()}
        for name in "AB":
            print(f"{name}: {metrics.accuracy(right[name]):.3f}{seeds(runs[name])}")
        print(verdict(right["A"], right["B"]))
    if max(map(len, folders.values())) > 1:
        print(f"\nEnsembles\n{ensembles(folders, tables, recordings)}")


def runs_in(folder: Path) -> list[Path]:
    """Return the folder itself if it is that of a run, otherwise the runs in it."""
    found = [folder] if (folder / PREDICTIONS).is_file() else sorted(p.parent for p in folder.glob(f"*/{PREDICTIONS}"))
    if not found:
        raise ValueError(f"{folder} has no {PREDICTIONS}, nor has a folder in it: is it the folder of a finished run?")
    return found


def read(folder: Path) -> Rows:
    """Read the numbers of predictions of a run."""
    path, rows = folder / PREDICTIONS, {}
    # other bytes than UTF-8 aren't the columns or numbers that are checked below
    with path.open(newline="", encoding="utf-8", errors="surrogateescape") as file:
        table = csv.DictReader(file)
        if tuple(table.fieldnames or ()) != COLUMNS:
            raise FormatError(path, f"the columns must be {', '.join(COLUMNS)}")
        for row in table:
            try:
                numbers = {name: int(row[name]) for pair in KINDS.values() for name in pair}
            except (TypeError, ValueError):
                raise FormatError(path, f"line {table.line_num} has no whole numbers of votes and windows") from None
            if not all(0 <= numbers[right] <= numbers[count] and numbers[count] for right, count in KINDS.values()):
                raise FormatError(path, f"line {table.line_num} has more right votes or windows than there are")
            rows[row["recording"], row["part_us"], row["class"]] = numbers
    return rows


def same_recordings(folders: dict[str, Path], tables: dict[str, list[Rows]]) -> list[tuple[str, ...]]:
    """Return the test recordings of all runs. ValueError if they differ."""
    wanted = tables["A"][0].keys()
    for name in "AB":
        for rows in tables[name]:
            if differ := wanted ^ rows.keys():
                example = "/".join(filter(None, min(differ)))
                which = f"the runs in {folders['A']} and {folders[name]} were tested on different recordings"
                raise ValueError(f"{which}: {len(differ)} are in one only, such as {example}")
    return list(wanted)


def outcomes(rows: Rows, recordings: list[tuple[str, ...]], right: str, count: str) -> np.ndarray:
    """Return whether predictions are right, bool [predictions per recording, N].

    The files state only how many predictions of a recording are right, so these are put first.
    """
    rights, counts = (np.array([rows[recording][name] for recording in recordings]) for name in (right, count))
    if len(set(counts)) > 1:
        raise ValueError(f"recordings have different numbers of {count}: {counts.min()} to {counts.max()}")
    return np.arange(counts[0])[:, None] < rights


def ensembles(folders: dict[str, list[Path]], tables: dict[str, list[Rows]], recordings: list[tuple[str, ...]]) -> str:
    """Return the accuracies of the runs of A as an ensemble and of those of B, and their difference, as text."""
    paths = {name: [folder / SCORES for folder in folders[name]] for name in "AB"}
    if missing := [path for path in (*paths["A"], *paths["B"]) if not path.is_file()]:
        return f"not compared: {missing[0]} doesn't exist (the run is of an earlier version)"
    runs = {
        name: [scores_of(path, rows, recordings) for path, rows in zip(paths[name], tables[name], strict=True)]
        for name in "AB"
    }
    first, known = runs["A"][0]
    lines, right = [], {}
    for name in "AB":
        for path, (scores, targets) in zip(paths[name], runs[name], strict=True):
            if scores.shape != first.shape or not np.array_equal(targets, known):
                raise FormatError(path, f"has other rounds or classes than {paths['A'][0]}")
        total = sum((scores for scores, _ in runs[name]), np.zeros_like(first))
        right[name] = (total.argmax(2) == known) & ~np.isnan(total).any(2)
        lines.append(f"{name}: {metrics.accuracy(right[name]):.3f}, number of networks: {len(paths[name])}")
    return "\n".join([*lines, verdict(right["A"], right["B"])])


def scores_of(path: Path, rows: Rows, recordings: list[tuple[str, ...]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the log-probabilities [rounds, N, num_classes] and true classes [N] of a run, in order of `recordings`."""
    try:
        with np.load(path) as arrays:
            scores, targets = arrays["scores"], arrays["targets"]
    except (ValueError, KeyError, TypeError, EOFError, BadZipFile) as error:
        raise FormatError(path, f"isn't the {SCORES} of a run: {error}") from None
    count = len(rows)
    if scores.ndim != 3 or scores.shape[1] != count or targets.shape != (count,) or scores.dtype.kind != "f":
        raise FormatError(path, f"scores must be of {count} recordings, as {PREDICTIONS} has")
    at = {recording: i for i, recording in enumerate(rows)}
    order = [at[recording] for recording in recordings]
    return scores[:, order].astype(np.float64), targets[order]


def seeds(runs: list[np.ndarray]) -> str:
    """Return the mean and standard deviation over runs as text, which is empty for one run."""
    if len(runs) == 1:
        return ""
    values = [float(right.mean()) for right in runs]
    return f", {len(runs)} runs: mean {mean(values):.3f}, standard deviation {stdev(values):.3f}"


def verdict(first: np.ndarray, second: np.ndarray) -> str:
    """Return the difference as text."""
    same = math.lcm(len(first), len(second))
    found = metrics.paired_test(*(np.tile(right, (same // len(right), 1)) for right in (first, second)))
    better, sign = ("B", -1) if found.difference < 0 else ("A", 1)
    low, high = sorted(100 * sign * end for end in found.interval)
    p = f"p = {found.p:.2g}" if found.p >= 0.001 else "p < 0.001"
    return f"{better} is better by {100 * abs(found.difference):.1f} points, 95% interval {low:.1f} to {high:.1f}, {p}"


if __name__ == "__main__":
    run(main)
