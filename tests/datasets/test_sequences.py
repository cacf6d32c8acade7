"""Batches of consecutive windows, and a network that carries its state through them."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
import torch
import trees
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import DVS128Gesture, EventFolder, Events, SeededDataset, SequenceBatches
from nvsdata import transforms as T
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.order import random_below, shuffled
from nvsdata.datasets.seeded import SequenceKey, seeded
from nvsdata.datasets.sequences import window_counts

sizes = st.lists(st.integers(1, 12), min_size=1, max_size=12)


def first(key):
    return key.valid and key.window == key.start


def by_row(batches):
    return [list(row) for row in zip(*batches, strict=True)]


def slow_rows(windows, rows):
    """The windows of each row, and where they begin: the longest recording that is left goes to the shortest row."""
    begins = [sum(windows[:n]) for n in range(len(windows))]
    left, chosen = list(range(len(windows))), [[] for _ in range(rows)]
    while left:
        longest = max(left, key=lambda n: (windows[n], -n))
        shortest = min(range(rows), key=lambda row: (sum(windows[n] for n in chosen[row]), row))
        chosen[shortest].append(longest)
        left.remove(longest)
    chosen = sorted(sorted(row) for row in chosen)
    return [[(begins[n] + k, k == 0) for n in row for k in range(windows[n])] for row in chosen]


@given(windows=sizes, data=st.data())
def test_rows_are_those_of_the_slow_reference(windows, data):
    rows = data.draw(st.integers(1, len(windows)))
    expected = slow_rows(windows, rows)
    steps = max(map(len, expected))
    found = by_row(SequenceBatches(windows, rows))
    for keys, row in zip(found, expected, strict=True):
        assert [(key.window, first(key)) for key in keys] == row + [(row[-1][0], False)] * (steps - len(row))
        assert [key.valid for key in keys] == [True] * len(row) + [False] * (steps - len(row))


@given(windows=sizes, seed=st.integers(-5, 2**70), epoch=st.integers(0, 2**40), data=st.data())
def test_each_window_is_in_one_batch_and_follows_the_one_before(windows, seed, epoch, data):
    rows = data.draw(st.integers(1, len(windows)))
    begins = set(np.cumsum([0, *windows]).tolist())
    batches = SequenceBatches(windows, rows, shuffle=True, seed=seed, first=epoch, last=epoch + 1)
    found = by_row(batches)
    assert sorted(key.window for row in found for key in row if key.valid) == list(range(sum(windows)))
    assert {key.epoch for row in found for key in row} == {epoch}
    for row in found:
        assert len(row) == batches.steps == len(batches)
        assert first(row[0])
        for before, key in itertools.pairwise(row):
            assert first(key) == (key.valid and key.window in begins)
            if not key.valid:
                assert key.window == before.window
            elif not first(key):
                assert before.valid
                assert (key.window, key.start) == (before.window + 1, before.start)
    assert any(row[-1].valid for row in found)
    valid = [sum(key.valid for key in row) for row in found]
    assert max(valid) - min(valid) <= max(windows)


@given(windows=sizes, length=st.integers(1, 7), seed=st.integers(0, 9), shuffle=st.booleans(), data=st.data())
def test_random_sequences_have_equal_length_and_lie_in_one_recording(windows, length, seed, shuffle, data):
    number = [max(n // length, 1) for n in windows]
    rows = data.draw(st.integers(1, sum(number)))
    batches = SequenceBatches(windows, rows, length=length, shuffle=shuffle, seed=seed)
    assert batches.steps == length * -(-sum(number) // rows)
    recording = np.repeat(np.arange(len(windows)), windows)
    begins = np.cumsum(windows) - windows
    counts, seen = Counter(), []
    for row in by_row(batches):
        for sequence in (row[at : at + length] for at in range(0, len(row), length)):
            if not any(key.valid for key in sequence):
                continue
            assert [first(key) for key in sequence] == [True] + [False] * (length - 1)
            of = recording[sequence[0].window]
            real = min(length, windows[of])
            assert [key.valid for key in sequence] == [True] * real + [False] * (length - real)
            start = sequence[0].window
            assert [key.window for key in sequence] == [start + min(k, real - 1) for k in range(length)]
            assert recording[start + real - 1] == of
            if not shuffle:
                assert (start - begins[of]) % length == 0
            counts[int(of)] += 1
            seen += range(start, start + real)
    assert len(set(seen)) == len(seen)
    assert counts == dict(enumerate(number))


def test_random_sequences_begin_anywhere():
    begins = Counter()
    for keys in SequenceBatches([11], 1, length=4, shuffle=True, last=400):
        begins[keys[0].start] += first(keys[0])
    assert sorted(begins) == list(range(8))
    assert min(begins.values()) > 60


def test_orders_are_written_down():
    given = SequenceBatches([3, 5, 2, 2], 2, shuffle=True, seed=2, first=1, last=3)
    assert [[key.window if key.valid else None for key in row] for row in by_row(given)] == ORDERS
    cut = SequenceBatches(np.array([3, 9, 1], np.int32), np.int8(2), length=np.int64(2), shuffle=True, seed=3)
    assert [[key.window if key.valid else None for key in row] for row in by_row(cut)] == RANDOM


ORDERS = [[0, 1, 2, 8, 9, None, None, 3, 4, 5, 6, 7, 10, 11], [10, 11, 3, 4, 5, 6, 7, 8, 9, 0, 1, 2, None, None]]
RANDOM = [[9, 10, 7, 8, 12, None], [5, 6, 3, 4, 1, 2]]


@pytest.mark.parametrize("length", [None, 3])
def test_epochs_differ_and_have_equal_steps(length):
    settings = {"length": length, "shuffle": True, "seed": 1}
    epochs = [list(SequenceBatches(range(1, 30), 4, first=n, last=n + 1, **settings)) for n in range(4)]
    assert list(SequenceBatches(range(1, 30), 4, last=4, **settings)) == list(itertools.chain(*epochs))
    assert {len(epoch) for epoch in epochs} == {SequenceBatches(range(1, 30), 4, **settings).steps}
    assert len({tuple(key[1:] for batch in epoch for key in batch) for epoch in epochs}) == 4
    other = SequenceBatches(range(1, 30), 4, length=length, shuffle=True, seed=2)
    assert list(other) != epochs[0]


@pytest.mark.parametrize("length", [None, 4])
def test_a_run_continues_at_any_step(length):
    windows, settings = [7, 3, 9, 1, 4, 4, 12], {"length": length, "shuffle": True, "seed": 4, "last": 3}
    whole = list(SequenceBatches(windows, 3, **settings))
    steps = SequenceBatches(windows, 3, **settings).steps
    assert len(whole) == 3 * steps
    for done in range(2 * steps):
        rest = SequenceBatches(windows, 3, first=done // steps, start=done % steps, **settings)
        assert len(rest) == len(whole) - done
        assert list(rest) == whole[done:]
        assert rest.batch(*divmod(done, steps)) == whole[done]
        stopped = SequenceBatches(windows, 3, **settings)
        assert list(itertools.islice(stopped, done)) == whole[:done]
        resumed = SequenceBatches(windows, 3, **settings)
        resumed.load_state_dict(stopped.state_dict())
        assert list(resumed) == whole[done:]


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("length", [None, 2])
def test_processes_divide_the_rows(count, length):
    settings = {"length": length, "shuffle": True, "seed": 4, "last": 2}
    windows = [7, 3, 9, 1, 4, 4, 12, 30]
    parts = [list(SequenceBatches(windows, 6, part=(rank, count), **settings)) for rank in range(count)]
    joined = [list(itertools.chain(*step)) for step in zip(*parts, strict=True)]
    assert joined == list(SequenceBatches(windows, 6, **settings))


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"batch_size": 4}, "batch_size must be at most 3, the number of sequences, not 4"),
        ({"batch_size": 5, "length": 4}, "batch_size must be at most 4, the number of sequences, not 5"),
        ({"windows": []}, "batch_size must be at most 0"),
        ({"windows": [3, 0, 2]}, "recording 1 has 0 windows"),
        ({"length": 0}, "length must be a whole number of at least 1"),
        ({"batch_size": 0}, "batch_size must be a whole number of at least 1"),
        ({"start": 11}, "start must be at most 10, the steps of an epoch, not 11"),
        ({"batch_size": 3, "part": (0, 2)}, "2 processes can't have equal parts of a batch of 3"),
        ({"part": (2, 2)}, r"part must be \(rank, count\) with rank < count"),
    ],
)
def test_settings_out_of_range(settings, reason):
    with pytest.raises(ValueError, match=reason):
        SequenceBatches(**{"windows": [8, 3, 7], "batch_size": 2} | settings)


def test_memory_depends_on_the_number_of_recordings():
    batches = SequenceBatches([10**14, 10**15, 3], 2, start=10**15 - 1)
    last, third = 10**14 + 10**15 - 1, 10**14 + 10**15
    assert list(batches) == [[SequenceKey(0, third + 2, third, False), SequenceKey(0, last, 10**14, True)]]


def test_random_numbers_are_uniform_and_independent_of_the_order():
    bounds = np.full(2_000, 7)
    numbers = random_below(bounds, 3, 4)
    assert stats.chisquare(np.bincount(numbers, minlength=7)).pvalue > 1e-3
    assert (random_below(bounds, 3, 5) != numbers).any()
    large = random_below(np.full(1_000, 10**9), 0, 0)
    assert abs(stats.spearmanr(large, np.argsort(shuffled(np.arange(1_000), 1_000, 0, 0)))[0]) < 0.15
    assert random_below(np.array([1, 2, 3, 10**6]), 0, 0).tolist() == BELOW


BELOW = [0, 0, 1, 444078]

COUNTS = {"a/0": 5, "a/1": 2, "b/0": 7, "b/1": 1, "b/2": 4}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Recordings with these numbers of windows of 1,000 µs."""
    root = tmp_path_factory.mktemp("sequences")
    for seed, (name, count) in enumerate(COUNTS.items()):
        random = np.random.default_rng(seed)
        t = np.sort(random.integers(0, 1_000 * count, 40 * count))
        t[0], t[-1] = 0, 1_000 * count - 1
        (root / name).parent.mkdir(exist_ok=True)
        columns = (random.integers(0, size, t.size) for size in (20, 10, 2))
        nvsdata.write(Events(t, *columns, (20, 10)), root / f"{name}.npy")
    return root


