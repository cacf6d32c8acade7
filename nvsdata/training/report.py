"""Report of a training: numbers in `report.json`, and figures."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from nvsdata import plots
from nvsdata import transforms as T
from nvsdata.common.errors import shown
from nvsdata.common.files import put
from nvsdata.training.accuracy_by_window import accuracy_by_length
from nvsdata.training.evaluation import Votes
from nvsdata.training.summary import Mistake, Summary, as_json, mistakes_of, summarized
from nvsdata.training.trainer import Trainer
from nvsdata.transforms.events.windows import T_VOL
from nvsdata.transforms.rng import deterministic_rng

REPORT = "report.json"
PICTURES = ("confusion.png", "classes.png", "calibration.png", "votes.png", "lengths.png", "mistakes.png")
SHOWN = 48  # mistakes on the contact sheet


def write_report(
    trainer: Trainer, test: Callable[[Any], Any], transform: Any, votes: Votes, classes: Sequence[str]
) -> None:
    """Write `report.json` and its figures to the training's folder; figures without data are removed.

    All processes of a team must call it; the first one writes.

    Args:
        trainer: Trainer of the network, which is run again for windows of other lengths.
        test: Function from a transform to the test dataset, such as `TrainTestSplit.test`.
        transform: Transform from a recording to the network's input.
        votes: The network's predictions for the test recordings.
        classes: Class names.

    Example:
        >>> split = training.TrainTestSplit("folder", Path("shapes"))  # doctest: +SKIP
        >>> found = training.votes(model, batches, windows=5, team=team)  # doctest: +SKIP
        >>> training.write_report(trainer, split.test, transform, found, split.classes)  # doctest: +SKIP
    """
    by_length = accuracy_by_length(trainer, test, transform)
    if trainer.team.rank:
        return
    summary, mistakes = summarized(votes), mistakes_of(votes)
    recordings = test(T.RandomWindow(T.window_length(transform) or T_VOL))
    numbers = as_json(summary, mistakes, by_length, recordings.samples, classes)
    pictures = _pictures(summary, by_length, classes)
    pictures["mistakes.png"] = _sheet(mistakes, recordings, classes) if mistakes else None
    put(trainer.out / REPORT, json.dumps(numbers, indent=1, allow_nan=False).encode())
    for name in PICTURES:
        picture = pictures.get(name)
        if picture is None:
            (trainer.out / name).unlink(missing_ok=True)
        else:
            plots.save_png(picture, trainer.out / name)
    count = sum(p is not None for p in pictures.values())
    trainer.team.print(f"report: {shown(trainer.out / REPORT)}, and {count} plots")


def _pictures(summary: Summary, by_length: dict[int, float], classes: Sequence[str]) -> dict[str, np.ndarray | None]:
    rounds, windows, recordings = summary.size
    vote = f"vote of {windows}"
    kinds = ("one window", vote) if windows > 1 else ("one window",)
    of = f"{recordings} recordings" + (f", {rounds} votes each" if rounds > 1 else "")
    pictures: dict[str, np.ndarray | None] = {
        "confusion.png": plots.confusion(summary.confusion, classes, f"{kinds[-1]}, {of}"),
        "classes.png": plots.class_bars(
            classes, summary.counts, list(zip(kinds[::-1], summary.classes[::-1], strict=False)), f"accuracy, {of}"
        ),
        "calibration.png": plots.reliability(list(zip(kinds, summary.calibration, strict=False))),
    }
    if windows > 1:
        names = [str(k + 1) for k in range(windows)]
        title = f"accuracy by the number of votes, {of}"
        pictures["votes.png"] = plots.points_chart(summary.by_votes.tolist(), names, title, "windows that vote")
    if by_length:
        names = [f"{length / 1000:.3g}" for length in by_length]
        title = "accuracy of one window by its length"
        pictures["lengths.png"] = plots.points_chart(list(by_length.values()), names, title, "ms of a window")
    return pictures


def _sheet(mistakes: Sequence[Mistake], recordings: Any, classes: Sequence[str]) -> np.ndarray:
    tiles = []
    for mistake in mistakes[:SHOWN]:
        # what a single voter would see: the middle
        with deterministic_rng(0, 1):
            events, _ = recordings[mistake.index]
        named = "nothing (NaN)" if mistake.named < 0 else classes[mistake.named]
        lines = (f"true: {classes[mistake.true]}", f"predicted: {named}", f"confidence {mistake.confidence:.0%}")
        tiles.append((plots.event_image(events), lines))
    return plots.captioned_sheet(tiles)
