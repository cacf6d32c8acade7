"""Batches of samples: `nvsdata.collate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from multiprocessing.reduction import ForkingPickler
from typing import Any, Literal, NamedTuple, overload

import numpy as np
import torch
from torch.utils.data import default_collate
from torch.utils.data._utils.collate import default_collate_fn_map

from nvsdata.data.events import Events
from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.ragged import EventBatch, Padded, sensor_size_advice
from nvsdata.data.recording import Recording

SMALL = 1 << 19  # bytes; a smaller batch is copied through the pipe, which is cheaper than sharing memory


class Batch(NamedTuple):
    """Inputs and targets of a batch, as `collate` returns them.

    Args:
        inputs: A `GraphBatch`, `Padded`, `EventBatch`, tensor [B, ...], or list, by the kind of the samples.
        targets: int64 [B] for labels; other targets as `collate` describes them.
    """

    inputs: Any
    targets: Any


class SequenceBatch(NamedTuple):
    """A batch of `SequenceBatches`, as `collate` returns it.

    Args:
        inputs: As of `Batch`.
        targets: As of `Batch`.
        first: bool [B], True where a sequence begins: the network must reset its state there.
        valid: bool [B], False for padding: windows that were in a batch before.
    """

    inputs: Any
    targets: Any
    first: torch.Tensor
    valid: torch.Tensor


@overload
def collate(
    samples: Sequence[tuple[Any, Any]], *, pad: bool = False, events: Literal["list", "columns"] = "list"
) -> Batch: ...


@overload
def collate(
    samples: Sequence[tuple[Any, Any, bool, bool]], *, pad: bool = False, events: Literal["list", "columns"] = "list"
) -> SequenceBatch: ...


def collate(
    samples: Sequence[tuple[Any, ...]], *, pad: bool = False, events: Literal["list", "columns"] = "list"
) -> Batch | SequenceBatch:
    """Make a batch of B pairs `(sample, target)`; the `collate_fn` of a DataLoader.

    For settings other than the defaults, pass `collate_fn=functools.partial(nvsdata.collate, pad=True)` to the
    DataLoader.

    Args:
        samples: The pairs. Graphs become a `GraphBatch`. Sequences of S graphs become a `GraphBatch` with `volumes` =
            S. Tensors of one shape are stacked. Anything else is collated by torch, and so are targets (ints to int64
            [B]). Targets that are dicts with `boxes` stay a list, because their numbers of boxes differ. With
            `SequenceBatches`, samples are `(sample, target, first, valid)` and become a `SequenceBatch`.
        pad: Whether tensors of unequal size, such as different numbers of frames, become a `Padded`, filled with
            zeros. It applies to targets that are tensors, too (default False).
        events: "list" (default) leaves Events and Recordings a list, because their lengths differ; "columns" makes
            an `EventBatch`, concatenated columns with `offsets`.

    Returns:
        The inputs and the targets, of `SequenceBatches` also `first` and `valid`.

    Raises:
        ValueError: If there are no samples, if sequences have different lengths or graphs different `reach`, or if
            tensors don't fit together.

    Example:
        >>> inputs, targets = collate([(torch.zeros(2, 4, 4), 0), (torch.ones(2, 4, 4), 1)])
        >>> inputs.shape, targets.tolist()
        (torch.Size([2, 2, 4, 4]), [0, 1])
    """
    if events not in ("list", "columns"):
        raise ValueError(f"events must be 'list' or 'columns', not {events!r}")
    if not samples:
        raise ValueError("can't make a batch of no samples")
    inputs, targets, *flags = map(list, zip(*samples, strict=True))
    batch = _pairs(inputs, targets, pad, events)
    if not flags:
        return batch
    first, valid = map(torch.tensor, flags)
    return SequenceBatch(*batch, first, valid)


def _pairs(inputs: list[Any], targets: list[Any], pad: bool, events: str) -> Batch:
    stacked = _stack(inputs, pad, events)
    if all(isinstance(target, int) for target in targets):
        return Batch(stacked, torch.tensor(targets))
    if all(isinstance(target, Mapping) and "boxes" in target for target in targets):
        return Batch(stacked, targets)
    try:
        return Batch(stacked, default_collate(targets))
    except (RuntimeError, TypeError):
        return Batch(stacked, _unequal(targets, pad))


def _stack(inputs: list[Any], pad: bool = False, events: str = "list") -> Any:
    first = inputs[0]
    if isinstance(first, Graph):
        return GraphBatch.from_graphs(inputs)
    if isinstance(first, list | tuple) and first and isinstance(first[0], Graph):
        lengths = {len(sequence) for sequence in inputs}
        if len(lengths) > 1:
            raise ValueError(f"sequences of different lengths in one batch: {sorted(lengths)}")
        return GraphBatch.from_graphs([graph for sequence in inputs for graph in sequence], volumes=len(first))
    if isinstance(first, Events | Recording):
        return inputs if events == "list" else EventBatch.of(inputs)
    if all(isinstance(sample, torch.Tensor) for sample in inputs):
        _check_shapes([tuple(sample.shape) for sample in inputs], pad)
        return Padded.of(inputs) if pad and first.ndim else default_collate(inputs)
    return default_collate(inputs)


def _unequal(targets: list[Any], pad: bool, name: str = "target") -> Any:
    """Collate targets that torch can't collate because they contain tensors of unequal size, such as joint positions.

    Such tensors are padded; if `pad` is false, a ValueError names the target, such as "target['pose']".
    """
    first = targets[0]
    if all(isinstance(target, torch.Tensor | np.ndarray) for target in targets):
        tensors = [torch.as_tensor(target) for target in targets]
        _check_shapes([tuple(tensor.shape) for tensor in tensors], pad, name, OTHERS)
        return Padded.of(tensors) if len({tensor.shape for tensor in tensors}) > 1 else default_collate(tensors)
    if all(isinstance(target, Mapping) and target.keys() == first.keys() for target in targets):
        return {key: _unequal([target[key] for target in targets], pad, f"{name}[{key!r}]") for key in first}
    if all(isinstance(target, list | tuple) for target in targets):
        _check_shapes([(len(target),) for target in targets], False, name, OTHERS)
        return [_unequal(list(part), pad, f"{name}[{n}]") for n, part in enumerate(zip(*targets, strict=True))]
    return default_collate(targets)


OTHERS = "change them by target_transform"
CUTS = "cut them to one size (T.RandomTemporalCrop, T.CenterCrop or T.Resize)"


def _check_shapes(shapes: list[tuple[int, ...]], pad: bool, name: str = "sample", cuts: str = CUTS) -> None:
    for number, shape in enumerate(shapes):
        if len(shape) != len(shapes[0]) or (shape != shapes[0] and not pad):
            what = f"{name} 0 has the shape {shapes[0]}, {name} {number} {shape}: they don't fit into one batch"
            if len(shape) != len(shapes[0]):
                raise ValueError(what)
            # images, or sequences of images
            if name == "sample" and len(shape) > 2 and shape[-2:] != shapes[0][-2:]:
                what = f"{what}. If they {sensor_size_advice((one[-1], one[-2]) for one in (shapes[0], shape))}"
            raise ValueError(f"{what}. Pad them (collate with pad=True), {cuts}, or use batch_size=1")


def _send(batch: Batch) -> tuple[Any, ...]:
    """Pickle a batch in a worker, with all tensors joined in one, because torch would send each tensor separately."""
    graphs, targets = batch
    if not (isinstance(graphs, GraphBatch) and isinstance(targets, torch.Tensor)):
        return Batch, tuple(batch)
    given = {**vars(graphs), "targets": targets}
    tensors = {name: value for name, value in given.items() if isinstance(value, torch.Tensor)}
    if any(tensor.device.type != "cpu" or tensor.requires_grad for tensor in tensors.values()):
        return Batch, tuple(batch)
    # node indices have 4 bytes in transit; torch's kernels require 8
    tensors["edge_index"] = graphs.edge_index.int()
    # the widest elements first, so that all are aligned
    names = sorted(tensors, key=lambda name: -tensors[name].element_size())
    piece = torch.cat([tensors[name].contiguous().view(-1).view(torch.uint8) for name in names])
    layout = [(name, tensors[name].dtype, tensors[name].shape) for name in names]
    others = {name: value for name, value in given.items() if name not in tensors}
    return _receive, (piece.numpy() if piece.numel() <= SMALL else piece, layout, others)


def _send_sequence(batch: SequenceBatch) -> tuple[Any, ...]:
    return _receive_sequence, (Batch(batch.inputs, batch.targets), batch.first.numpy(), batch.valid.numpy())


def _receive_sequence(batch: Batch, first: np.ndarray, valid: np.ndarray) -> SequenceBatch:
    return SequenceBatch(*batch, torch.from_numpy(first), torch.from_numpy(valid))


def _receive(piece: Any, layout: list[tuple[str, torch.dtype, torch.Size]], given: dict[str, Any]) -> Batch:
    flat = torch.from_numpy(np.require(piece, requirements="W")) if isinstance(piece, np.ndarray) else piece
    start = 0
    for name, dtype, shape in layout:
        stop = start + shape.numel() * dtype.itemsize
        given[name] = flat[start:stop].view(dtype).view(shape)
        start = stop
    targets, edge_index = given.pop("targets"), given.pop("edge_index").long()
    return Batch(GraphBatch(edge_index=edge_index, **given), targets)


ForkingPickler.register(Batch, _send)
ForkingPickler.register(SequenceBatch, _send_sequence)


def _batch(samples: Sequence[Any], *, collate_fn_map: Any = None) -> Any:
    return _stack(list(samples))


# torch looks up types of other libraries here, so that a DataLoader without collate_fn handles these types, too
for kind in (Graph, Events, Recording):
    default_collate_fn_map[kind] = _batch