def windows_of(folder, transform=None):
    return nvsdata.windows(EventFolder(folder, transform=transform), 1_000)


def test_windows_of_each_recording_are_counted(folder):
    every = windows_of(folder)
    assert every.windows_per_recording().tolist() == list(COUNTS.values())
    assert every[::2].windows_per_recording().tolist() == [3, 1, 3, 1, 2]
    # windows that touch, and others at the most common distance
    assert every.subset([7, 8, 10, 12]).windows_per_recording().tolist() == [4]
    assert every[2:9].windows_per_recording().tolist() == [3, 2, 2]
    assert every.subset([3, 4, 0, 1, 1]).windows_per_recording().tolist() == [2, 2, 1]
    half = nvsdata.windows(EventFolder(folder), events=40, step=20)
    assert half.windows_per_recording().tolist() == [2 * count for count in COUNTS.values()]
    with pytest.raises(TypeError, match=r"the samples aren't windows: nvsdata.windows makes"):
        EventFolder(folder).windows_per_recording()


def test_a_short_window_is_the_last_of_its_part():
    parts = [(0, 10), (100, 110), (200, 205), (300, 310), (400, 410)]
    assert window_counts([Sample("a", 0, window) for window in parts]).tolist() == [3, 2]


def test_windows_of_events_at_one_time_are_counted(tmp_path):
    (tmp_path / "a").mkdir()
    for name in "xy":
        nvsdata.write(Events(np.full(10, 5), *np.zeros((3, 10), int), (2, 2)), tmp_path / f"a/{name}.npy")
    assert nvsdata.windows(EventFolder(tmp_path), events=2).windows_per_recording().tolist() == [5, 5]


