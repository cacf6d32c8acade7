"""The numbers that seeds give, which must be the same on every machine and in every version."""

from __future__ import annotations

import gc
import itertools
import math
from collections import Counter

import numpy as np
import pytest
import torch
import trees
from scipy import stats
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import NMNIST
from nvsdata import transforms as T
from nvsdata.common.memory import SharedArray
from nvsdata.datasets import SeededBatches, SeededDataset
from nvsdata.datasets.order import shuffled
from nvsdata.datasets.seeded import seeded
from nvsdata.datasets.splits import split_hash, stratified


def drawn(*key):
    with seeded(*key):
        return torch.randint(1_000_000, ()).item()


def test_numbers_of_seed_epoch_and_index_are_written_down():
    assert [drawn(*key) for key in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (7, 2**40, 99_999))] == NUMBERS


NUMBERS = [136044, 765154, 326144, 190213, 179008]


def test_an_outer_block_stays_in_force_to_its_end():
    expected = []
    with seeded(3, 0, 0):
        expected = torch.rand(4).tolist()
    with seeded(3, 0, 0):
        found = torch.rand(2).tolist()
        with seeded(4, 5, 6):
            found += torch.rand(1).tolist()
        found += torch.rand(1).tolist()
    assert found == expected
    assert drawn(4, 5, 6) != drawn(3, 0, 0)


def random_number(_):
    return torch.randint(1_000_000, ()).item()


@pytest.fixture
def numbers(home):
    """Makes datasets of 30 samples, each a random number and its label."""
    root = home(trees.nmnist())
    return lambda: NMNIST(root, transform=random_number, seed=5)


def epoch_of(*indices, epoch):
    return [drawn(5, epoch, index) for index in indices]


def one_pass(dataset, order=range(30), batches=None, **options):
    """The numbers of a pass over samples in this order, left after some batches of four."""
    loader = DataLoader(dataset, 4, sampler=list(order), **options)
    return torch.cat([batch for batch, _ in itertools.islice(loader, batches)]).tolist()


def test_epochs_of_a_dataset_are_numbered_from_0(numbers):
    dataset = numbers()
    # a sample that comes again begins the next epoch
    assert [dataset[index][0] for index in (2, -27, -28, 3, 2)] == [
        drawn(5, epoch, index) for epoch, index in ((0, 2), (0, 3), (1, 2), (1, 3), (2, 2))
    ]
    by_key = SeededDataset(NMNIST(dataset.root, transform=dataset.transform))
    assert by_key[4, 7][0] == drawn(0, 4, 7)
    assert len(by_key) == 30


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_each_pass_is_an_epoch_in_any_order(numbers, workers):
    dataset = numbers()
    for epoch in range(3):
        order = np.random.default_rng(epoch).permutation(30).tolist()
        assert one_pass(dataset, order, num_workers=workers) == epoch_of(*order, epoch=epoch)


# a process that is spawned imports torch first: fewer of those
@pytest.mark.parametrize(("context", "workers", "passes"), [("fork", 2, (2, 1, None)), ("spawn", 1, (1, None))])
def test_a_pass_that_was_left_early_is_an_epoch_of_workers(numbers, context, workers, passes):
    dataset = numbers()
    options = {"num_workers": workers, "multiprocessing_context": context}
    for epoch, batches in enumerate(passes):
        order = range(30)[:: 1 if epoch % 2 else -1]
        found = one_pass(dataset, order, batches, **options)
        assert found == epoch_of(*order, epoch=epoch)[: len(found)]


def test_samples_that_a_pass_leaves_out_are_drawn_for_the_next_one(numbers):
    dataset = numbers()
    assert one_pass(dataset, range(20), num_workers=2) == epoch_of(*range(20), epoch=0)
    assert one_pass(dataset, range(10, 30), num_workers=2) == epoch_of(*range(10, 30), epoch=1)


