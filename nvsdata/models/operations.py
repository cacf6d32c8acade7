"""Numbers of operations and parameters of a network: by formulas (thesis, sections 4.4.4, 5.3.1), and as executed."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from nvsdata.data.graph import GraphBatch
from nvsdata.models.conv import ChebConv, GCNConv, GINConv, GMMConv
from nvsdata.models.counting import Counting
from nvsdata.models.graph_cnn import GCNN, RGCNN
from nvsdata.models.pool import GraphPool
from nvsdata.models.spline import SplineConv
from nvsdata.models.spline_sum import DENSE

CONVOLUTIONS = nn.Conv1d, nn.Conv2d, nn.Conv3d
# modules that count as one layer, together with the modules inside them
LAYERS = SplineConv, GCNConv, ChebConv, GMMConv, GINConv, GraphPool, nn.RNNBase
# operations per value of the state and step, in addition to matrix products: sums, products and activations of gates
GATES = {"LSTM": 9, "GRU": 8, "RNN_TANH": 1, "RNN_RELU": 0}


@dataclass(frozen=True)
class LayerCost:
    """Cost of a layer that computes something or has weights.

    Args:
        name: Name in the network, "" for the network itself.
        kind: Name of the class.
        flops: FLOPs by the thesis's formulas, None for a kind of layer without a formula.
        executed: FLOPs that were executed.
        parameters: Parameters by the thesis's formulas, None for a kind of layer without a formula.
        weights: Number of parameters of the layer.
    """

    name: str
    kind: str
    flops: int | None
    executed: int
    parameters: int | None
    weights: int


@dataclass(frozen=True)
class Complexity:
    """Result of `complexity`; `str()` is a table of its layers.

    Args:
        layers: Layers that compute something or have weights; the last one is the network itself.
        uncounted: Operations that can't be counted, as "layer (class): operation"; empty if `executed` is complete.
        weights: Number of all parameters of the network.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> cost = models.complexity(torch.nn.Linear(3, 2), torch.zeros(1, 3))
        >>> cost.weights, round(cost.size * 2**20)
        (8, 32)
    """

    layers: tuple[LayerCost, ...]
    uncounted: tuple[str, ...]
    weights: int

    @property
    def flops(self) -> int:
        """FLOPs by the thesis's formulas, summed over the layers that have one."""
        return sum(layer.flops or 0 for layer in self.layers)

    @property
    def executed(self) -> int:
        """FLOPs that were executed; a multiply-add counts as two."""
        return sum(layer.executed for layer in self.layers)

    @property
    def parameters(self) -> int:
        """Parameters by the thesis's formulas, summed over the layers that have one."""
        return sum(layer.parameters or 0 for layer in self.layers)

    @property
    def size(self) -> float:
        """Size of `parameters` as float32 in MiB, the unit of Tables 4.4, 4.5 and 4.10 of the thesis."""
        return self.parameters * 4 / 2**20

    def __str__(self) -> str:
        wide = max([len(layer.name) for layer in self.layers] + [8])
        kinds = max([len(layer.kind) for layer in self.layers] + [14])
        columns = "".join(f" {title:>12}" for title in ("MFLOPs", "executed", "parameters", "weights"))
        rows = [f"{'layer':{wide}}  {'class':{kinds}}{columns}"]
        for layer in self.layers:
            flops = "-" if layer.flops is None else f"{layer.flops / 1e6:.3f}"
            parameters = "-" if layer.parameters is None else f"{layer.parameters:,}"
            rows.append(
                f"{layer.name:{wide}}  {layer.kind:{kinds}} {flops:>12} {layer.executed / 1e6:12.3f}"
                f" {parameters:>12} {layer.weights:12,}"
            )
        rows.append(
            f"{'all':{wide}}  {'':{kinds}} {self.flops / 1e6:12.3f} {self.executed / 1e6:12.3f}"
            f" {self.parameters:12,} {self.weights:12,}"
        )
        rows += [f"not counted: {what}" for what in self.uncounted]
        return "\n".join(rows)


