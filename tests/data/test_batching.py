"""How batches travel from worker processes."""

from dataclasses import replace
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader
from trees import some

import nvsdata
from nvsdata import GraphBatch
from nvsdata import transforms as T
from nvsdata.data import batching

FIELDS = ("x", "pos", "t", "edge_index", "edge_attr", "batch", "ptr")


@pytest.fixture
def samples():
    return [(T.RadiusGraph()(some(i, 5 * i)), i % 3) for i in range(6)]


def assert_same(a, b):
    for name in FIELDS:
        one, other = getattr(a, name), getattr(b, name)
        assert torch.equal(one, other)
        assert one.dtype == other.dtype
    assert (a.sensor_size, a.reach, a.volumes) == (b.sensor_size, b.reach, b.volumes)


def travelled(batch):
    return ForkingPickler.loads(ForkingPickler.dumps(batch))


@pytest.mark.parametrize("small", [0, 1 << 30], ids=["shared memory", "pipe"])
def test_a_batch_arrives_as_it_left(samples, monkeypatch, small):
    monkeypatch.setattr(batching, "SMALL", small)
    batch, targets = nvsdata.collate(samples)
    (arrived, its_targets) = travelled(batching.Batch(batch, targets))
    assert_same(arrived, batch)
    assert torch.equal(its_targets, targets)
    # it can be written to, as any tensor from a DataLoader can
    arrived.x.add_(1)


def test_other_batches_travel_as_they_are():
    grids, targets = nvsdata.collate([(torch.ones(2, 2), {"a": 1}), (torch.zeros(2, 2), {"a": 2})])
    arrived = travelled(batching.Batch(grids, targets))
    assert torch.equal(arrived.inputs, grids)
    assert torch.equal(arrived.targets["a"], targets["a"])


def test_batches_from_workers_equal_those_made_here(samples):
    there = list(DataLoader(samples, 4, num_workers=1, collate_fn=nvsdata.collate))
    here = list(DataLoader(samples, 4, collate_fn=nvsdata.collate))
    for (a, one), (b, other) in zip(there, here, strict=True):
        assert isinstance(a, GraphBatch)
        assert_same(a, b)
        assert torch.equal(one, other)


def test_a_loader_without_collate_fn_makes_the_same_batches(fake_nmnist):
    dataset = nvsdata.NMNIST(fake_nmnist, transform=T.Compose([T.Window(0, 30_000), T.RadiusGraph()]))
    (ours, targets), (plain, same) = (next(iter(DataLoader(dataset, 4, collate_fn=f))) for f in (nvsdata.collate, None))
    assert isinstance(plain, GraphBatch)
    assert torch.equal(same, targets)
    assert all(torch.equal(getattr(ours, name), getattr(plain, name)) for name in FIELDS)
    whole = nvsdata.NMNIST(fake_nmnist)
    events, _ = next(iter(DataLoader(whole, 4)))
    assert events == [whole[i][0] for i in range(4)]


def test_small_batches_are_copied_and_large_ones_shared(samples, monkeypatch):
    batch = nvsdata.collate(samples)
    tensors = [*(getattr(batch.inputs, name) for name in FIELDS), batch.inputs.y, batch.targets]
    # numbers of nodes take half as much on the way
    size = sum(tensor.nbytes for tensor in tensors if tensor is not None) - batch.inputs.edge_index.nbytes // 2
    for limit, kind in ((size, np.ndarray), (size - 1, torch.Tensor)):
        monkeypatch.setattr(batching, "SMALL", limit)
        _, (piece, layout, _) = batching._send(batch)
        assert type(piece) is kind
        assert len(piece) == size
        # the widest first, so that all are aligned
        widths = [dtype.itemsize for _, dtype, _ in layout]
        assert widths == sorted(widths, reverse=True)


@pytest.mark.parametrize(
    "change",
    [
        lambda graphs, targets: (graphs, [{"boxes": [1]}, {"boxes": []}]),
        lambda graphs, targets: (targets, targets),
        lambda graphs, targets: (replace(graphs, x=graphs.x.clone().requires_grad_()), targets),
        lambda graphs, targets: (graphs, targets.float().requires_grad_()),
    ],
    ids=["listed targets", "no graphs", "gradients of features", "gradients of targets"],
)
def test_batches_that_cannot_be_one_piece_travel_as_they_are(samples, change):
    inputs, targets = change(*nvsdata.collate(samples))
    assert batching._send(batching.Batch(inputs, targets)) == (batching.Batch, (inputs, targets))


