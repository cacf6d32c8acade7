"""The numbers that seeds give, which must be the same on every machine and in every version."""

from __future__ import annotations

import gc

import numpy as np
import pytest
import torch
import trees

from nvsdata import NMNIST
from nvsdata.datasets import SeededBatches, SeededDataset
from nvsdata.datasets.seeded import Passes, seeded
from nvsdata.datasets.shared import Shared
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


def test_passes_count_each_sample_by_itself():
    passes = Passes(3)
    assert [passes.next(index) for index in (1, 1, 0, 1, 2, 0)] == [0, 1, 0, 2, 0, 1]


def test_epochs_of_a_dataset_are_numbered_from_0(home):
    dataset = NMNIST(home(trees.nmnist()), transform=lambda _: torch.randint(1_000_000, ()).item(), seed=5)
    assert [dataset[2][0], dataset[-28][0], dataset[2][0], dataset[3][0]] == [
        drawn(5, epoch, index) for epoch, index in ((0, 2), (1, 2), (2, 2), (0, 3))
    ]
    by_key = SeededDataset(NMNIST(dataset.root, transform=dataset.transform))
    assert by_key[4, 7][0] == drawn(0, 4, 7)
    assert len(by_key) == 30


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


ORDERS = [[(1, 2), (1, 1), (1, 0), (1, 5)], [(1, 4), (1, 3)], [(2, 3), (2, 5), (2, 4), (2, 2)], [(2, 1), (2, 0)]]


@pytest.mark.parametrize("size", range(8))
@pytest.mark.parametrize("batch_size", [1, 2, 3, 5])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_as_many_batches_as_are_told_and_each_sample_once(size, batch_size, count):
    parts = [SeededBatches(size, batch_size, last=2, part=(rank, count)) for rank in range(count)]
    for part in parts:
        assert len(list(part)) == len(part) == 2 * part.batches
        assert all(batch for batch in part)
    keys = sorted(key for part in parts for batch in part for key in batch)
    assert keys == [(epoch, index) for epoch in (0, 1) for index in range(size)]


@pytest.mark.parametrize("kind", [np.uint8, np.int64])
def test_shared_numbers_begin_with_0(kind):
    assert Shared(0, kind).values.tolist() == []
    assert Shared(5, kind).values.tolist() == [0] * 5


def test_a_fifth_is_for_testing_unless_told_otherwise():
    found = [(str(i % 2), f"{i:05d}") for i in range(20)]
    assert stratified(found) == stratified(found, 0.2, 0)
    assert len(stratified(found)[1]) == 4
    # halves are rounded up
    assert [len(stratified(found[::2][:n], 0.5)[1]) for n in range(5)] == [0, 1, 1, 2, 2]
    for share in (0, 1, -0.5, 1.5):
        with pytest.raises(ValueError, match=f"test must lie between 0 and 1, not {share}"):
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
