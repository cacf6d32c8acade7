"""Report of a training: `report.json`, `predictions.csv`, `scores.npz` and figures."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from nvsdata import plots
from nvsdata import transforms as T
from nvsdata.common.errors import shown
from nvsdata.common.files import put
from nvsdata.common.machine import commit, machine
from nvsdata.metrics import Accuracy
from nvsdata.training.accuracy_by_window import accuracy_by_events, accuracy_by_length
from nvsdata.training.evaluation import Votes, cost, window_ms
from nvsdata.training.summary import Mistake, Summary, as_csv, as_json, mistakes_of, summarized
from nvsdata.training.trainer import Trainer
from nvsdata.transforms.events.windows import T_VOL
from nvsdata.transforms.rng import deterministic_rng

REPORT, PREDICTIONS, SCORES = "report.json", "predictions.csv", "scores.npz"
PICTURES = ("confusion.png", "classes.png", "calibration.png", "votes.png", "lengths.png", "events.png", "mistakes.png")
SHOWN = 48  # maximum number of mistakes on the contact sheet


def write_report(
    trainer: Trainer, test: Callable[[Any], Any], transform: Any, votes: Votes, classes: Sequence[str]
) -> dict[str, Any]:
    """Write `report.json`, `predictions.csv`, `scores.npz` and figures to the folder of the training.

    `scores.npz` has `scores`, float32 [rounds, N, num_classes], log-probabilities averaged over the windows of a vote,
    and `targets`, int64 [N], in the order of `predictions.csv`.

    Figures of an earlier report are removed if there are no data for them. `report.json` also describes the run:
    command line, versions, commit, machine, data, seed, the epoch whose weights were tested, and CPU time and
    operations of a prediction.

    All processes of a team must call this function. The first one writes, and all return the same report.

    Args:
        trainer: Trainer of the network, which is run again for windows of other lengths, and with fewer events.
        test: Function from a transform to the test dataset, such as `TrainTestSplit.test`.
        transform: Transform from a recording to the network's input.
        votes: The network's predictions for the test recordings.
        classes: Class names.

    Returns:
        The content of `report.json`.

    Raises:
        ProcessFailed: Another process failed.

    Example:
        >>> split = training.TrainTestSplit("folder", Path("shapes"))  # doctest: +SKIP
        >>> found = training.votes(model, batches, windows=5, team=team)  # doctest: +SKIP
        >>> training.write_report(trainer, split.test, transform, found, split.classes)  # doctest: +SKIP
    """
    by_length, by_events = (measure(trainer, test, transform) for measure in (accuracy_by_length, accuracy_by_events))
    accuracy_by = {"window_us": by_length, "events": by_events}

    def written() -> dict[str, Any]:
        return _write(trainer, test, transform, votes, classes, accuracy_by) if trainer.team.rank == 0 else {}

    return trainer.team.attempt(written)[0]


def _write(
    trainer: Trainer,
    test: Callable[[Any], Any],
    transform: Any,
    votes: Votes,
    classes: Sequence[str],
    accuracy_by: dict[str, dict[int, Accuracy]],
) -> dict[str, Any]:
    """Write the files of a report, and return the content of `report.json`."""
    data, device = test(transform), trainer.team.device
    costs = {"window_ms": round(window_ms(trainer.model, data, device), 3)} | cost(trainer.model, data, device)
    summary, mistakes = summarized(votes), mistakes_of(votes)
    recordings = test(T.RandomWindow(T.window_length(transform) or T_VOL))
    numbers = as_json(summary, mistakes, accuracy_by, recordings.samples, classes)
    pictures = _pictures(summary, accuracy_by["window_us"], accuracy_by["events"], classes)
    pictures["mistakes.png"] = _sheet(mistakes, recordings, classes) if mistakes else None
    text = json.dumps(_run(trainer, costs) | numbers, indent=1, allow_nan=False)
    put(trainer.out / REPORT, text.encode())
    put(trainer.out / PREDICTIONS, as_csv(votes, recordings.samples, classes).encode())
    put(trainer.out / SCORES, _scores(votes))
    for name in PICTURES:
        picture = pictures.get(name)
        if picture is None:
            (trainer.out / name).unlink(missing_ok=True)
        else:
            plots.save_png(picture, trainer.out / name)
    count = sum(p is not None for p in pictures.values())
    trainer.team.print(f"report: {shown(trainer.out / REPORT)}, and {count} plots")
    return dict(json.loads(text))


def _scores(votes: Votes) -> bytes:
    file = io.BytesIO()
    np.savez(file, scores=votes.voters.mean(1).float().numpy(), targets=votes.targets.numpy())
    return file.getvalue()


def _run(trainer: Trainer, costs: dict[str, float]) -> dict[str, Any]:
    """Return a description of a run, so that it can be repeated, with the costs of a prediction."""
    chosen = trainer.best[0] if trainer.best else trainer.done
    by = "validation accuracy" if trainer.best else "the number of epochs"
    run: dict[str, Any] = {
        "command": sys.argv,
        "commit": commit(),
        "machine": machine(),
        "epoch": chosen,
        "epoch_chosen_by": by,
        **costs,
    }
    return {"run": run, "data": trainer.data, "tested_on": "test"}


def _pictures(
    summary: Summary, by_length: dict[int, Accuracy], by_events: dict[int, Accuracy], classes: Sequence[str]
) -> dict[str, np.ndarray | None]:
    rounds, windows, recordings = summary.size
    vote = f"vote of {windows}"
    kinds = ("one window", vote) if windows > 1 else ("one window",)
    of = f"{recordings} recordings" + (f", {rounds} votes each" if rounds > 1 else "")
    bars = [np.array([found.value for found in of_kind]) for of_kind in summary.classes[::-1]]
    pictures: dict[str, np.ndarray | None] = {
        "confusion.png": plots.confusion(summary.confusion, classes, f"{kinds[-1]}, {of}"),
        "classes.png": plots.class_bars(
            classes, summary.counts, list(zip(kinds[::-1], bars, strict=False)), f"accuracy, {of}"
        ),
        "calibration.png": plots.reliability(list(zip(kinds, summary.calibration, strict=False))),
    }
    if windows > 1:
        names = [str(k + 1) for k in range(windows)]
        title = f"accuracy by the number of votes, {of}"
        pictures["votes.png"] = _chart(summary.by_votes, names, title, "windows that vote")
    if by_length:
        names = [f"{length / 1000:.3g}" for length in by_length]
        title = "accuracy of one window by its length"
        pictures["lengths.png"] = _chart(list(by_length.values()), names, title, "ms of a window")
    if by_events:
        title = "single-window accuracy by number of events"
        pictures["events.png"] = _chart(
            list(by_events.values()), list(map(str, by_events)), title, "events of a window"
        )
    return pictures


def _chart(found: Sequence[Accuracy], names: Sequence[str], title: str, xlabel: str) -> np.ndarray:
    values, intervals = [one.value for one in found], [(one.low, one.high) for one in found]
    return plots.points_chart(values, names, title, xlabel, intervals)


def _sheet(mistakes: Sequence[Mistake], recordings: Any, classes: Sequence[str]) -> np.ndarray:
    tiles = []
    for mistake in mistakes[:SHOWN]:
        # the window at the midpoint of the recording, as for a vote of one window
        with deterministic_rng(0, 1):
            events, _ = recordings[mistake.index]
        named = "nothing (NaN)" if mistake.named < 0 else classes[mistake.named]
        lines = (f"true: {classes[mistake.true]}", f"predicted: {named}", f"confidence {mistake.confidence:.0%}")
        tiles.append((plots.event_image(events), lines))
    return plots.captioned_sheet(tiles)