def test_targets_are_collated_by_what_they_are():
    def targets(*given):
        return nvsdata.collate([(torch.ones(1), target) for target in given]).targets

    assert targets(3, True).tolist() == [3, 1]
    assert targets(3, 4).dtype == torch.int64
    assert targets(0.5, 1.5).dtype == torch.float64
    assert targets(3, 0.5).tolist() == [3, 0.5]
    boxes = {"boxes": [[1, 2, 3, 4]], "label": 5}
    assert targets(boxes, boxes) == [boxes, boxes]
    # without boxes, what has one name goes into one tensor
    assert targets({"label": 5}, {"label": 6})["label"].tolist() == [5, 6]
    with pytest.raises(KeyError):
        targets(boxes, {"label": 6})
    assert nvsdata.collate([([], 0), ([], 1)]).inputs == []
    assert nvsdata.collate([([2.0, 3.0], 0), ([4.0, 5.0], 1)]).inputs[1].tolist() == [3, 5]


@pytest.mark.parametrize("kind", [torch.as_tensor, np.asarray])
def test_targets_of_unequal_size_are_named_or_filled_up(kind):
    traces = [kind([[1.0, 2.0], [3.0, 4.0]]), kind([[5.0, 6.0]])]
    samples = [(torch.zeros(2), trace) for trace in traces]
    message = (
        r"^target 0 has the shape \(2, 2\), target 1 \(1, 2\): they don't fit into one batch\. Pad them"
        r" \(collate with pad=True\), change them by target_transform, or use batch_size=1$"
    )
    with pytest.raises(ValueError, match=message):
        nvsdata.collate(samples)
    found = nvsdata.collate(samples, pad=True).targets
    assert found.values.tolist() == [[[1, 2], [3, 4]], [[5, 6], [0, 0]]]
    assert found.lengths.tolist() == [2, 1]
    for pad in (False, True):
        same = nvsdata.collate(samples[:1] * 3, pad=pad).targets
        assert same.shape == (3, 2, 2)
        assert same.dtype == torch.as_tensor(traces[0]).dtype
    with pytest.raises(
        ValueError, match=r"^target 0 has the shape \(2, 2\), target 1 \(2,\): they don't fit into one batch$"
    ):
        nvsdata.collate([samples[0], (torch.zeros(2), kind([1.0, 2.0]))], pad=True)
    scalars = nvsdata.collate([(torch.zeros(2), kind(n)) for n in (3, 4)], pad=True).targets
    assert scalars.tolist() == [3, 4]


@pytest.mark.parametrize(
    ("targets", "where"),
    [
        ([([1.0, 2.0],), ([1.0],)], r"target\[0\] 0 has the shape \(2,\), target\[0\] 1 \(1,\)"),
        ([[1, 2, 3], [1, 2]], r"target 0 has the shape \(3,\), target 1 \(2,\)"),
        ([(torch.zeros(3), 1), (torch.zeros(2), 2)], r"target\[0\] 0 has the shape \(3,\), target\[0\] 1 \(2,\)"),
        (
            [{"a": torch.zeros(3)}, {"a": torch.zeros(2)}],
            r"target\['a'\] 0 has the shape \(3,\), target\['a'\] 1 \(2,\)",
        ),
    ],
)
def test_targets_within_others_are_named_too(targets, where):
    samples = [(torch.zeros(2), target) for target in targets]
    with pytest.raises(ValueError, match=f"^{where}.*: they don't fit into one batch"):
        nvsdata.collate(samples)


def test_targets_within_others_are_filled_up():
    given = [{"a": torch.ones(3), "n": 1, "s": ("x", 2.0)}, {"a": torch.ones(2), "n": 2, "s": ("y", 3.0)}]
    found = nvsdata.collate([(torch.zeros(2), target) for target in given], pad=True).targets
    assert found["a"].values.tolist() == [[1, 1, 1], [1, 1, 0]]
    assert found["n"].tolist() == [1, 2]
    assert found["s"][0] == ["x", "y"] or found["s"][0] == ("x", "y")
    assert found["s"][1].tolist() == [2, 3]


def test_tensors_and_arrays_may_be_mixed():
    for first, other in ((torch.ones(2, 3), np.ones((2, 3))), (np.ones((2, 3)), torch.ones(2, 3))):
        assert nvsdata.collate([(torch.zeros(1), first), (torch.zeros(1), other)]).targets.shape == (2, 2, 3)