def test_labeled_parts_are_counted_as_recordings(home):
    gestures = DVS128Gesture(home(trees.dvs128gesture()))
    each = [len(nvsdata.windows(gestures.subset([part]), 7_000)) for part in range(len(gestures))]
    assert len({sample.name for sample in gestures.samples}) < len(each)
    assert nvsdata.windows(gestures, 7_000).windows_per_recording().tolist() == each
    # as many with time between the windows
    assert nvsdata.windows(gestures, 2_000, step=7_000).windows_per_recording().tolist() == each
    for way in ({"duration": 9_000, "step": 2_000}, {"events": 30}, {"events": 30, "step": 9}):
        each = [len(nvsdata.windows(gestures.subset([part]), **way)) for part in range(len(gestures))]
        assert nvsdata.windows(gestures, **way).windows_per_recording().tolist() == each


def test_precomputed_windows_are_counted(folder, tmp_path):
    every = windows_of(folder, T.EventImage())
    nvsdata.precompute(every, tmp_path / "images.nvs")
    stored = nvsdata.Precomputed(tmp_path / "images.nvs")
    assert stored.windows_per_recording().tolist() == list(COUNTS.values())


def batches(folder, transform, workers, collate=nvsdata.collate, **settings):
    every = windows_of(folder, transform)
    order = SequenceBatches(every.windows_per_recording(), 2, shuffle=True, seed=1, last=2, **settings)
    data = SeededDataset(every, seed=5)
    return DataLoader(data, batch_sampler=order, collate_fn=collate, num_workers=workers)


