"""Number of operations and weights of a network, by the thesis's formulas and as executed (thesis 4.4.4, 5.3.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from nvsdata.kernels.spline import spline_shares
from nvsdata.models.conv import ChebConv, GCNConv, GINConv, GMMConv
from nvsdata.models.graph_cnn import GCNN, RGCNN, ConvBlock, ResidualBlock
from nvsdata.models.spline import SplineConv

BASES = 4  # (m + 1)^d for degree m = 1 in d = 2 dimensions


@dataclass(frozen=True)
class Layer:
    """A layer: its name and class, and its FLOPs and number of parameters by the thesis's formulas."""

    name: str
    kind: str
    flops: int
    parameters: int


@dataclass(frozen=True)
class Complexity:
    """Result of `complexity`. `str()` is a table.

    - `layers`: by the thesis's formulas
    - `executed`: FLOPs of all matrix products, convolutions and B-spline sums that were executed; an addition and a
      multiplication count as two
    - `weights`: number of all parameters of the network
    """

    layers: tuple[Layer, ...]
    executed: int
    weights: int

    @property
    def flops(self) -> int:
        """FLOPs of all layers by the thesis's formulas."""
        return sum(layer.flops for layer in self.layers)

    @property
    def parameters(self) -> int:
        """Parameters of all layers by the thesis's formulas."""
        return sum(layer.parameters for layer in self.layers)

    @property
    def size(self) -> float:
        """MiB of `parameters` as float32: the sizes in thesis Tables 4.4 and 4.5 and, for graph networks, 4.10."""
        return self.parameters * 4 / 2**20

    def __str__(self) -> str:
        wide = max([len(layer.name) for layer in self.layers] + [8])
        rows = [f"{'layer':{wide}}  {'class':14} {'MFLOPs':>12} {'parameters':>12}"]
        rows += [
            f"{layer.name:{wide}}  {layer.kind:14} {layer.flops / 1e6:12.3f} {layer.parameters:12,}"
            for layer in self.layers
        ]
        rows.append(f"{'formulas':{wide}}  {'':14} {self.flops / 1e6:12.3f} {self.parameters:12,}  {self.size:.2f} MiB")
        rows.append(f"{'executed':{wide}}  {'':14} {self.executed / 1e6:12.3f} {self.weights:12,}")
        return "\n".join(rows)


def complexity(model: nn.Module, sample: Any) -> Complexity:
    """Operations and parameters of a network, by the thesis's formulas and as executed.

    - `model`: any network; it is run once in evaluation mode and left as it was
    - `sample`: an input of the network; a batch counts as a whole

    The formulas: a convolution takes 2 HWT (C_in K^d + 1) C_out FLOPs, with HWT output positions (eq. 4.11, and its
    extension to three dimensions); a graph convolution follows eq. (4.12) with the graph's own edges; a fully
    connected layer takes (2I - 1) O. Convolutions have (C_in K^d + 1) C_out parameters, fully connected layers
    (C_in + 1) C_out; in the first fully connected layer of a graph network C_in counts channels, not channels times
    cells. Batch normalization, root weights and everything else that the formulas don't mention count only in
    `weights` and `executed`. Layers without a formula in the thesis (other graph convolutions, LSTM) count as executed.
    """
    counted: dict[str, list[int]] = {}
    sums = [0]
    hooks = []
    units = _units(model)
    for name, module in units.items():
        counted[name] = [0, _parameters(model, name, module)]

        def note(module: nn.Module, inputs: Any, output: Any, name: str = name) -> None:
            counted[name][0] += _flops(module, inputs, output)
            if isinstance(module, SplineConv):
                sums[0] += 2 * _entries(module, *inputs) * module.in_channels

        hooks.append(module.register_forward_hook(note))
    training = model.training
    model.eval()
    try:
        with FlopCounterMode(display=False, custom_mapping=MORE) as counter, torch.no_grad():
            model(sample)
    finally:
        model.train(training)
        for hook in hooks:
            hook.remove()
    by_module = counter.get_flop_counts()
    layers = []
    for name, module in units.items():
        flops, parameters = counted[name]
        if not isinstance(module, WITH_FORMULA):
            flops = sum(by_module.get(f"{type(model).__name__}.{name}", {}).values())
        layers.append(Layer(name, type(module).__name__, flops, parameters))
    weights = sum(p.numel() for p in model.parameters())
    return Complexity(tuple(layers), counter.get_total_flops() + sums[0], weights)


