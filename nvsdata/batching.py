"""Samples to batches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch.utils.data import default_collate

from nvsdata.events import Events, Recording
from nvsdata.graph import Graph, GraphBatch


def collate(samples: Sequence[tuple[Any, Any]]) -> tuple[Any, Any]:
    """`collate_fn` for a DataLoader: a list of `(sample, target)` to `(batch, targets)`.

    Graphs become a `GraphBatch`; sequences of S graphs become a `GraphBatch` with `volumes` = S;
    Events stay a list (their lengths differ); anything else goes through torch's own collation.
    Targets are collated by torch (ints to int64 [B]). ValueError for no samples, or sequences of
    different lengths.
    """
    if not samples:
        raise ValueError("can't make a batch of no samples")
    inputs = [sample for sample, _ in samples]
    targets = [target for _, target in samples]
    if all(isinstance(target, int) for target in targets):
        return _stack(inputs), torch.tensor(targets)
    return _stack(inputs), default_collate(targets)


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
