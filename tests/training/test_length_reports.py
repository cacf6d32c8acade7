"""Windows of which the accuracy is measured by length and by number of events, without a network."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.training import Team
from nvsdata.training import accuracy_by_window as lengths

WINDOW = T.Compose([T.RandomWindow(1_000), T.Points(4)])


class Recordings:
    """As long as `spans` say, in µs; a sample is its number, with what its windows are."""

    def __init__(self, spans, transform):
        self.spans, self.transform, self.chosen = spans, transform, list(range(len(spans)))

    def subset(self, chosen):
        self.chosen = list(chosen)
        return self

    def __len__(self):
        return len(self.chosen)

    def __getitem__(self, index):
        if isinstance(self.transform, T.Compose):
            return self.chosen[index], self.transform.transforms[0].duration
        return self.spans[self.chosen[index]], 0


@pytest.fixture
def asked(monkeypatch):
    """What the loader is given: the samples of each length, how often, and the seed."""
    seen = {}

    def loader(samples, batch, team, *, seed, last, whole_batches):
        assert whole_batches
        parts = samples.datasets
        seen.update(
            {part.transform.transforms[0].duration: part.chosen for part in parts}, batch=batch, seed=seed, last=last
        )
        return last * [[part[n] for part in parts for n in range(len(part))]]

    def predict(model, batches, team):
        # right are recordings of even numbers, and all windows of 4 ms
        pairs = [pair for batch in batches for pair in batch]
        right = torch.tensor([number % 2 == 0 or length == 4_000 for number, length in pairs])
        return torch.stack((right, ~right), 1).double(), torch.zeros(len(pairs), dtype=torch.long)

    monkeypatch.setattr(lengths, "loader", loader)
    monkeypatch.setattr(lengths, "predict", predict)
    monkeypatch.setattr(T, "longest_window", lambda transform, sample: sample)
    return seen


TRAINER = SimpleNamespace(model=None, batch=7, seed=3, team=Team(torch.device("cpu")))


def by_length(spans, transform=WINDOW):
    found = lengths.accuracy_by_length(TRAINER, lambda changed: Recordings(spans, changed), transform)
    return {length: of_length.value for length, of_length in found.items()}


def test_lengths_are_from_a_quarter_to_four_times(asked):
    found = by_length([10_000] * 4)
    assert found == {250: 0.5, 500: 0.5, 1_000: 0.5, 2_000: 0.5, 4_000: 1.0}
    # each recording five times, where there are few
    assert (asked["batch"], asked["seed"], asked["last"]) == (7, 3, 5)
    assert asked[250] == asked[4_000] == [0, 1, 2, 3]
    assert by_length([10_000] * 5)[250] == 0.6


@pytest.mark.parametrize(
    ("longest", "expected"),
    [
        (3_999, [250, 500, 1_000, 2_000, 3_999]),
        (2_000, [250, 500, 1_000, 2_000]),
        (1_500, [250, 500, 1_000, 1_500]),
        # no recording has room for the own length, which is kept
        (300, [250, 500, 1_000]),
    ],
)
def test_no_window_is_longer_than_the_longest_recording(asked, longest, expected):
    assert list(by_length([100, longest, 100])) == expected


def test_windows_are_of_at_least_a_microsecond(asked):
    assert list(by_length([10_000], T.Compose([T.RandomWindow(1), T.Points(4)]))) == [1, 2, 4]


def test_eight_recordings_are_measured_evenly(asked):
    # of sixteen every second one: the longest isn't met
    assert list(by_length([1_000, 9_000] * 8))[-1] == 1_000
    assert list(by_length([9_000, 1_000] * 8))[-1] == 4_000
    # of eight all
    assert list(by_length([1_000] * 7 + [9_000]))[-1] == 4_000


@pytest.mark.parametrize(
    ("recordings", "chosen", "draws"), [(199, 199, 5), (250, 250, 4), (251, 251, 4), (999, 999, 2), (1_000, 1_000, 1)]
)
def test_about_a_thousand_windows_are_asked(asked, recordings, chosen, draws):
    by_length([1_000] * recordings)
    assert (len(asked[250]), asked["last"]) == (chosen, draws)


def test_of_many_recordings_a_thousand_are_spread(asked):
    by_length([1_000] * 2_500)
    assert asked["last"] == 1
    assert asked[250] == [n * 2_500 // 1_000 for n in range(1_000)]


def test_without_windows_there_is_nothing_to_tell(asked):
    assert by_length([1_000], T.Compose([T.Points(4)])) == {}
    assert asked == {}


class Classifier(torch.nn.Module):
    """Scores by which class 1 is predicted for values above 40.5."""

    def forward(self, values):
        return torch.stack((torch.full_like(values, 40.5), values), 1)


def by_events(transform, events=(80, 80, 120), trainer=TRAINER):
    """Accuracy by number of events, on recordings of class 1 and 1,000 µs; `events` are their numbers of events."""
    kept = [Events(np.linspace(0, 999, n).astype(int), [0] * n, [0] * n, [1] * n, (2, 1)) for n in events]

    class Listed(Recordings):
        def __getitem__(self, index):
            return self.transform(kept[self.chosen[index]]), 1

    trainer = SimpleNamespace(**vars(trainer) | {"model": Classifier()})
    found = lengths.accuracy_by_events(trainer, lambda changed: Listed(range(len(kept)), changed), transform)
    return {count: of_count.value for count, of_count in found.items()}


def test_windows_have_a_sixteenth_to_all_of_the_usual_events():
    found = by_events(T.Compose([T.RandomWindow(1_000), lambda events: torch.tensor(float(len(events)))]))
    assert found == {5: 0, 10: 0, 20: 0, 40: 0, 80: 1}


def test_windows_have_exactly_so_many_events_and_end_with_them():
    def exact(events):
        rate = (len(events) - 1) * 999 / 79
        return torch.tensor(100.0 * (len(events) in (5, 10, 20, 40, 80) and abs(events.end - rate) <= 1))

    assert by_events(T.Compose([T.RandomWindow(1_000), exact]), events=[80]) == dict.fromkeys((5, 10, 20, 40, 80), 1)


def test_events_of_one_moment_are_counted():
    moment = T.Compose([lambda events: events.of(events.columns._replace(t=events.t * 0)), T.RandomWindow(1_000)])
    counted = T.Compose([*moment.transforms, lambda events: torch.tensor(float(len(events)))])
    assert by_events(counted) == {5: 0, 10: 0, 20: 0, 40: 0, 80: 1}


def test_steps_before_a_window_change_the_usual_number():
    every_other = T.Compose([lambda events: events[::2], T.RandomWindow(1_000)])
    found = by_events(T.Compose([*every_other.transforms, lambda events: torch.tensor(float(len(events)))]))
    assert list(found) == [2, 5, 10, 20, 40]


def test_numbers_of_events_are_the_same_at_every_call():
    pipeline = T.Compose([T.RandomWindow(500), lambda events: torch.tensor(float(len(events)))])
    first = by_events(pipeline, events=range(100, 200))
    torch.manual_seed(1)
    assert by_events(pipeline, events=range(100, 200)) == first


def test_each_window_of_a_sample_is_cut():
    found = by_events(T.Compose([T.RandomWindows(2, 500), lambda parts: torch.tensor(float(sum(map(len, parts))))]))
    # up to 20 and 40 of about 40 events per half
    assert list(found.values()) == [0, 0, 0, 0, 1]


def test_without_windows_no_events_are_counted():
    assert by_events(T.Compose([T.Points(4)])) == {}
