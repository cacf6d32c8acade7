"""What trained networks say of recordings: the same at every call."""

import threading

import numpy as np
import pytest
import torch
from lookalikes import saccade
from torch import nn

import nvsdata
from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.models import Trained
from nvsdata.transforms.rng import deterministic_rng, randint, uniform, window_start

GRAPHS = T.Compose([T.RandomWindow(20_000), T.NonUniformSample(2), T.RadiusGraph(3.0)])
POINTS = T.Compose([T.RandomWindow(50_000), T.RandomAffine(shift=2), T.DropEvents(0.5), T.Points(16)])


class Counts(nn.Module):
    """Scores by what it is given: the sum and the spread of all numbers."""

    def __init__(self):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(()))
        self.given = []

    def forward(self, batch):
        self.given.append(batch)
        values = batch.flatten(1)
        return torch.stack((values.sum(1), values.std(1)), 1)


@pytest.fixture
def events():
    return Events(*saccade(np.random.default_rng(1), 3, 900), (34, 34))


@pytest.fixture
def trained():
    torch.manual_seed(3)
    return Trained(models.rgcnn("n-mnist", 3).eval(), ("a", "b", "c"), GRAPHS, {}, {})


def test_an_answer_depends_on_nothing_but_the_recording(trained, events, tmp_path):
    nvsdata.write(events, tmp_path / "a.h5")
    first = trained.predict_proba(tmp_path / "a.h5")
    assert first.shape == (3,)
    assert first.sum() == pytest.approx(1)
    for seed in range(5):
        torch.manual_seed(seed)
        before = torch.get_rng_state()
        for given in (tmp_path / "a.h5", str(tmp_path / "a.h5"), nvsdata.open(tmp_path / "a.h5"), events):
            assert torch.equal(trained.predict_proba(given), first)
        assert torch.equal(torch.get_rng_state(), before)
    # windows differ, so fewer of them have another opinion
    assert not torch.equal(trained.predict_proba(events, windows=1), first)


def test_others_beside_it_make_no_difference(trained, events, tmp_path):
    several = []
    for digit in range(4):
        several.append(Events(*saccade(np.random.default_rng(digit), digit, 500), (34, 34)))
    nvsdata.write(several[2], tmp_path / "2.bin")
    found = trained.predict_proba([several[0], several[1], tmp_path / "2.bin", several[3]])
    assert found.shape == (4, 3)
    for one, alone in zip(found, several, strict=True):
        assert torch.equal(one, trained.predict_proba(alone))
    names = trained.predict(iter(several))
    assert names == [trained.predict(one) for one in several] == [trained.classes[n] for n in found.argmax(1)]
    assert trained.predict([]) == []
    assert trained.predict_proba([]).shape == (0, 3)


def test_threads_do_not_disturb_each_other(trained, events):
    expected = trained.predict_proba(events)
    found = []
    threads = [threading.Thread(target=lambda: found.append(trained.predict_proba(events))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert all(torch.equal(one, expected) for one in found)


@pytest.mark.parametrize("windows", [1, 2, 5, 8])
def test_windows_are_spread_evenly(windows):
    # an event each µs: the first one of a window tells where it begins
    events = Events(np.arange(10_000), *[np.zeros(10_000, int)] * 3, (34, 34))
    starts = []
    for number in range(windows):
        with deterministic_rng(number, windows):
            starts.append(int(T.RandomWindow(2000)(events).t[0]))
            parts = [int(window.t[0]) for window in T.RandomWindows(4, 500)(events)]
            frames = T.RandomTemporalCrop(4)(torch.arange(24.0).view(24, 1, 1))
        assert [at - 2500 * n for n, at in enumerate(parts)] == [parts[0]] * 4
        assert parts[0] == int((number + 0.5) / windows * 2001)
        assert frames[0] == int((number + 0.5) / windows * 21)
    assert starts == [int((number + 0.5) / windows * 8001) for number in range(windows)]


def test_what_a_voter_draws_is_its_own():
    def draws():
        return randint(10**6), uniform(0, 1), window_start(1000)

    with deterministic_rng(1, 4):
        first = draws()
        with deterministic_rng(2, 4):
            other = draws()
    with deterministic_rng(1, 4):
        assert draws() == first
    assert other[0] != first[0]
    assert (first[2], other[2]) == (375, 625)
    torch.manual_seed(0)
    outside = draws()
    torch.manual_seed(0)
    with deterministic_rng(1, 4):
        draws()
    assert draws() == outside


@pytest.mark.parametrize("last", [0, 50, 19_999])
def test_recordings_shorter_than_a_window(trained, last):
    events = Events([0, last // 2, last], [1, 2, 3], [1, 2, 3], [0, 1, 0], (34, 34))
    assert trained.predict_proba(events).isfinite().all()
    assert trained.predict_proba(events[:0]).isfinite().all()


def test_draws_of_all_transforms_are_the_voters(events):
    model = Counts()
    trained = Trained(model, (), POINTS, {}, {})
    names = [trained.predict(events, windows=3) for _ in range(4)]
    assert len(set(names)) == 1
    assert names[0] in ("0", "1")
    assert all(torch.equal(batch, model.given[0]) for batch in model.given)
    assert not torch.equal(model.given[0][0], model.given[0][1])


def test_nan_names_no_class(trained, events):
    with torch.no_grad():
        trained.model.classify.bias[1] = torch.nan
    assert trained.predict_proba(events).isnan().any()
    with pytest.raises(ValueError, match="the network's scores are NaN for 1 of 1 recordings"):
        trained.predict(events)


def test_wrong_arguments(trained, events):
    with pytest.raises(ValueError, match="windows must be at least 1, not 0"):
        trained.predict(events, windows=0)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        trained.predict("nowhere.h5")


def test_five_windows_vote_unless_others_are_asked(events):
    trained = Trained(Counts(), (), POINTS, {}, {})
    votes = {windows: trained.predict_proba(events, windows=windows) for windows in (4, 5, 6)}
    assert torch.equal(trained.predict_proba(events), votes[5])
    assert not any(torch.equal(votes[windows], votes[5]) for windows in (4, 6))
    assert [len(batch) for batch in trained.model.given] == [4, 5, 6, 5]
    trained.predict(events)
    trained.predict([events])
    assert [len(batch) for batch in trained.model.given[4:]] == [5, 5]


def test_recordings_without_scores_are_counted(events):
    class Some(Counts):
        def forward(self, batch):
            scores = super().forward(batch)
            return scores if len(self.given) == 2 else scores * torch.nan

    with pytest.raises(ValueError, match="the network's scores are NaN for 2 of 3 recordings"):
        Trained(Some(), (), POINTS, {}, {}).predict([events] * 3)
