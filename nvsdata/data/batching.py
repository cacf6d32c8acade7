"""Making batches of samples."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

import numpy as np
import torch
from torch.utils.data import default_collate
from torch.utils.data._utils.collate import default_collate_fn_map

from nvsdata.data.events import Events
from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.recording import Recording

SMALL = 1 << 19  # bytes; up to this, a copy through the pipe is cheaper than sharing memory


class Batch(NamedTuple):
    """`(inputs, targets)` of a batch, as `collate` makes them."""

    inputs: Any
    targets: Any


def collate(samples: Sequence[tuple[Any, Any]]) -> Batch:
    """`collate_fn` for a DataLoader: makes `(inputs, targets)` of B pairs `(sample, target)`.

    - `samples`: the pairs. Graphs become a `GraphBatch`; sequences of S graphs become a `GraphBatch` with
      `volumes` = S; Events and Recordings stay a list, because their lengths differ; anything else is collated by
      torch. Targets are collated by torch (ints to int64 [B])

    Raises ValueError for no samples, sequences of different lengths, or graphs of different `reach`.
    """
    if not samples:
        raise ValueError("can't make a batch of no samples")
    inputs = [sample for sample, _ in samples]
    targets = [target for _, target in samples]
    if all(isinstance(target, int) for target in targets):
        return Batch(_stack(inputs), torch.tensor(targets))
    return Batch(_stack(inputs), default_collate(targets))


def _stack(inputs: list[Any]) -> Any:
    first = inputs[0]
    if isinstance(first, Graph):
        return GraphBatch.from_graphs(inputs)
    if isinstance(first, list | tuple) and first and isinstance(first[0], Graph):
        lengths = {len(sequence) for sequence in inputs}
        if len(lengths) > 1:
            raise ValueError(f"sequences of different lengths in one batch: {sorted(lengths)}")
        return GraphBatch.from_graphs([graph for sequence in inputs for graph in sequence], volumes=len(first))
    if isinstance(first, Events | Recording):
        return inputs
    return default_collate(inputs)


def _send(batch: Batch) -> tuple[Any, ...]:
    """How a batch is pickled in a worker: all tensors in one piece, because torch sends each tensor separately."""
    graphs, targets = batch
    if not (isinstance(graphs, GraphBatch) and isinstance(targets, torch.Tensor)):
        return Batch, tuple(batch)
    given = {**vars(graphs), "targets": targets}
    tensors = {name: value for name, value in given.items() if isinstance(value, torch.Tensor)}
    if any(tensor.device.type != "cpu" or tensor.requires_grad for tensor in tensors.values()):
        return Batch, tuple(batch)
    # the widest elements first, so that all are aligned
    names = sorted(tensors, key=lambda name: -tensors[name].element_size())
    piece = torch.cat([tensors[name].contiguous().view(-1).view(torch.uint8) for name in names])
    layout = [(name, tensors[name].dtype, tensors[name].shape) for name in names]
    others = {name: value for name, value in given.items() if name not in tensors}
    return _receive, (piece.numpy() if piece.numel() <= SMALL else piece, layout, others)


def _receive(piece: Any, layout: list[tuple[str, torch.dtype, torch.Size]], given: dict[str, Any]) -> Batch:
    flat = torch.from_numpy(np.require(piece, requirements="W")) if isinstance(piece, np.ndarray) else piece
    start = 0
    for name, dtype, shape in layout:
        stop = start + shape.numel() * dtype.itemsize
        given[name] = flat[start:stop].view(dtype).view(shape)
        start = stop
    targets = given.pop("targets")
    return Batch(GraphBatch(**given), targets)


ForkingPickler.register(Batch, _send)


def _batch(samples: Sequence[Any], *, collate_fn_map: Any = None) -> Any:
    return _stack(list(samples))


# so that a DataLoader without collate_fn handles these types, too: torch looks up other libraries' types here
for kind in (Graph, Events, Recording):
    default_collate_fn_map[kind] = _batch
