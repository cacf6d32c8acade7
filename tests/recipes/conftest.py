"""Whatever a recipe tests a network on, nothing random is done to it."""

import shutil

import pytest
from pipelines import changes, transforms_of

from nvsdata.training import accuracy_by_window as lengths
from nvsdata.training import evaluation, report


@pytest.fixture(autouse=True)
def tested_on(monkeypatch):
    """The pipelines that networks were tested on so far, each of which was looked at."""
    real, seen = evaluation.predict, []

    def predict(model, batches, team):
        for transform in transforms_of(batches.dataset):
            assert not changes(transform), f"tested on {transform}"
            seen.append(transform)
        return real(model, batches, team)

    monkeypatch.setattr(evaluation, "predict", predict)
    monkeypatch.setattr(lengths, "predict", predict)
    return seen


@pytest.fixture(autouse=True)
def _few_draws(monkeypatch):
    # a report draws few recordings five times, of five lengths and numbers, which costs more than training them
    monkeypatch.setattr(lengths, "MOST_DRAWS", 1)
    monkeypatch.setattr(lengths, "FACTORS", (0.5, 1.0))
    monkeypatch.setattr(lengths, "FRACTIONS", (0.5,))


@pytest.fixture
def plotless(monkeypatch):
    """Reports without plots, which take longer to draw than such small networks to train."""
    monkeypatch.setattr(report, "_pictures", lambda *_: {})
    monkeypatch.setattr(report, "_sheet", lambda *_: None)


@pytest.fixture
def many(fake_nmnist):
    """N-MNIST's layout with enough recordings of each digit to hold some out."""
    for path in list((fake_nmnist / "Train").glob("*/00001.bin")):
        for number in range(10, 16):
            shutil.copy(path, path.with_name(f"{number:05}.bin"))
    return fake_nmnist