def plain(events):
    return [[column.tolist() for column in one.columns] for one in events]


@pytest.mark.parametrize("length", [None, 3])
def test_workers_change_nothing(folder, length):
    def found(workers):
        loader = batches(folder, T.RandomWindow(500), workers, length=length)
        return [(plain(events), *(column.tolist() for column in others)) for events, *others in loader]

    alone = found(0)
    assert found(1) == found(3) == alone
    assert {len(events) for events, *_ in alone} == {2}
    assert any(not all(valid) for *_, valid in alone)


def random_number(_):
    return torch.randint(1_000_000, ()).item()


def test_random_numbers_are_the_same_in_all_windows_of_a_sequence(folder):
    loader = batches(folder, random_number, 0)
    keys = [key for batch in loader.batch_sampler for key in batch]
    expected = {}
    for key in keys:
        with seeded(5, key.epoch, key.start):
            expected[key.epoch, key.start] = torch.randint(1_000_000, ()).item()
    assert len(set(expected.values())) == 2 * len(COUNTS)
    found = torch.cat([numbers for numbers, *_ in loader]).tolist()
    assert found == [expected[key.epoch, key.start] for key in keys]


@pytest.mark.parametrize("collate", [nvsdata.collate, None])
@pytest.mark.parametrize("workers", [0, 1])
def test_graphs_keep_the_flags(folder, collate, workers):
    transform = T.RadiusGraph()
    # recordings of one and two windows are padded
    loader = batches(folder, transform, workers, collate, length=3)
    for keys, (graphs, targets, starts, valid) in zip(loader.batch_sampler, loader, strict=True):
        samples = [loader.dataset.dataset[key.window] for key in keys]
        expected, labels = nvsdata.collate(samples)
        assert torch.equal(graphs.pos, expected.pos)
        assert torch.equal(graphs.edge_index, expected.edge_index)
        assert targets.tolist() == labels.tolist()
        assert (starts.dtype, valid.dtype) == (torch.bool, torch.bool)
        assert starts.tolist() == [first(key) for key in keys]
        assert valid.tolist() == [key.valid for key in keys]