def complexity(model: nn.Module, sample: Any) -> Complexity:
    """Count the operations and parameters of a network, by the thesis's formulas and as executed.

    The thesis's formulas count a multiply-add as two operations. A convolution takes 2 HWT (C_in K^d + 1) C_out FLOPs,
    with HWT output positions (eq. 4.11, and its extension to three dimensions). A B-spline convolution follows
    eq. 4.12, with the edges of the graph but no self-loops. A fully connected layer with I inputs and O outputs takes
    (2I - 1) O FLOPs. Convolutions have (C_in K^d + 1) C_out parameters, fully connected layers (C_in + 1) C_out. In the
    first fully connected layer of a graph network, C_in counts channels, not channels times cells. Other layers have no
    formula (root weights, normalization, pooling, other graph convolutions, LSTM).

    Executed operations have the same unit. For a B-spline convolution they include every pair of an edge (or self-loop)
    and a kernel cell with a nonzero weight, and the matrix products of the cells that occur. For convolutions they
    include products with padding. `uncounted` names torch operations without a rule, and modules that compute outside
    torch.

    Args:
        model: Any network. It is run once in evaluation mode; its mode is restored.
        sample: An input of the network, on its device. A batch is counted as a whole.

    Returns:
        A `Complexity`, with the cost of each layer.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.complexity(torch.nn.Linear(3, 2), torch.zeros(1, 3)).flops
        10
    """
    counting, units = Counting(), _units(model)
    formulas: dict[str, list[int]] = {}
    with _in_evaluation(model), _watched(units, counting, formulas), torch.no_grad(), counting:
        model(sample)
    layers = []
    # the network itself comes last
    for name, module in sorted(units.items(), key=lambda unit: unit[0] == ""):
        own = isinstance(module, LAYERS)
        weights = sum(p.numel() for p in module.parameters(recurse=own))
        if weights or counting.flops[name] or _parameters(model, name, module) is not None:
            flops = sum(formulas[name]) if name in formulas else None
            parameters = _parameters(model, name, module)
            layers.append(LayerCost(name, type(module).__name__, flops, counting.flops[name], parameters, weights))
    uncounted = tuple(f"{name} ({type(units[name]).__name__}): {what}" for name, what in sorted(counting.unknown))
    return Complexity(tuple(layers), uncounted, sum(p.numel() for p in model.parameters()))


def _units(model: nn.Module) -> dict[str, nn.Module]:
    """Return all modules by name, except those within one of `LAYERS`."""
    units: dict[str, nn.Module] = {}
    inside = "\0"
    for name, module in model.named_modules():
        if not name.startswith(inside):
            units[name] = module
            inside = (f"{name}." if name else "") if isinstance(module, LAYERS) else inside
    return units


@contextmanager
def _in_evaluation(model: nn.Module) -> Iterator[None]:
    modes = [(module, module.training) for module in model.modules()]
    model.eval()
    try:
        yield
    finally:
        for module, training in modes:
            module.training = training


@contextmanager
def _watched(units: dict[str, nn.Module], counting: Counting, formulas: dict[str, list[int]]) -> Iterator[None]:
    """Report to `counting` which layer runs, and collect the results of the thesis's formulas for each."""

    def before(name: str) -> Callable[..., None]:
        return lambda module, inputs: counting.where.append(None if isinstance(module, tuple(RULES)) else name)

    def after(name: str, begun: dict[str, int]) -> Callable[..., None]:
        def note(module: nn.Module, arguments: Any, options: Any, output: Any) -> None:
            inputs = inspect.signature(module.forward).bind(*arguments, **options).args
            counting.where.pop()
            for kind, rule in {**RULES, **KERNELS}.items():
                if isinstance(module, kind):
                    counting.flops[name] += int(rule(module, inputs, output))
            flops = _flops(module, inputs, output)
            if flops is not None:
                formulas.setdefault(name, []).append(flops)
            seen, begun[name] = counting.seen[name] - begun.get(name, 0), counting.seen[name]
            if not seen and not isinstance(module, tuple(RULES)) and _out_of_sight(module, inputs, output):
                counting.unknown[name, "computation outside torch"] += 1

        return note

    begun: dict[str, int] = {}
    hooks = []
    for name, module in units.items():
        hooks.append(module.register_forward_pre_hook(before(name)))
        hooks.append(module.register_forward_hook(after(name, begun), with_kwargs=True))
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def _out_of_sight(module: nn.Module, inputs: Any, output: Any) -> bool:
    """Return True if a module has no submodules, and returned a tensor that isn't one of its inputs or a view of one.

    If torch executed no operation meanwhile, the module computed this tensor outside torch.
    """
    if next(module.children(), None) is not None or not isinstance(output, torch.Tensor) or output.is_meta:
        return False
    given = {x.untyped_storage().data_ptr() for x in inputs if isinstance(x, torch.Tensor)}
    return output.untyped_storage().data_ptr() not in given


