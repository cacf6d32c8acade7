"""The numbers that a training ends with."""

import csv
import io
import json
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import torch

from nvsdata import Events, metrics, plots
from nvsdata import transforms as T
from nvsdata.datasets.facts import Sample
from nvsdata.metrics import Accuracy
from nvsdata.training import Team, Votes, report
from nvsdata.training.summary import as_csv, as_json, mistakes_of, summarized

CLASSES = ("cat", "dog", "owl")


def votes_of(probabilities, targets):
    """Votes of probabilities [rounds, windows, N, classes]."""
    return Votes(torch.tensor(probabilities, dtype=torch.float32).log(), torch.tensor(targets))


def test_mistakes_come_by_confidence_each_recording_once():
    # two rounds of one window, on four recordings of which the second is right once and the third always
    first = [[0.2, 0.7, 0.1], [0.6, 0.3, 0.1], [0.1, 0.1, 0.8], [0.05, 0.9, 0.05]]
    second = [[0.3, 0.6, 0.1], [0.3, 0.4, 0.3], [0.2, 0.2, 0.6], [0.45, 0.1, 0.45]]
    found = mistakes_of(votes_of([[first], [second]], [0, 1, 2, 0]))
    assert [(m.index, m.true, m.named, round(m.confidence, 3), m.wrong) for m in found] == [
        (3, 0, 1, 0.9, 0.5),
        (0, 0, 1, 0.7, 1.0),
        (1, 1, 0, 0.6, 0.5),
    ]


def test_numbers_agree_with_each_other_and_with_the_votes():
    rng = np.random.default_rng(0)
    given = rng.dirichlet([1, 1, 1], (2, 3, 20))
    targets = rng.integers(0, 2, 20).tolist()  # no owl
    votes = votes_of(given, targets)
    summary, mistakes = summarized(votes), mistakes_of(votes)
    samples = [Sample(f"x/{i}.bin", label) for i, label in enumerate(targets)]
    found = json.loads(
        json.dumps(
            as_json(summary, mistakes, {"events": {10: Accuracy(0.5, 0.25, 0.75)}}, samples, CLASSES), allow_nan=False
        )
    )

    assert (found["recordings"], found["windows"], found["rounds"]) == (20, 3, 2)
    assert found["accuracy"]["vote"] == list(votes.together)
    assert found["accuracy_by_votes"]["3"] == list(votes.together)
    assert found["accuracy_by_votes"]["1"][0] == pytest.approx(votes.single.value)
    counts = {true: sum(row.values()) for true, row in found["confusion"].items()}
    assert counts == {"cat": 2 * targets.count(0), "dog": 2 * targets.count(1), "owl": 0}
    right = sum(row.get(true, 0) for true, row in found["confusion"].items())
    assert right / 40 == pytest.approx(votes.together.value)
    for true in ("cat", "dog"):
        assert found["classes"][true]["vote"][0] == pytest.approx(found["confusion"][true][true] / counts[true])
    assert found["classes"]["owl"] == {"recordings": 0, "window": [None] * 3, "vote": [None] * 3}
    assert sum(found["calibration"]["window"]["count"]) == 120
    assert sum(found["calibration"]["vote"]["count"]) == 40
    wrong = {mistake["recording"]: mistake for mistake in found["mistakes"]}
    assert round(sum(m["wrong_votes"] for m in wrong.values()) * 2) == 40 - right
    assert all(mistake["true"] != mistake["predicted"] for mistake in wrong.values())


def test_nan_is_a_mistake_without_a_name():
    given = np.full((1, 2, 2, 3), 1 / 3)
    given[0, 0, 0] = np.nan
    votes = votes_of(given, [0, 0])
    found = as_json(
        summarized(votes), mistakes_of(votes), {}, [Sample("a", 0), Sample("b", 0, (5, 9))], ("cat", "dog", "owl")
    )
    json.dumps(found, allow_nan=False)
    assert found["mistakes"] == [
        {"recording": "a", "part_us": None, "true": "cat", "predicted": None, "confidence": 0.0, "wrong_votes": 1.0}
    ]
    assert found["confusion"]["cat"] == {"cat": 1}
    assert found["accuracy"]["vote"][0] == 0.5


