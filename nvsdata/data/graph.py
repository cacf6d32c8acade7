"""Event graphs and batches of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import accumulate
from operator import index as whole_number
from typing import TYPE_CHECKING, Any, Self

import torch

from nvsdata.data.pseudo import Pseudo, Reach, pseudo
from nvsdata.data.pyg import fields_of, is_pyg
from nvsdata.data.pytree import pytree_node
from nvsdata.data.recording import wrong_type
from nvsdata.kernels.graph import edges as kernel

if TYPE_CHECKING:
    from torch_geometric.data import Batch, Data


@pytree_node
@dataclass(frozen=True, eq=False)
class Graph:
    """A directed graph of events (thesis, section 4.2.1): nodes are events, edges join events near in space and time.

    Args:
        x: Node features, float32 [N, F]; polarity as ±1 (F = 1), unless a transform adds others.
        pos: Positions (x, y) in pixels, float32 [N, 2].
        t: Times in µs since the start of the window, int64 [N].
        edge_index: Source and target node of each edge, int64 [2, E], grouped by target node.
        edge_attr: Pseudo-coordinates in [0, 1], float32 [E, D], with D = 2 or 3.
        y: Label of the sample (default None).
        sensor_size: (width, height) in pixels (default None).
        reach: Normalization range of the pseudo-coordinates: pixels along x and y, and µs if D = 3 (default
            (3.0, 3.0)).
        pseudo: Kind of the pseudo-coordinates: "abs" (default), |dx| and |dy|; "signed", dx and dy from target to
            source; "signed-time", these and dt.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.RadiusGraph(3.0)(Events([0, 5], [1, 2], [1, 1], [1, 0]))
        Graph(2 nodes, 2 edges)
    """

    x: torch.Tensor
    pos: torch.Tensor
    t: torch.Tensor
    edge_index: torch.Tensor
    edge_attr: torch.Tensor
    y: Any = None
    sensor_size: tuple[int, int] | None = None
    reach: Reach = (3.0, 3.0)
    pseudo: Pseudo = "abs"

    @property
    def num_nodes(self) -> int:
        """Number of nodes N."""
        return self.x.shape[0]

    @property
    def num_edges(self) -> int:
        """Number of edges E."""
        return self.edge_index.shape[1]

    def to(self, device: torch.device | str, *, non_blocking: bool = False) -> Self:
        """Return the graph on another device."""
        return self._each(lambda tensor: tensor.to(device, non_blocking=non_blocking))

    def pin_memory(self) -> Self:
        """Return the graph in page-locked memory, from which copies to a GPU are fast."""
        return self._each(lambda tensor: tensor.pin_memory())

    def _each(self, change: Callable[[torch.Tensor], torch.Tensor]) -> Self:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        changes: dict[str, Any] = {k: change(v) for k, v in values.items() if isinstance(v, torch.Tensor)}
        return replace(self, **changes)

    def moved(self, pos: torch.Tensor) -> Self:
        """Return the graph with nodes at `pos` float32 [N, 2] and new pseudo-coordinates (CPU only)."""
        return replace(self, pos=pos, edge_attr=pseudo(pos, self.t, self.edge_index, self.reach, self.pseudo))

    @classmethod
    def from_pyg(cls, data: Data) -> Self:
        """Convert a `torch_geometric.data.Data` to a graph; `GraphBatch.from_pyg` converts a `Batch`.

        Args:
            data: Data with `x` [N, F], `pos` [N, 2] (pixels) and `edge_index` [2, E], in any order. Other fields are
                used if they exist, such as `data.reach = (5.0, 5.0)`. Without `t`, all times are 0. Without
                `edge_attr`, pseudo-coordinates are computed from `pos` and `reach`. Without `pseudo`, they are taken
                to be "signed", like those of `torch_geometric.transforms.Cartesian`.

        Raises:
            ValueError: If fields are missing or have another shape; the message names them.
        """
        found = fields_of(data, [field.name for field in fields(cls)])
        if "edge_attr" in found:
            return cls(**found)
        return cls(**found, edge_attr=found["pos"][:0]).moved(found["pos"])

    def to_pyg(self) -> Data:
        """Convert to a `torch_geometric.data.Data`, without fields that are None; needs the extra `pyg`."""
        values = {field.name: getattr(self, field.name) for field in fields(Graph)}
        return _torch_geometric().Data(**{name: value for name, value in values.items() if value is not None})

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.num_nodes} nodes, {self.num_edges} edges)"


@pytree_node
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class GraphBatch(Graph):
    """A batch of B graphs: nodes are concatenated, and node indices in edges are shifted to match.

    The other fields are those of `Graph`. `sensor_size` is the largest width and the largest height among the graphs.
    `y` is a tensor [B], or None if any graph has no label.

    Args:
        batch: Number of each node's graph, int64 [N].
        ptr: int64 [B + 1]; graph b has the nodes ptr[b] to ptr[b + 1] - 1.
        volumes: S, if each sample is a sequence of S graphs; graph b belongs to sample b // S (default 1).

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> graph = T.RadiusGraph(3.0)(Events([0, 5], [1, 2], [1, 1], [1, 0]))
        >>> GraphBatch.from_graphs([graph, graph])
        GraphBatch(2 graphs, 4 nodes, 4 edges)
    """

    batch: torch.Tensor
    ptr: torch.Tensor
    volumes: int = 1

    @property
    def num_graphs(self) -> int:
        """Number of graphs B."""
        return self.ptr.numel() - 1

    @classmethod
    def from_graphs(cls, graphs: Sequence[Graph], *, volumes: int = 1) -> GraphBatch:
        """Concatenate graphs; a single graph isn't copied.

        Args:
            graphs: The graphs, at least one.
            volumes: Number S of graphs of each sample (default 1).

        Raises:
            ValueError: If there are no graphs, or if their `reach` or `pseudo` differs.
        """
        if not graphs:
            raise ValueError("a batch needs at least one graph")
        for name in ("reach", "pseudo"):
            if len(found := {getattr(graph, name) for graph in graphs}) > 1:
                raise ValueError(f"graphs of different {name} in one batch: {sorted(found)}")
        targets = [graph.y for graph in graphs]
        y = None if any(y is None for y in targets) else torch.as_tensor(targets)
        sizes = [graph.sensor_size for graph in graphs if graph.sensor_size is not None]
        size = (max(w for w, _ in sizes), max(h for _, h in sizes)) if sizes else None
        parts = {name: [getattr(graph, name) for graph in graphs] for name in ("x", "pos", "t", "edge_attr")}
        edges = [graph.edge_index for graph in graphs]
        counts = [graph.num_nodes for graph in graphs]
        ptr = torch.tensor([0, *accumulate(counts)])
        if len(graphs) == 1:
            # nothing to copy
            whole: dict[str, Any] = {name: part for name, (part,) in parts.items()}
            edge_index, batch = edges[0], ptr.new_zeros(counts[0])
        else:
            whole = {name: torch.cat(part) for name, part in parts.items()}
            edge_index = torch.cat(edges, 1)
            edge_index += torch.repeat_interleave(ptr[:-1], torch.tensor([part.shape[1] for part in edges]))
            batch = torch.repeat_interleave(torch.arange(len(graphs)), torch.tensor(counts))
        return cls(
            **whole,
            edge_index=edge_index,
            y=y,
            sensor_size=size,
            reach=graphs[0].reach,
            pseudo=graphs[0].pseudo,
            batch=batch,
            ptr=ptr,
            volumes=volumes,
        )

    @classmethod
    def of(cls, graph: Graph | Data) -> GraphBatch:
        """Convert a graph to a batch of one; data of PyTorch Geometric are converted by `from_pyg`."""
        if isinstance(graph, GraphBatch):
            return graph
        if isinstance(graph, Graph):
            return cls.from_graphs([graph.to("cpu")]).to(graph.x.device)
        if is_pyg(graph):
            return cls.from_pyg(graph)
        raise wrong_type("graphs", "a Graph or a GraphBatch", graph)

    def __getitem__(self, number: int) -> Graph:
        """Return graph `number`; negative numbers count from the end. IndexError if there is no such graph."""
        b = whole_number(number)
        if not -self.num_graphs <= b < self.num_graphs:
            raise IndexError(f"no graph {b} in a batch of {self.num_graphs}")
        b %= self.num_graphs
        return self._graph(b, (self._graph_of_edges() == b).nonzero().squeeze(1))

    def to_graphs(self) -> list[Graph]:
        """Return the graphs of the batch. Their `sensor_size` is that of the batch; a label `y` is a number."""
        graph = self._graph_of_edges()
        counts = torch.bincount(graph, minlength=self.num_graphs).tolist()
        each = torch.split(torch.argsort(graph, stable=True), counts)
        return [self._graph(b, edges) for b, edges in enumerate(each)]

    def _graph_of_edges(self) -> torch.Tensor:
        """Return the number of the graph that each edge belongs to, int64 [E]."""
        return self.batch[self.edge_index[1]]

    def _graph(self, b: int, edges: torch.Tensor) -> Graph:
        """Return graph b, whose edges have the indices `edges`."""
        start, stop = self.ptr[b : b + 2].tolist()
        values = {field.name: getattr(self, field.name) for field in fields(Graph)}
        values |= {name: values[name][start:stop] for name in ("x", "pos", "t")}
        values |= {"edge_index": self.edge_index[:, edges] - start, "edge_attr": self.edge_attr[edges]}
        if self.y is not None:
            values["y"] = self.y[b].item() if self.y.ndim == 1 else self.y[b]
        return Graph(**values)

    def to_pyg(self) -> Batch:
        """Convert to a `torch_geometric.data.Batch`; needs the extra `pyg`.

        It has the fields of `Graph.to_pyg`, and `volumes`. Its `to_data_list()` returns the graphs; their `y` is a
        tensor [1], as usual in PyTorch Geometric.
        """
        kind = _torch_geometric().Batch
        labels = [None] * self.num_graphs if self.y is None else torch.split(self.y, 1)
        graphs = [replace(graph, y=y) for graph, y in zip(self.to_graphs(), labels, strict=True)]
        batch = kind.from_data_list([graph.to_pyg() for graph in graphs])
        batch.volumes = self.volumes
        return batch

    def __repr__(self) -> str:
        return f"GraphBatch({self.num_graphs} graphs, {self.num_nodes} nodes, {self.num_edges} edges)"


def grouped(edge_index: torch.Tensor, u: torch.Tensor, nodes: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return sources, targets and pseudo-coordinates `u` of edges, grouped by target. ValueError for invalid edges.

    The tensors must be on the CPU; `nodes` is the number of nodes.
    """
    source, target, u = edge_index[0].contiguous(), edge_index[1].contiguous(), u.detach().contiguous()
    if len(u) != len(source):
        raise ValueError(f"edge_attr has {len(u)} rows for {len(source)} edges")
    code = kernel.check_edges(source.numpy(), target.numpy(), u.numpy(), nodes)
    if code == kernel.NO_SUCH_NODE:
        raise ValueError(f"edge_index names nodes from {edge_index.min()} to {edge_index.max()}; there are {nodes}")
    if code == kernel.NOT_FINITE:
        raise ValueError("edge_attr has numbers that are not finite")
    if code == kernel.GROUPED:
        return source, target, u
    order = torch.argsort(target, stable=True)
    return source[order], target[order], u[order]


def _torch_geometric() -> Any:
    try:
        import torch_geometric.data
    except ImportError as error:
        raise ImportError("to_pyg needs PyTorch Geometric: pip install 'nvsdata[pyg]'") from error
    return torch_geometric.data


def sequence_of(graphs: Any) -> list[Graph]:
    """Return a list or tuple of graphs as a list. TypeError for anything else."""
    if not isinstance(graphs, list | tuple) or not all(isinstance(graph, Graph) for graph in graphs):
        raise wrong_type("graphs", "a Graph or a list of them", graphs)
    return list(graphs)
