"""Whatever a recipe tests a network on, nothing random is done to it."""

import pytest
from pipelines import changes, transforms_of

from nvsdata.training import accuracy_by_window as lengths
from nvsdata.training import evaluation


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