def test_persistent_workers_count_complete_passes_and_hear_of_set_epoch(numbers):
    dataset = numbers()
    loader = DataLoader(dataset, 4, num_workers=2, persistent_workers=True)
    for epoch in (0, 1):
        assert torch.cat([batch for batch, _ in loader]).tolist() == epoch_of(*range(30), epoch=epoch)
    for epoch in (7, 3, 3):
        dataset.set_epoch(epoch)
        assert torch.cat([batch for batch, _ in loader]).tolist() == epoch_of(*range(30), epoch=epoch)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_restart_continues_at_the_epoch_that_is_set(numbers, workers):
    dataset = numbers()
    # left early, and samples that come twice: nothing is counted
    for epoch, batches in ((3, 2), (4, None)):
        dataset.set_epoch(epoch)
        order = [*range(30), 1, 1]
        found = one_pass(dataset, order, batches, num_workers=workers)
        assert found == epoch_of(*order, epoch=epoch)[: len(found)]


def test_two_loaders_read_at_once_have_an_epoch_each(numbers):
    dataset = numbers()
    both = [DataLoader(dataset, 4, num_workers=1), DataLoader(dataset, 4, num_workers=1)]
    pairs = list(zip(*both, strict=True))
    found = [torch.cat([batch for batch, _ in side]).tolist() for side in zip(*pairs, strict=True)]
    assert sorted(found) == sorted(epoch_of(*range(30), epoch=epoch) for epoch in (0, 1))


def test_an_epoch_is_set_for_a_cache_too_and_is_no_negative_number(numbers, tmp_path):
    dataset = numbers()
    dataset.transform = T.Compose([T.Window(0, 10), random_number])
    cached = nvsdata.cache(dataset, tmp_path)
    cached.set_epoch(9)
    assert cached[4][0] == cached[4][0] == drawn(5, 9, 4)
    with pytest.raises(ValueError, match="epoch must be at least 0, not -1"):
        dataset.set_epoch(-1)
    NMNIST(dataset.root).set_epoch(3)


