"""Samples as bytes: a line of JSON that describes the sample, then the values of its tensors and arrays.

The bytes are not trusted. Unknown types, shapes that don't match the values, impossible Events and edges between
missing nodes raise ValueError. So no code from the file is run, and kernels get valid arguments only.
"""

from __future__ import annotations

import json
from dataclasses import fields
from math import prod
from typing import Any

import numpy as np
import torch

from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.kernels.decode.order import is_sorted

PLAIN = (type(None), bool, int, float, str)
ALIGNED = 16  # bytes; each tensor's numbers begin at a multiple of it
KINDS = {
    str(kind).removeprefix("torch."): kind
    for kind in vars(torch).values()
    if isinstance(kind, torch.dtype) and not str(kind).startswith(("torch.q", "torch.bits"))
}


def encode_sample(sample: Any) -> bytes:
    """Convert a sample to bytes; TypeError if `decode_sample` couldn't restore its type."""
    numbers: list[bytes] = []
    head = json.dumps(_description(sample, numbers)).encode() + b"\n"
    parts = [head, bytes(-len(head) % ALIGNED)]
    for one in numbers:
        parts += one, bytes(-len(one) % ALIGNED)
    return b"".join(parts)


def _description(sample: Any, numbers: list[bytes]) -> list[Any]:
    """Return kind and content of a sample for JSON; the values of its tensors are added to `numbers` as bytes."""
    kind = type(sample)
    if kind in PLAIN:
        return ["value", sample]
    if kind is complex:
        return ["complex", sample.real, sample.imag]
    if kind is bytes:
        return ["bytes", sample.hex()]
    if kind is Events:
        columns = [_tensor_description(torch.from_numpy(np.ascontiguousarray(c)), numbers) for c in sample.columns]
        times = [None if time is None else int(time) for time in (sample.start, sample.stated_end)]
        return ["events", columns, [int(side) for side in sample.sensor_size], *times]
    if kind is Graph:
        return ["graph", {field.name: _description(getattr(sample, field.name), numbers) for field in fields(sample)}]
    if kind in (list, tuple):
        return [kind.__name__, [_description(item, numbers) for item in sample]]
    if kind is dict:
        return ["dict", [[_description(key, numbers), _description(value, numbers)] for key, value in sample.items()]]
    if kind is torch.Tensor and sample.layout == torch.strided and not sample.is_quantized:
        return ["tensor", _tensor_description(sample.detach(), numbers)]
    if kind is np.ndarray or isinstance(sample, np.generic):
        try:
            tensor = torch.from_numpy(np.array(sample, order="C"))
        except TypeError:
            raise TypeError(f"a cache can't keep arrays of {sample.dtype}") from None
        return ["array" if kind is np.ndarray else "number", _tensor_description(tensor, numbers)]
    raise TypeError(
        "a cache keeps Events, graphs, dense tensors, arrays, numbers, strings, and tuples, lists and dicts of them, "
        f"not {kind.__module__}.{kind.__qualname__}: the last deterministic transform must return one of these"
    )


def _tensor_description(tensor: torch.Tensor, numbers: list[bytes]) -> list[Any]:
    """Return type, shape and device of a tensor, whose values are added to `numbers` as bytes."""
    plain = tensor.resolve_conj().resolve_neg().contiguous().cpu()
    numbers.append(plain.view(-1).view(torch.uint8).numpy().tobytes())
    return [str(tensor.dtype).removeprefix("torch."), list(tensor.shape), str(tensor.device)]


def decode_sample(content: memoryview) -> Any:
    """Restore a sample from the bytes of `encode_sample`; ValueError for other bytes."""
    end = bytes(content[: 1 << 16]).find(b"\n") + 1 or bytes(content).find(b"\n") + 1
    numbers = _Numbers(content, end + -end % ALIGNED)
    try:
        sample = _decoded(json.loads(bytes(content[:end])), numbers)
    except ValueError:
        raise
    except Exception as error:  # raised by torch or numpy, or by a list in place of something else
        raise ValueError(f"not a sample: {error}") from None
    if numbers.at != len(content):
        raise ValueError("not a sample: more numbers than it describes")
    return sample


