"""The numbers that a training ends with."""

import json

import numpy as np
import pytest
import torch

from nvsdata.datasets.facts import Sample
from nvsdata.training import Votes
from nvsdata.training.summary import as_json, mistakes_of, summarized

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
    found = json.loads(json.dumps(as_json(summary, mistakes, {10: 0.5}, samples, CLASSES), allow_nan=False))

    assert (found["recordings"], found["windows"], found["rounds"]) == (20, 3, 2)
    assert found["accuracy"]["vote"] == pytest.approx(votes.together)
    assert found["accuracy_by_votes"]["3"] == pytest.approx(votes.together)
    assert found["accuracy_by_votes"]["1"] == pytest.approx(votes.single)
    counts = {true: sum(row.values()) for true, row in found["confusion"].items()}
    assert counts == {"cat": 2 * targets.count(0), "dog": 2 * targets.count(1), "owl": 0}
    right = sum(row.get(true, 0) for true, row in found["confusion"].items())
    assert right / 40 == pytest.approx(votes.together)
    for true in ("cat", "dog"):
        assert found["classes"][true]["vote"] == pytest.approx(found["confusion"][true][true] / counts[true])
    assert found["classes"]["owl"] == {"recordings": 0, "window": None, "vote": None}
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
    assert found["accuracy"]["vote"] == 0.5
