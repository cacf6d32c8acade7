"""Orders by blocks of a store: complete, reproducible, mixed, and near on the disk."""

from itertools import chain

import numpy as np
import pytest
import trees

import nvsdata
from nvsdata import EventFolder, Precomputed, SeededBatches
from nvsdata import transforms as T
from nvsdata.datasets.sample_blocks import AT_ONCE, SampleBlocks


def blocks_of_sizes(sizes, at_once=10):
    count = int(np.sum(sizes))
    return SampleBlocks(np.random.default_rng(1).permutation(count), np.cumsum(sizes), at_once)


@pytest.mark.parametrize("sizes", [[1], [5], [3] * 9, [3] * 20, [1, 900, 2, 40, 7] * 9, [20] * 200])
def test_an_epoch_has_every_sample_once(sizes):
    blocks = blocks_of_sizes(sizes)
    count = blocks.order.size
    orders = [blocks.shuffled(np.arange(count), seed, epoch)[0].tolist() for seed, epoch in ((0, 0), (0, 1), (1, 0))]
    for order in orders:
        assert sorted(order) == list(range(count))
    if count > 20:
        assert len({tuple(order) for order in orders}) == 3
    # the same at any positions
    some = np.random.default_rng(0).integers(0, count, 30)
    assert blocks.shuffled(some, 0, 1)[0].tolist() == [orders[1][position] for position in some]


@pytest.mark.parametrize(("count", "at_once"), [(203, 10), (1_301, AT_ONCE)])
def test_so_many_blocks_are_mixed_and_each_is_read_once(count, at_once):
    sizes = np.random.default_rng(0).integers(5, 15, count)
    blocks = blocks_of_sizes(sizes, at_once)
    block_of = np.empty(blocks.order.size, np.int64)
    block_of[blocks.order] = np.repeat(np.arange(sizes.size), sizes)
    order = block_of[blocks.shuffled(np.arange(block_of.size), 3, 5)[0]]
    first = [int(np.flatnonzero(order == block)[0]) for block in range(sizes.size)]
    last = [int(np.flatnonzero(order == block)[-1]) for block in range(sizes.size)]
    for begin, end in zip(first, last, strict=True):
        # between the first and the last sample of a block are only those of its group
        assert np.unique(order[begin : end + 1]).size < 2 * at_once
    # as many samples as a group has are of at least half of its blocks
    group = 10 * at_once
    assert min(np.unique(order[at : at + group]).size for at in range(0, order.size - group, 50)) >= at_once
    # neighbors are seldom of the same block
    assert (order[1:] == order[:-1]).mean() < 0.2


def test_each_group_is_like_the_entire_store():
    # 53 blocks, sorted by class: the first half of the samples is of one class, the last tenth of another
    blocks = SampleBlocks(np.arange(5_300), np.arange(100, 5_301, 100), at_once=10)
    classes = np.digitize(np.arange(5_300), (2_650, 4_770))
    for epoch in range(20):
        order = classes[blocks.shuffled(np.arange(5_300), 0, epoch)[0]]
        # a group has 10 or 11 blocks
        shares = np.array([np.bincount(order[at : at + 1_000], minlength=3) for at in range(0, 4_301, 100)]) / 1_000
        assert abs(shares - (0.5, 0.4, 0.1)).max() < 0.2
        # each part has an order of its own
        parts = blocks._groups(0, epoch)[:50].reshape(10, 5)
        assert len({tuple(part) for part in parts.tolist()}) > 5
        # and other blocks in each epoch
        assert order[:1_000].tolist() != classes[blocks.shuffled(np.arange(1_000), 0, epoch + 1)[0]].tolist()


def test_a_few_blocks_are_a_uniform_order():
    blocks = SampleBlocks(np.arange(2_000), np.array([500, 1_000, 1_500, 2_000]))
    places = np.stack([np.argsort(blocks.shuffled(np.arange(2_000), seed, 0)[0]) for seed in range(60)])
    # each sample is at the middle on average: the standard error is 75
    assert abs(places.mean(0) - 999.5).max() < 4.5 * 75


@pytest.fixture
def root(tmp_path):
    animals = {f"{name}/{i:02d}.bin": trees.some(i, 200) for name in ("ant", "cat") for i in range(20)}
    return trees.put(tmp_path / "data", {name: trees.atis(events) for name, events in animals.items()})


def places(dataset, indices, store):
    return [store._place[store.names.number(dataset.samples[i].name)] for i in indices]