def test_boxes_stay_a_list_next_to_the_flags():
    boxes = [{"boxes": torch.zeros(n, 4)} for n in (1, 3)]
    batch = nvsdata.collate([(torch.zeros(2), target, n == 0, True) for n, target in enumerate(boxes)])
    assert batch.targets == boxes
    assert (batch.first.tolist(), batch.valid.tolist()) == ([True, False], [True, True])


@pytest.mark.parametrize(("workers", "stop"), [(0, 1), (2, 7)])
def test_a_stateful_loader_continues(folder, workers, stop):
    stateful = pytest.importorskip("torchdata.stateful_dataloader").StatefulDataLoader

    def loader():
        given = batches(folder, random_number, 0)
        return stateful(
            given.dataset, batch_sampler=given.batch_sampler, collate_fn=nvsdata.collate, num_workers=workers
        )

    def read(given, count=None):
        return [[column.tolist() for column in batch] for batch in itertools.islice(given, count)]

    whole, stopped = read(loader()), loader()
    assert read(iter(stopped), stop) == whole[:stop]
    again = loader()
    again.load_state_dict(stopped.state_dict())
    assert read(again) == whole[stop:]


class Recurrent(torch.nn.Module):
    """A GRU cell over images, whose state is reset where a sequence begins."""

    def __init__(self):
        super().__init__()
        self.cell, self.out = torch.nn.GRUCell(400, 8), torch.nn.Linear(8, 2)

    def forward(self, images, first, state):
        state = torch.where(first[:, None], 0.0, state)
        return self.cell(images.flatten(1).double(), state)


@pytest.mark.parametrize("workers", [0, 1])
def test_the_carried_state_is_that_of_each_recording_alone(folder, workers):
    torch.manual_seed(0)
    network = Recurrent().double()
    every = windows_of(folder, T.EventImage())
    alone = []
    with torch.no_grad():
        for count in COUNTS.values():
            state = torch.zeros(1, 8, dtype=torch.float64)
            for _ in range(count):
                state = network(every[len(alone)][0][None], torch.tensor([False]), state)
                alone.append(state[0])
        loader = batches(folder, T.EventImage(), workers)
        state = torch.full((2, 8), float("nan"), dtype=torch.float64)
        seen = []
        for keys, (images, _, starts, valid) in zip(loader.batch_sampler, loader, strict=True):
            state = network(images, starts, state)
            for row in range(2):
                if valid[row]:
                    torch.testing.assert_close(state[row], alone[keys[row].window], rtol=1e-12, atol=1e-12)
                    seen.append((keys[row].epoch, keys[row].window))
    assert sorted(seen) == [(epoch, window) for epoch in (0, 1) for window in range(sum(COUNTS.values()))]


def trained(folder, done=None, saved=None):
    """Parameters after training by truncated backpropagation, and what a run of a given number of steps saves."""
    torch.manual_seed(0)
    network = Recurrent().double()
    optimizer = torch.optim.SGD(network.parameters(), 0.1)
    state, start = torch.zeros(2, 8, dtype=torch.float64), 0
    if saved is not None:
        start, weights, state = saved
        network.load_state_dict(weights)
    loader = batches(folder, T.Compose([T.EventImage(), T.RandomFlip()]), 0)
    order = loader.batch_sampler
    order.load_state_dict(dict(zip(("epoch", "step"), divmod(start, order.steps), strict=True)))
    for images, targets, starts, valid in itertools.islice(loader, done):
        state = network(images, starts, state.detach())
        optimizer.zero_grad()
        torch.nn.functional.cross_entropy(network.out(state)[valid], targets[valid]).backward()
        optimizer.step()
    return network.state_dict(), state.detach()


@pytest.mark.parametrize("done", [1, 8, 13])
def test_a_training_with_carried_state_continues_bit_identically(folder, done):
    expected, last = trained(folder)
    weights, state = trained(folder, done)
    found, again = trained(folder, None, (done, weights, state))
    assert torch.equal(last, again)
    assert all(torch.equal(found[name], expected[name]) for name in expected)


def test_no_samples_are_no_recordings():
    assert window_counts([]).tolist() == []