def test_a_report_has_every_number_by_name():
    """Two recordings, one round of two windows, by hand."""
    given = [[[[0.2, 0.7, 0.1], [0.1, 0.1, 0.8]], [[0.9, 0.05, 0.05], [0.6, 0.2, 0.2]]]]
    votes = votes_of(given, [1, 0])
    samples = [Sample("a.bin", 1), Sample("b.bin", 0, (5, 9))]
    found = as_json(
        summarized(votes),
        mistakes_of(votes),
        {
            "window_us": {15: Accuracy(0.25, 0.2, 0.3), 30: metrics.accuracy([0, 1])},
            "events": {7: metrics.accuracy([1])},
        },
        samples,
        CLASSES,
    )
    assert (found["recordings"], found["windows"], found["rounds"]) == (2, 2, 1)
    # by products: .18 to .035 for the first; .06, .02, .16 for the second
    one, none = list(metrics.accuracy([[0, 1], [1, 0]])), list(metrics.accuracy([0, 0]))
    assert found["accuracy"] == {"window": one, "vote": none}
    one, none = list(metrics.accuracy([[0], [1]])), list(metrics.accuracy([0]))
    assert found["classes"]["cat"] == {"recordings": 1, "window": one, "vote": none}
    assert found["classes"]["dog"] == {"recordings": 1, "window": one, "vote": none}
    assert found["confusion"] == {"cat": {"owl": 1}, "dog": {"cat": 1}, "owl": {}}
    assert found["accuracy_by_window_us"] == {"15": [0.25, 0.2, 0.3], "30": list(metrics.accuracy([0, 1]))}
    assert found["accuracy_by_events"] == {"7": list(metrics.accuracy([1]))}
    assert {k: of_k[0] for k, of_k in found["accuracy_by_votes"].items()} == {"1": 0.5, "2": 0.0}
    assert [(m["recording"], m["part_us"], m["true"], m["predicted"], m["wrong_votes"]) for m in found["mistakes"]] == [
        ("a.bin", None, "dog", "cat", 1.0),
        ("b.bin", (5, 9), "cat", "owl", 1.0),
    ]
    # the geometric mean of a window's probabilities, divided by that of all classes
    first, second = (np.sqrt(np.prod([window[n] for window in given[0]], 0)) for n in (0, 1))
    confidence = [mistake["confidence"] for mistake in found["mistakes"]]
    assert confidence == pytest.approx([first.max() / first.sum(), second.max() / second.sum()])
    windows, vote = found["calibration"]["window"], found["calibration"]["vote"]
    assert (sum(windows["count"]), sum(vote["count"])) == (4, 2)
    # one after the other: .7 right, .8 wrong, .9 wrong, .6 right
    gap = abs(0.7 - 1) + 0.8 + 0.9 + abs(0.6 - 1)
    assert windows["expected_calibration_error"] == pytest.approx(gap / 4)
    assert vote["expected_calibration_error"] == pytest.approx(sum(confidence) / 2)
    assert sorted(share for share in windows["confidence"] if share is not None) == pytest.approx([0.6, 0.7, 0.8, 0.9])
    assert sum(share or 0 for share in windows["accuracy"]) == 2


