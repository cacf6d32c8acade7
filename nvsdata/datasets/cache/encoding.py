"""Samples as bytes: a line of JSON that describes the sample, then the values of its tensors and arrays.

Values are stored in the smallest type that has them all, and edges of graphs as distances between nodes: the graph of
an event camera takes a thirtieth of its bytes in memory. The restored sample has the same bits.

The bytes are not trusted. Unknown types, shapes that don't match the values, impossible Events and edges between
missing nodes raise ValueError. So no code from the file is run, and kernels get valid arguments only. Small files can't
fill the memory: what a sample takes there is computed before it is decoded.
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
from nvsdata.data.pseudo import pseudo
from nvsdata.kernels.decode.order import is_sorted
from nvsdata.kernels.graph.edge_code import pack_edges, unpack_edges

PLAIN = (type(None), bool, int, float, str)
# types of tensors that may be stored in a smaller one, and these: True for the steps between values
NARROWED = (torch.int64, torch.int32, torch.int16, torch.float64, torch.float32)
SMALLER = (("uint8", False), ("int8", False), ("uint8", True), ("uint16", True), ("int16", False), ("int32", False))
MOST = 1 << 30  # bytes of a sample, and of its tensors in memory
MOST_AXES = 64  # of a tensor, as of numpy's arrays
OF_EDGE = 28  # bytes of an edge in memory: two nodes, and at most three pseudo-coordinates
ALIGNED = 16  # bytes; each tensor's numbers begin at a multiple of it
KINDS = {
    str(kind).removeprefix("torch."): kind
    for kind in vars(torch).values()
    if isinstance(kind, torch.dtype) and not str(kind).startswith(("torch.q", "torch.bits"))
}


class TooLarge(ValueError):
    """A sample takes more than `MOST` bytes."""


def encode_sample(sample: Any) -> bytes:
    """Convert a sample to bytes.

    Raises:
        TypeError: `decode_sample` couldn't restore its type.
        TooLarge: It takes more than 1 GiB.
    """
    numbers: list[bytes] = []
    stated = _description(sample, numbers)
    head = json.dumps(stated).encode() + b"\n"
    parts = [head, bytes(-len(head) % ALIGNED)]
    for one in numbers:
        parts += one, bytes(-len(one) % ALIGNED)
    if (size := max(sum(map(len, parts)), _in_memory(stated))) > MOST:
        raise TooLarge(f"the sample has {size:,} bytes, more than {MOST:,}")
    return b"".join(parts)


def _in_memory(stated: Any) -> int:
    """Return how many bytes the tensors of a described sample take in memory, at most."""
    kind, value, *more = stated
    if kind in ("list", "tuple"):
        return sum(map(_in_memory, value))
    if kind == "dict":
        return sum(_in_memory(key) + _in_memory(item) for key, item in value)
    if kind in ("tensor", "array", "number"):
        return _tensor_size(value)
    if kind == "events":
        return sum(map(_tensor_size, value))
    if kind == "graph":
        return sum(map(_in_memory, value.values())) + (OF_EDGE * abs(int(more[0])) if more else 0)
    return 0


def _tensor_size(stated: list[Any]) -> int:
    name, shape, *_ = stated
    if len(shape) > MOST_AXES or not all(type(side) is int and side >= 0 for side in shape):
        raise ValueError(f"not a shape: {shape!s:.40}")
    size: int = prod(shape) * KINDS[name].itemsize
    return size


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
        return _graph_description(sample, numbers)
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


def _graph_description(graph: Graph, numbers: list[bytes]) -> list[Any]:
    """Return fields of a graph, number of edges and their bytes; computable pseudo-coordinates are left out."""
    parts = {field.name: getattr(graph, field.name) for field in fields(graph)}
    edges, u, more = graph.edge_index, graph.edge_attr, []
    if edges.is_cpu and u.is_cpu and edges.dtype == torch.int64 and u.dtype == torch.float32:
        code = pack_edges(edges.contiguous().numpy(), graph.num_nodes)
        if code is not None:
            del parts["edge_index"]
            more = [graph.num_edges, _tensor_description(torch.from_numpy(code), numbers)]
            if _bytes_of(u) == _bytes_of(pseudo(graph.pos, graph.t, edges, graph.reach, graph.pseudo)):
                del parts["edge_attr"]
    return ["graph", {name: _description(part, numbers) for name, part in parts.items()}, *more]


def _bytes_of(tensor: torch.Tensor) -> bytes:
    content: bytes = tensor.contiguous().view(-1).view(torch.uint8).numpy().tobytes()
    return content


def _tensor_description(tensor: torch.Tensor, numbers: list[bytes]) -> list[Any]:
    """Return type, shape and device of a tensor, and the smaller type in which its values are added to `numbers`."""
    plain = tensor.detach().resolve_conj().resolve_neg().contiguous().cpu()
    stated = [str(tensor.dtype).removeprefix("torch."), list(tensor.shape), str(tensor.device)]
    if plain.dtype in NARROWED and plain.numel():
        values = plain.view(-1).numpy()
        for kind, steps in SMALLER:
            narrow = _narrowed(values, kind, steps=steps)
            if narrow is not None:
                numbers.append(narrow.tobytes())
                return [*stated, kind, int(steps)]
    numbers.append(_bytes_of(plain))
    return stated


def _narrowed(values: np.ndarray, kind: str, *, steps: bool) -> np.ndarray | None:
    """Return values, or the steps between them, as another type; None unless they are restored with the same bits."""
    if np.dtype(kind).itemsize >= values.itemsize or (steps and values.dtype != np.int64):
        return None
    limits = np.iinfo(kind)
    given = np.diff(values, prepend=values[:1] * 0) if steps else values
    with np.errstate(invalid="ignore"):
        if not (limits.min <= given.min() and given.max() <= limits.max):
            return None
    narrow = given.astype(kind)
    return narrow if _restored(narrow, values.dtype, steps=steps).tobytes() == values.tobytes() else None


def _restored(narrow: np.ndarray, kind: Any, *, steps: bool) -> np.ndarray:
    return np.cumsum(narrow, dtype=kind) if steps else narrow.astype(kind)


def decode_sample(content: memoryview | bytes) -> Any:
    """Restore a sample from the bytes in which nvsdata stores it.

    Args:
        content: the bytes, such as those that `Precomputed.hand_over` passes to WebDataset.

    Returns:
        The sample, with the same bits.

    Raises:
        ValueError: the bytes are others.

    Example:
        >>> from nvsdata.datasets import decode_sample
        >>> from nvsdata.datasets.cache.encoding import encode_sample
        >>> decode_sample(encode_sample([1, "a"]))
        [1, 'a']
    """
    end = bytes(content[: 1 << 16]).find(b"\n") + 1 or bytes(content).find(b"\n") + 1
    numbers = _Numbers(content, end + -end % ALIGNED)
    try:
        stated = json.loads(bytes(content[:end]))
        if _in_memory(stated) > MOST:
            raise ValueError(f"a sample of more than {MOST:,} bytes")
        sample = _decoded(stated, numbers)
    except ValueError:
        raise
    except Exception as error:  # raised by torch or numpy, or by a list in place of something else
        raise ValueError(f"not a sample: {error}") from None
    if numbers.at != len(content):
        raise ValueError("not a sample: more numbers than it describes")
    return sample


class _Numbers:
    """Reader of the values of tensors, one tensor after the other; `at` is the byte at which the next one begins."""

    def __init__(self, content: memoryview | bytes, at: int) -> None:
        self.content, self.at = content, at

    def tensor(self, stated: list[Any]) -> torch.Tensor:
        name, shape, device, *narrowed = stated
        if narrowed:
            return self._widened(name, shape, device, *narrowed)
        kind, size = KINDS[name], _tensor_size(stated)
        # checked before memory is allocated
        if size > len(self.content) - self.at:
            raise ValueError(f"fewer numbers than {shape}")
        if not size:
            return torch.empty(shape, dtype=kind, device=device)
        # a copy, because users may write to it
        numbers = np.frombuffer(self.content[self.at : self.at + size], np.uint8).copy()
        self.at += size + -size % ALIGNED
        if kind is torch.bool and numbers.max() > 1:
            raise ValueError("a boolean that is neither 0 nor 1")
        tensor = torch.from_numpy(numbers).view(kind).reshape(shape)
        return tensor if device == "cpu" else tensor.to(torch.device(device))

    def _widened(self, name: str, shape: list[int], device: str, narrow: str, steps: int) -> torch.Tensor:
        """Return a tensor whose values are stored in the type `narrow`, or as `steps` between them."""
        if KINDS[name] not in NARROWED or (narrow, bool(steps)) not in SMALLER or (steps and name != "int64"):
            raise ValueError(f"{name} stored as {narrow}")
        values = _restored(self.tensor([narrow, [prod(shape)], "cpu"]).numpy(), np.dtype(name), steps=bool(steps))
        return torch.from_numpy(values).reshape(shape).to(torch.device(device))


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
        return _graph(value, numbers, *more)
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


def _graph(stated: dict[str, Any], numbers: _Numbers, count: int | None = None, code: Any = None) -> Graph:
    """Return a graph; `count` edges are stored in `code`, unless they are a field."""
    edges = None if count is None else numbers.tensor(code).numpy()
    parts = {name: _decoded(part, numbers) for name, part in stated.items()}
    if edges is not None and count is not None:
        parts["edge_index"] = torch.from_numpy(unpack_edges(edges, len(parts["x"]), count))
        if "edge_attr" not in parts:
            given = (parts[name] for name in ("pos", "t", "edge_index", "reach", "pseudo"))
            parts["edge_attr"] = pseudo(*given)
    # edges in `code` are verified as they are read
    return _checked_graph(Graph(**parts), edges is not None)


def _checked_graph(graph: Graph, sound: bool) -> Graph:
    """Return the graph; ValueError if its fields contradict each other. `sound` edges aren't verified again."""
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
    if edges.numel() and not sound:
        target = edges[1]
        lowest, highest = torch.aminmax(edges)
        if lowest < 0 or highest >= nodes or bool((target[1:] < target[:-1]).any()):
            raise ValueError("edges between missing nodes, or edges that aren't grouped by target")
    return graph