class _Numbers:
    """Reader of the values of tensors, one tensor after the other; `at` is the byte at which the next one begins."""

    def __init__(self, content: memoryview, at: int) -> None:
        self.content, self.at = content, at

    def tensor(self, stated: list[Any]) -> torch.Tensor:
        name, shape, device = stated
        kind = KINDS[name]
        if not all(type(side) is int and side >= 0 for side in shape):
            raise ValueError(f"not a shape: {shape}")
        size = prod(shape) * kind.itemsize
        # checked before memory is allocated
        if size > len(self.content) - self.at:
            raise ValueError(f"fewer numbers than {shape}")
        # a copy, because users may write to it
        numbers = np.frombuffer(self.content[self.at : self.at + size], np.uint8).copy()
        self.at += size + -size % ALIGNED
        if kind is torch.bool and size and numbers.max() > 1:
            raise ValueError("a boolean that is neither 0 nor 1")
        tensor = torch.from_numpy(numbers).view(kind).reshape(shape)
        return tensor if device == "cpu" else tensor.to(torch.device(device))


def _decoded(stated: Any, numbers: _Numbers) -> Any:
    kind, value, *more = stated
    if kind == "value" and type(value) in PLAIN:
        return value
    if kind == "complex":
        return complex(value, *more)
    if kind == "bytes":
        return bytes.fromhex(value)
    if kind == "events":
        return _events([numbers.tensor(one) for one in value], *more)
    if kind == "graph":
        return _checked_graph(Graph(**{name: _decoded(part, numbers) for name, part in value.items()}))
    if kind in ("list", "tuple"):
        items = [_decoded(item, numbers) for item in value]
        return items if kind == "list" else tuple(items)
    if kind == "dict":
        return {_decoded(key, numbers): _decoded(item, numbers) for key, item in value}
    if kind == "tensor":
        return numbers.tensor(value)
    if kind in ("array", "number"):
        array = numbers.tensor(value).numpy()
        return array if kind == "array" else array[()]
    raise ValueError(f"not a kind of sample: {kind!r:.40}")


def _events(tensors: list[torch.Tensor], size: list[int], start: int | None, end: int | None) -> Events:
    t, x, y, p = (tensor.numpy() for tensor in tensors)
    if [t.dtype, x.dtype, y.dtype, p.dtype] != [np.int64, np.int16, np.int16, np.uint8] or not is_sorted(t):
        raise ValueError("not events as nvsdata keeps them")
    # `Events` checks lengths, times, pixels and polarities
    width, height = size
    return Events(t, x, y, p, (width, height), start=start, end=end)


def _checked_graph(graph: Graph) -> Graph:
    """Return the graph; ValueError if its fields contradict each other."""
    nodes, edges = graph.x.shape[0], graph.edge_index
    kinds = [graph.x.dtype, graph.pos.dtype, graph.t.dtype, edges.dtype, graph.edge_attr.dtype]
    shapes = [graph.x.ndim, *graph.pos.shape, *graph.t.shape, edges.shape[0], edges.ndim, *graph.edge_attr.shape]
    if not (
        all(kind.is_floating_point for kind in (kinds[0], kinds[1], kinds[4]))
        and kinds[2] == kinds[3] == torch.int64
        and shapes == [2, nodes, 2, nodes, 2, 2, edges.shape[1], len(graph.reach)]
        and graph.pseudo in ("abs", "signed", "signed-time")
    ):
        raise ValueError("not a graph as nvsdata keeps it")
    if edges.numel():
        target = edges[1]
        lowest, highest = torch.aminmax(edges)
        if lowest < 0 or highest >= nodes or bool((target[1:] < target[:-1]).any()):
            raise ValueError("edges between missing nodes, or edges that aren't grouped by target")
    return graph