def test_orders_of_epochs_are_written_down():
    assert list(SeededBatches(5, 2)) == [[(0, 0), (0, 1)], [(0, 2), (0, 3)], [(0, 4)]]
    assert (
        list(SeededBatches(6, 9, shuffle=True))
        == list(SeededBatches(6, 9, shuffle=True, seed=0))
        != [[(0, index) for index in range(6)]]
    )
    given = SeededBatches(6, 4, first=1, last=3, shuffle=True, seed=2)
    assert list(given) == ORDERS
    assert list(SeededBatches(6, 4, first=1, last=3, shuffle=True, seed=2, part=(1, 2))) == [
        batch[len(batch) // 2 :] for batch in ORDERS
    ]


ORDERS = [[(1, 4), (1, 0), (1, 2), (1, 3)], [(1, 1), (1, 5)], [(2, 5), (2, 4), (2, 1), (2, 2)], [(2, 3), (2, 0)]]


@pytest.mark.parametrize("size", range(8))
@pytest.mark.parametrize("batch_size", [1, 2, 3, 5])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_as_many_batches_as_are_told_and_each_sample_once(size, batch_size, count):
    settings = {"last": 2, "remainder": "keep"}
    parts = [SeededBatches(size, batch_size, part=(rank, count), **settings) for rank in range(count)]
    for part in parts:
        assert len(list(part)) == len(part) == 2 * part.steps
        assert all(batch for batch in part)
    keys = sorted(key for part in parts for batch in part for key in batch)
    assert keys == [(epoch, index) for epoch in (0, 1) for index in range(size)]


@pytest.mark.parametrize("size", range(1, 14))
@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("shuffle", [True, False])
def test_processes_have_equal_steps(size, count, shuffle):
    def of_all(remainder):
        settings = {"last": 2, "shuffle": shuffle, "seed": 3, "remainder": remainder}
        parts = [list(SeededBatches(size, 2 * count, part=(rank, count), **settings)) for rank in range(count)]
        assert len({len(part) for part in parts}) == 1
        return [[key for part in step for key in part] for step in zip(*parts, strict=True)]

    alone = list(SeededBatches(size, 2 * count, last=2, shuffle=shuffle, seed=3))
    for padded, batch in zip(of_all("pad"), alone, strict=True):
        assert padded[: len(batch)] == batch
        assert len(padded) == -(-len(batch) // count) * count
        # the beginning of the epoch fills the rest
        epoch = [key for other in alone for key in other if key[0] == batch[0][0]]
        assert padded[len(batch) :] == [epoch[n % size] for n in range(len(padded) - len(batch))]
    assert of_all("drop") == [batch for batch in alone if len(batch) == 2 * count]


def test_a_run_continues_at_any_step():
    settings = {"last": 3, "shuffle": True, "seed": 4}
    whole = list(SeededBatches(50, 8, **settings))
    assert whole[7 + 3 :] == list(SeededBatches(50, 8, first=1, start=3, **settings))
    for done in range(8):
        rest = SeededBatches(50, 8, start=done, **settings)
        assert list(rest) == whole[done:]
        assert len(rest) == len(whole) - done
    # by other numbers of processes
    for count in (2, 4):
        parts = [SeededBatches(50, 8, first=2, start=5, part=(rank, count), **settings) for rank in range(count)]
        joined = [[key for part in step for key in part] for step in zip(*parts, strict=True)]
        assert [step[: len(batch)] for step, batch in zip(joined, whole[19:], strict=True)] == whole[19:]


def test_a_billion_samples_have_an_order():
    batches = SeededBatches(10**9, 64, shuffle=True, seed=1)
    found = [index for step in (0, 1, 10**6, batches.steps - 1) for _, index in batches.batch(0, step)]
    assert len(set(found)) == len(found) == 64 * 4
    assert max(found) > 9e8
    assert min(found) < 1e8


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 10, 101, 1_024, 1_025, 1_089, 4_097])
def test_an_order_has_each_index_once(size):
    orders = {tuple(shuffled(np.arange(size), size, seed, epoch)) for seed in range(3) for epoch in range(3)}
    assert all(sorted(order) == list(range(size)) for order in orders)
    if size > 9:
        assert len(orders) == 9


@pytest.mark.parametrize("size", [3, 4, 5, 6])
def test_orders_of_few_elements_are_uniform(size):
    trials = 100 * math.factorial(size)
    counts = Counter(tuple(shuffled(np.arange(size), size, seed, 0).tolist()) for seed in range(trials))
    assert len(counts) == math.factorial(size)
    assert stats.chisquare(list(counts.values())).pvalue > 1e-3


@pytest.mark.parametrize("size", [10, 33, 1_100])
def test_pairs_of_an_order_are_uniform(size):
    # the two first elements, in 5 x 5 classes
    pairs = np.array([shuffled(np.arange(2), size, seed, 3) for seed in range(5_000)])
    classes = np.arange(size) % 5
    expected = np.zeros((5, 5))
    for one in range(size):
        for other in range(size):
            expected[classes[one], classes[other]] += one != other
    counts = np.zeros((5, 5))
    np.add.at(counts, (classes[pairs[:, 0]], classes[pairs[:, 1]]), 1)
    expected *= counts.sum() / expected.sum()
    assert stats.chisquare(counts.ravel(), expected.ravel()).pvalue > 1e-3


@pytest.mark.parametrize("size", [1_000, 20_000])
def test_orders_have_no_pattern(size):
    order = shuffled(np.arange(size), size, 0, 0)
    others = [shuffled(np.arange(size), size, 1, 0), shuffled(np.arange(size), size, 0, 1), np.arange(size)]
    near = 4 / math.sqrt(size)
    assert abs(np.corrcoef(order[1:], order[:-1])[0, 1]) < near
    for other in others:
        assert abs(np.corrcoef(order, other)[0, 1]) < near
        # as many places have the same index as by chance, about one
        assert (order == other).sum() < 8