def _parameters(model: nn.Module, name: str, module: nn.Module) -> int | None:
    if isinstance(module, SplineConv):
        cells, channels, out = module.weight.shape
        return int((channels * cells + 1) * out)
    if isinstance(module, CONVOLUTIONS):
        return (module.in_channels // module.groups * math.prod(module.kernel_size) + 1) * module.out_channels
    if isinstance(module, nn.Linear):
        channels = module.in_features
        if isinstance(model, GCNN | RGCNN) and name == "hidden":
            channels //= math.prod(model.grid)
        return (channels + 1) * module.out_features
    return None


def _flops(module: nn.Module, inputs: Any, output: Any) -> int | None:
    if isinstance(module, SplineConv):
        x, edge_index, u = inputs
        # the formula doesn't count the self-loops that networks add
        edges, nodes = int((edge_index[0] != edge_index[1]).sum()), x.shape[0]
        bases = 2 ** u.shape[1]  # (m + 1)^d for degree m = 1
        per_edge = bases * (3 * module.in_channels * module.out_channels + 7 * u.shape[1])
        return int(edges * per_edge + (edges + nodes) * module.out_channels)
    if isinstance(module, CONVOLUTIONS):
        places = output.numel() // module.out_channels
        inner = module.in_channels // module.groups * math.prod(module.kernel_size) + 1
        return int(2 * places * inner * module.out_channels)
    if isinstance(module, nn.Linear):
        return int(output.numel()) * (2 * module.in_features - 1)
    return None


def _aggregation(module: SplineConv, inputs: Any, _: Any) -> int:
    """Count the operations of a B-spline convolution on the CPU: kernel weights, sums over neighbors, products."""
    x, edge_index, u = inputs
    if x.device.type != "cpu":
        return 0
    (edges, axes), (cells, channels, out) = u.shape, module.weight.shape
    # in float64, as in the kernels
    cell, share = _touched(u.detach().to(x.dtype).double().numpy(), module.kernel_size)
    entries = int(share.sum())
    # per edge and axis: a position in the kernel and two weights; per entry: their product, and the mean's division
    bases = edges * 3 * axes * (cells > 1) + entries * axes
    rows = 0
    if cells > 1 and cells * channels > DENSE:
        node = np.broadcast_to(edge_index[1].numpy()[:, None], cell.shape)
        rows = len(np.unique(node[share] * cells + cell[share].astype(np.int64)))
    return int(bases + 2 * entries * channels + rows * out)


def _touched(u: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the 2^d cells around each edge's pseudo-coordinates [E, d], and a mask of nonzero weights, [E, 2^d]."""
    at = np.clip(u, 0, 1) * (size - 1)
    lower = np.minimum(np.floor(at), max(size - 2, 0))
    cell, share = np.zeros((len(u), 1)), np.ones((len(u), 1), bool)
    for axis in range(u.shape[1]):
        upper = at[:, axis] - lower[:, axis]
        near = (lower[:, axis, None] + (0, 1)) * size**axis
        there = np.stack((1 - upper, upper), 1) > 0
        shape = len(u), 2 ** (axis + 1)
        cell = (cell[:, :, None] + near[:, None]).reshape(shape)
        share = (share[:, :, None] & there[:, None]).reshape(shape)
    return cell, share


def _pooling(module: GraphPool, inputs: Any, output: GraphBatch) -> int:
    """Count operations of pooling: means of positions, pseudo-coordinates and, for "average", means of features."""
    (given,) = inputs
    axes = given.pos.shape[1]
    positions = axes * (given.num_nodes + output.num_nodes) + 2 * axes * output.num_edges
    features = given.x.numel() + output.x.numel() if module.mode == "average" else 0
    return int(positions + features)


def _recurrent(module: nn.RNNBase, inputs: Any, output: Any) -> int:
    """Count products of all weights at each step of each sequence, and operations on the gates."""
    x = inputs[0]
    steps = x.data.shape[0] if isinstance(x, nn.utils.rnn.PackedSequence) else x.numel() // module.input_size
    products = sum(2 * p.numel() for p in module.parameters() if p.ndim == 2)
    states = module.num_layers * (2 if module.bidirectional else 1) * module.hidden_size
    total: int = steps * (products + GATES[module.mode] * states)
    return total


# operations of our kernels, in addition to those of torch, which `Counting` counts
KERNELS: dict[type[nn.Module], Callable[[Any, Any, Any], int]] = {SplineConv: _aggregation}
# layers that are counted by a rule alone, because devices compute them in different ways
RULES: dict[type[nn.Module], Callable[[Any, Any, Any], int]] = {GraphPool: _pooling, nn.RNNBase: _recurrent}