def test_predictions_are_a_row_per_recording():
    rng = np.random.default_rng(3)
    votes = votes_of(rng.dirichlet([1, 1, 1], (3, 2, 30)), rng.integers(0, 3, 30).tolist())
    samples = [Sample(f"a/{n},x.bin", 0, (5, 9) if n % 2 else None) for n in range(30)]
    rows = list(csv.DictReader(io.StringIO(as_csv(votes, samples, CLASSES))))
    assert [(row["recording"], row["part_us"]) for row in rows[:2]] == [("a/0,x.bin", ""), ("a/1,x.bin", "5-9")]
    assert [CLASSES.index(row["class"]) for row in rows] == votes.targets.tolist()
    assert {(row["votes"], row["windows"]) for row in rows} == {("3", "6")}
    assert sum(int(row["right_votes"]) for row in rows) / 90 == pytest.approx(votes.together.value)
    assert sum(int(row["right_windows"]) for row in rows) / 180 == pytest.approx(votes.single.value)
    for row in rows:
        # most of three votes are right if and only if the class is predicted
        if row["right_votes"] != "1":
            assert (row["predicted"] == row["class"]) == (row["right_votes"] in "23")


def test_a_recording_without_scores_has_no_prediction():
    found = as_csv(votes_of([[[[np.nan] * 3]]], [1]), [Sample("a.bin", 1)], CLASSES).splitlines()
    assert found[1] == "a.bin,,dog,,0,1,0,1"