@pytest.mark.parametrize("shards", [None, 3])
def test_blocks_of_a_store_are_neighbors(root, tmp_path, shards):
    path = tmp_path / "a.nvs"
    if shards is None:
        nvsdata.pack(EventFolder(root), path)
    else:
        for i in range(shards):
            nvsdata.pack(EventFolder(root), path, shard=(i + 1, shards))
        nvsdata.join(sorted(tmp_path.glob("a-*.nvs")), path)
    dataset = EventFolder(path)
    blocks = dataset.blocks(4_000)
    assert sorted(blocks.order) == list(range(40))
    store = dataset.source
    for begin, end in zip([0, *blocks.ends[:-1]], blocks.ends, strict=True):
        inside = places(dataset, blocks.order[begin:end], store)
        assert max(inside) - min(inside) < 4_000
        # a block is within a file
        assert len({store._shards.where(place)[0] for place in inside} if shards else {0}) == 1
    assert 5 < blocks.ends.size < 30
    assert len(dataset.blocks(1 << 30).ends) == (shards or 1)
    windows = nvsdata.windows(dataset, duration=100_000)
    assert sorted(windows.blocks().order) == list(range(len(windows)))
    report = nvsdata.precompute(EventFolder(root, transform=T.VoxelGrid(2)), tmp_path / "b.nvs")
    assert sorted(Precomputed(tmp_path / "b.nvs").blocks(500).order) == list(range(report.samples))


def test_batches_in_blocks_resume_and_are_divided(root, tmp_path):
    nvsdata.pack(EventFolder(root), tmp_path / "a.nvs")
    blocks = EventFolder(tmp_path / "a.nvs").blocks(2_000)
    how = {"shuffle": True, "seed": 3, "last": 2, "blocks": blocks}
    batches = list(SeededBatches(40, 8, **how))
    assert [sorted(index for _, index in chain(*batches[5 * e :][:5])) for e in (0, 1)] == [list(range(40))] * 2
    assert batches[:5] != list(SeededBatches(40, 8, shuffle=True, seed=3))
    assert list(SeededBatches(40, 8, first=1, start=2, **how)) == batches[7:]
    parts = [list(SeededBatches(40, 8, part=(rank, 2), **how)) for rank in (0, 1)]
    assert [list(chain(*both)) for both in zip(*parts, strict=True)] == batches


@pytest.mark.parametrize(("count", "at_once"), [(2, 10), (5, 10), (40, 40)])
def test_processes_read_few_blocks_twice(count, at_once):
    sizes = np.full(200, 100)
    blocks = SampleBlocks(np.random.default_rng(1).permutation(20_000), np.cumsum(sizes), at_once)
    block_of = np.repeat(np.arange(200), 100)[np.argsort(blocks.order)]
    how = {"shuffle": True, "blocks": blocks}
    read = 0
    for rank in range(count):
        batches = SeededBatches(20_000, 400, part=(rank, count), **how)
        own = [block_of[[index for _, index in batch]] for batch in batches]
        assert all(batch.size == 400 // count for batch in own)
        read += np.unique(np.concatenate(own)).size
    # a part of each batch has the same few blocks of a group; without that, each process would read nearly all blocks
    assert read < 200 * (3 if at_once == 10 else 8)
    assert count < 5 or read < 0.8 * 200 * min(count, at_once)


@pytest.mark.parametrize("count", [4, 8])
def test_each_process_gets_samples_of_the_entire_store(count):
    # 200 blocks of 100 samples; a tenth of the store is a class
    blocks = SampleBlocks(np.arange(20_000), np.arange(100, 20_001, 100))
    how = {"shuffle": True, "blocks": blocks, "last": 4}
    for rank in range(count):
        batches = SeededBatches(20_000, 64 * count, part=(rank, count), **how)
        classes = np.bincount([index // 2_000 for batch in batches for _, index in batch], minlength=10)
        # by the order of the store, the first process would have only the first classes
        assert abs(classes / classes.sum() - 0.1).max() < 0.1


def test_what_has_no_blocks(root, tmp_path):
    with pytest.raises(ValueError, match="only a packed store has blocks"):
        EventFolder(root).blocks()
    nvsdata.pack(EventFolder(root), tmp_path / "a.nvs")
    dataset = EventFolder(tmp_path / "a.nvs")
    with pytest.raises(ValueError, match="size must be"):
        dataset.blocks(0)
    for size, shuffle in ((39, True), (40, False)):
        with pytest.raises(ValueError, match="blocks of 40 samples"):
            SeededBatches(size, 8, shuffle=shuffle, blocks=dataset.blocks())
