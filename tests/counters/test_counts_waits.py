"""How often a network reads a number of its device: each time, the host would wait for all that a GPU still does."""

import sys
from collections import Counter
from multiprocessing.reduction import ForkingPickler
from pathlib import Path

import elsewhere
import numpy as np
import pytest
import torch
from elsewhere import DEVICE, Elsewhere, Factories
from torch.func import functional_call
from torch.utils._pytree import tree_leaves

from nvsdata import Events, GraphBatch, collate, models
from nvsdata import transforms as T
from nvsdata.models import NETWORKS

SIZE = (34, 34)
SMALL = {"channels": (4, 6), "clusters": ((4, 4), (8, 8)), "sensor_size": SIZE, "kernel_size": 3}
# of results whose sizes depend on values, and of values themselves
READS = {"_local_scalar_dense", "nonzero", "_unique2", "unique_dim", "bincount", "masked_select", "equal"}
PICTURES, CLIPS = (2, 2, 75, 75), (2, 2, 8, 32, 32)
INPUTS = {
    **dict.fromkeys(("vgg", "inception-v4", "resnet"), PICTURES),
    **dict.fromkeys(("c3d", "i3d", "resnet3d", "p3d", "r2plus1d", "resnext3d"), CLIPS),
    "lstm": (2, 5, 4),
    "pointnet": (2, 60, 4),
    "pointnet++": (2, 513, 4),
    "motion-vector-3d": (2, 160, 24, 24),
}
SETTINGS = {"vgg": {"hidden": 64}, "c3d": {"hidden": 64}}
GRAPHS = {
    "rgcnn": lambda: (models.RGCNN(3, **SMALL), graphs(2)),
    "gcnn": lambda: (models.GCNN(3, **SMALL, pooling="average"), graphs(2)),
    "rgcnn3d": lambda: (models.RGCNN3D(3, **SMALL, temporal="plain"), graphs(1, 4)),
    **{name: lambda name=name: (models.GCNN(3, **SMALL, convolution=name), graphs(2)) for name in ("gcn", "monet")},
}
POOLED = 3  # waits per pooling: how many clusters there are, which edges lead out of theirs, and how many remain


def graphs(count, volumes=None):
    """A batch of graphs, or of sequences of them."""
    samples = []
    for n in range(count * (volumes or 1)):
        rng = np.random.default_rng(n)
        x, y = (rng.integers(0, side, 40) for side in SIZE)
        samples.append(T.RadiusGraph(radius=6)(Events(range(40), x, y, x % 2, SIZE)))
    if volumes:
        samples = [samples[n * volumes : (n + 1) * volumes] for n in range(count)]
    return collate([(sample, 0) for sample in samples]).inputs


def asking():
    """The module of networks that is running."""
    frame = sys._getframe()
    while frame is not None and "nvsdata/models/" not in frame.f_code.co_filename:
        frame = frame.f_back
    return "backward" if frame is None else Path(frame.f_code.co_filename).name


@pytest.fixture
def waits(monkeypatch):
    """Counts what the pretended device is asked for, by function and module."""
    tally, called = Counter(), elsewhere._called

    def counting(function, args, kwargs):
        name = function.name().removeprefix("aten::").partition(".")[0]
        if name == "index" and any(i is not None and i.dtype == torch.bool for i in args[1]):
            # a mask is a list of indices whose length has to be known
            name = "nonzero"
        back = kwargs.get("device") is not None and torch.device(kwargs["device"]) != DEVICE
        if (name in READS or (name in ("_to_copy", "copy_") and back)) and any(
            isinstance(leaf, Elsewhere) for leaf in tree_leaves((args, kwargs))
        ):
            tally[asking()] += 1
        return called(function, args, kwargs)

    monkeypatch.setattr(elsewhere, "_called", counting)
    return tally


def trained(model, sample):
    """Scores and gradients on the pretended device."""
    parameters = dict(model.named_parameters())
    start = {k: v.detach().clone() for k, v in (*parameters.items(), *model.named_buffers())}
    moved = sample._each(Elsewhere) if isinstance(sample, GraphBatch) else Elsewhere(sample)
    with Factories():
        there = {k: Elsewhere(v).requires_grad_(k in parameters) for k, v in start.items()}
        functional_call(model, there, (moved,)).square().sum().backward()


@pytest.mark.parametrize("name", GRAPHS)
def test_networks_of_graphs_wait_only_where_they_pool(waits, name):
    model, sample = GRAPHS[name]()
    poolings = sum(isinstance(part, models.GraphPool) for part in model.modules())
    trained(model.train(), sample)
    assert waits == {"clusters.py": POOLED * poolings}


@pytest.mark.parametrize("name", INPUTS)
def test_networks_of_frames_and_points_do_not_wait(name):
    # tensors on "meta" have no values at all, so reading one is an error
    with torch.device("meta"):
        model = NETWORKS[name](10, **SETTINGS.get(name, {})).train()
        scores = model(torch.empty(INPUTS[name]))
    assert scores.shape == (2, 10)


def test_every_network_is_counted():
    assert set(NETWORKS) <= INPUTS.keys() | GRAPHS.keys()


def test_a_batch_of_graphs_copies_each_column_once(monkeypatch):
    samples = [(graph, 0) for graph in graphs(6).to_graphs()]
    seen, cat = [], torch.cat

    def counting(tensors, *args, **kwargs):
        seen.append(len(tensors))
        return cat(tensors, *args, **kwargs)

    monkeypatch.setattr(torch, "cat", counting)
    with Made() as made:
        batch = collate(samples).inputs
    # x, pos, t, edge_index, edge_attr
    assert seen == [6] * 5
    columns = [batch.x, batch.pos, batch.t, batch.edge_index, batch.edge_attr]
    # beside these columns: the graph of each node and of each edge, and how far the numbers in an edge are moved
    assert made.bytes <= sum(c.nbytes for c in columns) + 2 * 8 * (batch.num_nodes + batch.num_edges) + 4096


def test_a_batch_of_one_kind_of_tensors_is_stacked_once():
    frames = [(torch.rand(2, 34, 34), n) for n in range(8)]
    with Made() as made:
        collate(frames)
    assert made.bytes <= 8 * frames[0][0].nbytes + 4096


def test_a_worker_packs_a_batch_by_one_copy(monkeypatch):
    batch = collate([(graph, 0) for graph in graphs(6).to_graphs()])
    seen, cat = [], torch.cat
    monkeypatch.setattr(torch, "cat", lambda tensors, *args, **kwargs: seen.append(1) or cat(tensors, *args, **kwargs))
    sent = ForkingPickler.dumps(batch)
    assert seen == [1]
    tensors = [value for value in (*vars(batch.inputs).values(), batch.targets) if torch.is_tensor(value)]
    # numbers of nodes take half as much on the way
    size = sum(tensor.nbytes for tensor in tensors) - batch.inputs.edge_index.nbytes // 2
    assert size <= len(sent) <= size + 4096


class Made(torch.utils._python_dispatch.TorchDispatchMode):
    """Sums up the bytes of new tensors; views share theirs."""

    def __init__(self):
        super().__init__()
        self.bytes = 0

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        found = function(*args, **(kwargs or {}))
        inputs = {leaf.untyped_storage().data_ptr() for leaf in tree_leaves((args, kwargs)) if torch.is_tensor(leaf)}
        for leaf in tree_leaves(found):
            if torch.is_tensor(leaf) and leaf.untyped_storage().data_ptr() not in inputs:
                self.bytes += leaf.nbytes
        return found