class Recordings:
    """Recordings to test on, of which the number is an event's column."""

    samples: ClassVar = [Sample(f"{n}.bin", 0) for n in range(60)]

    def __init__(self, transform):
        self.transform = transform

    def __getitem__(self, index):
        return Events([0, 10], [index, index], [0, 0], [1, 1], (60, 1)), 0


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn, by kind: arguments of `plots`."""
    seen = {}

    def kind(name):
        return lambda *given: seen.setdefault(name, []).append(given) or np.zeros((1, 1, 3), np.uint8)

    names = ("confusion", "class_bars", "reliability", "points_chart", "captioned_sheet")
    monkeypatch.setattr(
        report,
        "plots",
        SimpleNamespace(
            save_png=plots.save_png, event_image=lambda events: events, **{name: kind(name) for name in names}
        ),
    )
    return seen


def written(out, monkeypatch, capsys, votes, by_length, by_events, transform=None):
    monkeypatch.setattr(report, "accuracy_by_length", lambda *_: by_length)
    monkeypatch.setattr(report, "accuracy_by_events", lambda *_: by_events)
    monkeypatch.setattr(report, "window_ms", lambda *_: 1.2344)
    monkeypatch.setattr(report, "cost", lambda *_: {"weights": 7, "operations": 9})
    trainer = SimpleNamespace(
        model=None, out=out, team=Team(torch.device("cpu")), best=(2, {}), done=5, data={"seed": 3}
    )
    monkeypatch.setattr(Recordings, "samples", Recordings.samples[: len(votes.targets)])
    made = []
    report.write_report(trainer, lambda cut: made.append(Recordings(cut)) or made[-1], transform, votes, CLASSES)
    return capsys.readouterr().out, made[-1].transform


def test_pictures_of_a_report_say_what_they_show(tmp_path, monkeypatch, capsys, drawn):
    rng = np.random.default_rng(0)
    votes = votes_of(rng.dirichlet([1, 1, 1], (2, 3, 50)), rng.integers(0, 3, 50).tolist())
    output, window = written(
        tmp_path,
        monkeypatch,
        capsys,
        votes,
        {7_500: Accuracy(0.5, 0.4, 0.6), 30_000: Accuracy(0.75, 0.7, 0.8)},
        {80: Accuracy(0.25, 0.2, 0.3)},
        T.RandomWindow(7_000),
    )
    written_report = json.loads((tmp_path / "report.json").read_text())
    assert written_report["data"] == {"seed": 3}
    assert written_report["run"]["window_ms"] == 1.234
    assert (written_report["run"]["epoch"], written_report["run"]["epoch_chosen_by"]) == (2, "validation accuracy")
    costs = {"window_ms", "weights", "operations"}
    assert written_report["run"].keys() == {"command", "commit", "machine", "epoch", "epoch_chosen_by", *costs}
    assert output == f"report: {tmp_path / 'report.json'}, and 7 plots\n"
    assert window == T.RandomWindow(7_000)
    ((counts, names, title),) = drawn["confusion"]
    assert (counts.sum(), names, title) == (100, CLASSES, "vote of 3, 50 recordings, 2 votes each")
    ((_, _, bars, title),) = drawn["class_bars"]
    summary = summarized(votes)
    assert [name for name, _ in bars] == ["vote of 3", "one window"]
    assert bars[0][1].tolist() == [found.value for found in summary.classes[1]]
    assert bars[1][1].tolist() == [found.value for found in summary.classes[0]]
    assert title == "accuracy, 50 recordings, 2 votes each"
    (((one, first), (vote, second)),) = drawn["reliability"][0]
    assert (one, first.counts.sum(), vote, second.counts.sum()) == ("one window", 300, "vote of 3", 100)
    by_votes, by_length, by_events = drawn["points_chart"]
    assert by_votes[1:4] == (
        ["1", "2", "3"],
        "accuracy by the number of votes, 50 recordings, 2 votes each",
        "windows that vote",
    )
    assert by_votes[0] == [found.value for found in summary.by_votes]
    assert by_votes[4] == [(found.low, found.high) for found in summary.by_votes]
    of = "accuracy of one window by its length"
    assert by_length == ([0.5, 0.75], ["7.5", "30"], of, "ms of a window", [(0.4, 0.6), (0.7, 0.8)])
    of = "single-window accuracy by number of events"
    assert by_events == ([0.25], ["80"], of, "events of a window", [(0.2, 0.3)])
    with np.load(tmp_path / "scores.npz") as scores:
        assert np.allclose(scores["scores"], votes.voters.mean(1), atol=1e-6)
        assert scores["targets"].tolist() == votes.targets.tolist()
    assert {path.name for path in tmp_path.iterdir()} == {
        "report.json",
        "predictions.csv",
        "scores.npz",
        *report.PICTURES,
    }


def test_pictures_of_nothing_are_removed(tmp_path, monkeypatch, capsys, drawn):
    for name in report.PICTURES:
        (tmp_path / name).write_bytes(b"old")
    votes = votes_of([[[[0.8, 0.1, 0.1]] * 4]], [0] * 4)
    output, window = written(tmp_path, monkeypatch, capsys, votes, {}, {})
    assert "and 3 plots" in output
    # as long as a picture of a camera takes
    assert window == T.RandomWindow(33_333)
    assert {path.name for path in tmp_path.glob("*.png")} == {"confusion.png", "classes.png", "calibration.png"}
    assert drawn["confusion"][0][2] == "one window, 4 recordings"
    assert [name for name, _ in drawn["class_bars"][0][2]] == ["one window"]
    assert [name for name, _ in drawn["reliability"][0][0]] == ["one window"]


def test_a_sheet_of_mistakes_has_the_most_confident_ones(tmp_path, monkeypatch, capsys, drawn):
    # all wrong, the last most of all; the first two windows have no scores
    given = [[0.5 - n / 200, 0.5 + n / 200, 0.0] for n in range(60)]
    given[0] = [np.nan] * 3
    written(tmp_path, monkeypatch, capsys, votes_of([[given]], [0] * 60), {}, {})
    ((tiles,),) = drawn["captioned_sheet"]
    assert len(tiles) == 48
    assert [int(events.x[0]) for events, _ in tiles] == list(range(59, 11, -1))
    assert tiles[0][1] == ("true: cat", "predicted: dog", "confidence 80%")
    drawn.clear()
    written(tmp_path, monkeypatch, capsys, votes_of([[given[:2]]], [0, 2]), {}, {})
    ((tiles,),) = drawn["captioned_sheet"]
    assert [words for _, words in tiles] == [
        ("true: owl", "predicted: dog", "confidence 50%"),
        ("true: cat", "predicted: nothing (NaN)", "confidence 0%"),
    ]