def test_numbers_of_any_integer_type_give_the_same_batches():
    given = SeededBatches(9, 4, seed=3, first=2, last=3, shuffle=True)
    numbers = {"seed": np.int64(3), "first": np.uint8(2), "last": np.int16(3)}
    assert list(SeededBatches(np.uint8(9), np.int32(4), shuffle=True, **numbers)) == list(given)
    assert given.batch(np.int64(2), 1) == list(given)[1]
    large = SeededBatches(9, 4, seed=-(2**70), shuffle=True)
    assert sorted(at for batch in large for _, at in batch) == list(range(9))
    for wrong in ({"seed": 1.5}, {"size": 5.0}, {"part": (0.0, 1.0)}):
        with pytest.raises(TypeError):
            SeededBatches(**{"size": 10, "batch_size": 4} | wrong)
    for step in (-1, 3):
        with pytest.raises(IndexError, match=f"step {step} of an epoch of 3 steps"):
            given.batch(2, step)


def test_the_end_of_an_epoch_is_a_start_for_every_process():
    parts = [SeededBatches(5, 4, last=2, start=2, part=(rank, 3), remainder="keep") for rank in range(3)]
    assert [list(part) for part in parts] == [[[(1, 0), (1, 1)], [(1, 4)]], [[(1, 2)]], [[(1, 3)]]]
    assert [len(part) for part in parts] == [2, 1, 1]
    assert len(SeededBatches(5, 4, first=1, last=1, start=1)) == len(SeededBatches(5, 4, first=2, last=1)) == 0


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"batch_size": 0}, "batch_size must be a whole number of at least 1"),
        ({"start": 4}, "start must be at most 3, the steps of an epoch, not 4"),
        ({"part": (2, 2)}, r"part must be \(rank, count\) with rank < count"),
        ({"part": (0, 3)}, "3 processes can't have equal parts of a batch of 4"),
        ({"remainder": "wrap"}, "remainder must be one of"),
        ({"size": 2**62}, "size must be less than"),
    ],
)
def test_batches_out_of_range(settings, reason):
    with pytest.raises(ValueError, match=reason):
        SeededBatches(**{"size": 10, "batch_size": 4} | settings)


@pytest.mark.parametrize("kind", [np.uint8, np.int64])
def test_shared_numbers_begin_with_0(kind):
    assert SharedArray(0, kind).values.tolist() == []
    assert SharedArray(5, kind).values.tolist() == [0] * 5


def test_a_fifth_is_for_testing_unless_told_otherwise():
    found = [(str(i % 2), f"{i:05d}") for i in range(20)]
    assert stratified(found) == stratified(found, 0.2, 0)
    assert len(stratified(found)[1]) == 4
    # halves are rounded up
    assert [len(stratified(found[::2][:n], 0.5)[1]) for n in range(5)] == [0, 1, 1, 2, 2]
    for share in (0, 1, -0.5, 1.5):
        with pytest.raises(ValueError, match=f"test must be between 0 and 1, not {share}"):
            stratified(found, share)


def test_the_digest_of_a_split_is_written_down():
    samples = [("a", "1", 0), ("a", "2", 0), ("b", "1", 1)]
    assert split_hash(samples) == split_hash(samples[::-1]) == DIGEST
    assert len({split_hash(samples[:n]) for n in range(4)} | {split_hash([("a", "1", 1)])}) == 5


DIGEST = "e9e4b836a6b8bd20"


@pytest.mark.parametrize("on", [True, False])
def test_garbage_is_collected_as_before(home, on):
    root = home(trees.nmnist())
    was_on = gc.isenabled()
    try:
        (gc.enable if on else gc.disable)()
        NMNIST(root)
        assert gc.isenabled() == on
        with pytest.raises(FileNotFoundError):
            NMNIST(root / "Train" / "3")
        assert gc.isenabled() == on
    finally:
        (gc.enable if was_on else gc.disable)()