WITH_FORMULA = (SplineConv, nn.Conv2d, nn.Conv3d, nn.Linear)
AS_THEY_ARE = (GCNConv, ChebConv, GMMConv, GINConv, nn.LSTM)


def _units(model: nn.Module) -> dict[str, nn.Module]:
    """The layers that are counted, by name."""
    units: dict[str, nn.Module] = {}
    # a user's own convolution is one layer, whatever it consists of
    convolutions = {block.conv for block in model.modules() if isinstance(block, ConvBlock | ResidualBlock)}
    for name, module in model.named_modules():
        within = any(name.startswith(unit + ".") for unit in units)
        if not within and (module in convolutions or isinstance(module, (*WITH_FORMULA, *AS_THEY_ARE))):
            units[name] = module
    return units


def _parameters(model: nn.Module, name: str, module: nn.Module) -> int:
    if isinstance(module, SplineConv):
        return (module.in_channels * module.kernel_size**2 + 1) * module.out_channels
    if isinstance(module, nn.Conv2d | nn.Conv3d):
        return (module.in_channels // module.groups * math.prod(module.kernel_size) + 1) * module.out_channels
    if isinstance(module, nn.Linear):
        channels = module.in_features
        if isinstance(model, GCNN | RGCNN) and name == "hidden":
            # in Table 4.4, 512 channels enter FC(1024) at all depths, even where the last layer gives 256
            channels = max(channels // (model.grid[0] * model.grid[1]), module.out_features // 2)
        return (channels + 1) * module.out_features
    return sum(p.numel() for p in module.parameters())


def _flops(module: nn.Module, inputs: Any, output: Any) -> int:
    if isinstance(module, SplineConv):
        edges, nodes = _edges(inputs[1]), inputs[0].shape[0]
        per_edge = BASES * (3 * module.in_channels * module.out_channels + 7 * 2)
        return int(edges * per_edge + (edges + nodes) * module.out_channels)
    if isinstance(module, nn.Conv2d | nn.Conv3d):
        places = output.numel() // module.out_channels
        inner = module.in_channels // module.groups * math.prod(module.kernel_size) + 1
        return int(2 * places * inner * module.out_channels)
    if isinstance(module, nn.Linear):
        return int(output.numel()) * (2 * module.in_features - 1)
    return 0


def _edges(edge_index: torch.Tensor) -> int:
    """Number of the graph's own edges, without the self-loops that networks add."""
    return int((edge_index[0] != edge_index[1]).sum())


def _entries(module: SplineConv, x: torch.Tensor, edge_index: torch.Tensor, u: torch.Tensor) -> int:
    """Number of (edge, cell) pairs that contribute to the sums."""
    arrays = edge_index[0].cpu().numpy(), edge_index[1].cpu().numpy(), u.cpu().numpy()
    return len(spline_shares(*arrays, module.kernel_size, x.shape[0])[0])


def _product(_: Any, a: Any, b: Any, *args: Any, **options: Any) -> int:
    return 2 * int(a[0]) * int(a[1]) * int(b[1])


def _lstm(x: Any, *arguments: Any, **options: Any) -> int:
    # [T, B, in] and weights [4 h, in], [4 h, h]
    (time, batch, _), into, again = x, arguments[0], arguments[1]
    return 2 * int(time) * int(batch) * int(into[0]) * (int(into[1]) + int(again[1]))


# operations that torch's counter leaves out
MORE: dict[Any, Callable[..., int]] = {
    torch.ops.aten.addmm_: _product,
    torch.ops.aten.mkldnn_rnn_layer: _lstm,
}
