"""Count of the floating-point operations that torch executes for a network."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry

aten = torch.ops.aten


class Counting(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Counter of the floating-point operations that torch executes in a `with` block, by layer.

    Attributes:
        where: Stack of names of layers. Operations count for the last one; if that is None, they aren't counted.
        flops: Number of operations of each layer.
        unknown: Number of calls of each function without a rule, by layer and function.
        seen: Number of calls that made new values, by layer.

    A multiply-add counts as two operations. Any other sum, product or quotient of two numbers, and any value of a
    function (a square root, an exponential), counts as one. Copies, selections, comparisons (a maximum, ReLU) and
    operations on integers aren't counted.
    """

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.where: list[str | None] = [""]
        self.flops: Counter[str] = Counter()
        self.unknown: Counter[tuple[str, str]] = Counter()
        self.seen: Counter[str] = Counter()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        rule = _rule(func)
        if rule is None:
            # in inference mode, torch doesn't decompose composite operations itself
            with self:
                parts = func.decompose(*args, **kwargs)
            if parts is not NotImplemented:
                return parts
        out = func(*args, **kwargs)
        name = self.where[-1]
        if name is not None and not func.is_view:
            self.seen[name] += 1
            if rule is None and _real(out):
                self.unknown[name, str(func.overloadpacket)] += 1
            elif rule is not None:
                self.flops[name] += int(rule(out, *args, **kwargs))
        return out


def _rule(func: Any) -> Callable[..., float] | None:
    """Return the rule that counts the operations of a torch function from its result and arguments; None if unknown."""
    packet = func.overloadpacket
    if packet in flop_registry and not str(packet).endswith("backward"):
        return lambda out, /, *args, **kwargs: flop_registry[packet](*args, **kwargs, out_val=out)
    name = str(packet).removeprefix("aten.")
    plain = name.removesuffix("_")
    if func.is_view or plain in NONE or name in NONE:
        return lambda out, /, *args, **kwargs: 0
    if name in SUMS:
        return SUMS[name]
    if plain in SUMS:
        return SUMS[plain]
    return _each if torch.Tag.pointwise in func.tags else None


def _real(out: Any) -> bool:
    """Return True if a result, or one of several results, is a tensor of floating-point or complex numbers."""
    if isinstance(out, list | tuple):
        return any(map(_real, out))
    return isinstance(out, torch.Tensor) and (out.is_floating_point() or out.is_complex())


def _each(out: Any, /, *_: Any, **__: Any) -> int:
    """Count one operation per value of a result, or of several results."""
    parts = out if isinstance(out, list | tuple) else (out,)
    return sum(part.numel() for part in parts if _real(part))


def _twice(out: torch.Tensor, /, *_: Any, **__: Any) -> int:
    """Count two operations per value of the result."""
    return 2 * _each(out)


def _added(out: torch.Tensor, x: torch.Tensor, /, *_: Any, **__: Any) -> int:
    """Count one addition per value that is summed."""
    return x.numel() if _real(out) else 0


def _mean(out: torch.Tensor, x: torch.Tensor, /, *_: Any, **__: Any) -> int:
    return x.numel() + out.numel()


def _rows(out: torch.Tensor, x: torch.Tensor, axis: int, index: Any, source: Any, /, *_: Any, **__: Any) -> int:
    """Count one addition per value of `source` (index_add, scatter_add)."""
    return source.numel() if isinstance(source, torch.Tensor) and _real(out) else 0


def _product(out: torch.Tensor, a: torch.Tensor, b: torch.Tensor, /, *_: Any, **__: Any) -> int:
    """Count a multiplication and an addition per value of a matrix or vector `a` (mv, dot)."""
    return 2 * a.numel()


def _added_product(out: torch.Tensor, start: Any, a: torch.Tensor, b: torch.Tensor, /, *_: Any, **__: Any) -> int:
    return 2 * a.shape[0] * a.shape[1] * b.shape[1]


def _normalized(out: Any, x: torch.Tensor, w: Any, b: Any, mean: Any, var: Any, own: bool, /, *_: Any) -> int:
    """Count operations per value: 2 for scale and shift, and 4 if mean and variance are computed (`own`)."""
    return (6 if own else 2) * x.numel()


def _distances(out: torch.Tensor, a: torch.Tensor, b: torch.Tensor, /, *_: Any, **__: Any) -> int:
    """Count differences, squares, their sum and a root for each pair of rows."""
    return out.numel() * (3 * a.shape[-1] + 1)


def _averaged(out: torch.Tensor, x: torch.Tensor, kernel: Any, /, *_: Any, **__: Any) -> int:
    dimensions = x.ndim - 2
    sides = list(kernel) * dimensions if len(kernel) == 1 else kernel
    return int(out.numel() * (math.prod(sides) + 1))


def _adaptive(out: torch.Tensor, x: torch.Tensor, size: Any, /, *_: Any, **__: Any) -> int:
    """Count the additions in each pooling window, and a division; windows of uneven sizes overlap."""
    values = math.prod(x.shape[: x.ndim - len(size)])
    for side, count in zip(x.shape[x.ndim - len(size) :], size, strict=True):
        values *= sum(-(-(n + 1) * side // count) - n * side // count for n in range(count))
    return values + out.numel()


SUMS: dict[str, Callable[..., float]] = {
    "sum": _added,
    "cumsum": _added,
    "mean": _mean,
    "index_add": _rows,
    "scatter_add": _rows,
    "mv": _product,
    "dot": _product,
    # torch's own registry has no rules for the rest
    "addmm_": _added_product,
    "addcmul": _twice,
    "addcdiv": _twice,
    "lerp": _twice,
    "_prelu_kernel": _each,
    "native_batch_norm": _normalized,
    "cudnn_batch_norm": _normalized,
    "_cdist_forward": _distances,
    "avg_pool2d": _averaged,
    "avg_pool3d": _averaged,
    "_adaptive_avg_pool2d": _adaptive,
    "_adaptive_avg_pool3d": _adaptive,
}

# functions without counted operations: copies, selections and comparisons
NONE = frozenset(
    "abs amax amin arange argmax argmin bincount bitwise_and cat ceil clamp clamp_max clamp_min clone constant_pad_nd"
    " copy _to_copy detach dropout embedding empty empty_like empty_strided eq eye fill flip floor full full_like"
    " gather ge gt hardtanh index index_copy index_put index_select isnan leaky_relu le lift_fresh _local_scalar_dense"
    " lt masked_fill max max_pool2d_with_indices max_pool3d_with_indices maximum min minimum nan_to_num native_dropout"
    " ne neg new_empty new_empty_strided new_full new_ones new_zeros nonzero ones ones_like pad randint relu repeat"
    " _reshape_copy resize roll round scalar_tensor scatter scatter_reduce select_backward set sign slice_backward sort"
    " split_with_sizes_copy stack threshold topk trunc unique_dim _unique2 _unsafe_view where zero zeros zeros_like"
    " _reshape_alias max_pool2d mkldnn_max_pool2d mkldnn_max_pool3d".split()
)
