"""Sum of a B-spline convolution by classes of edges with equal pseudo-coordinates, by Triton on GPUs.

Each class has one matrix, the sum of the kernel's cells times their B-splines. Triton multiplies the features of the
sources of all edges of a class by it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import torch
from torch.autograd.function import once_differentiable


def corners(u: torch.Tensor, kernel_size: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
    """Yield the kernel cell, int64 [E], and the weight [E] at each corner around pseudo-coordinates [E, D]."""
    v = u.clamp(0, 1) * (kernel_size - 1)
    # NaN has no integer value; `upper` keeps it
    lower = v.nan_to_num(0).floor().clamp(max=max(kernel_size - 2, 0)).long()
    upper = v - lower
    for corner in itertools.product(range(min(kernel_size, 2)), repeat=v.shape[1]):
        cell, share = torch.zeros_like(lower[:, 0]), torch.ones_like(upper[:, 0])
        # one number at a time, because a tensor of the corner would have to be copied to the device
        for axis, above in enumerate(corner):
            cell = cell + (lower[:, axis] + above) * kernel_size**axis
            share = share * (upper[:, axis] if above else 1 - upper[:, axis])
        yield cell, share


def class_sum(
    out: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> torch.Tensor | None:
    """Add the sum of `SplineConv` to `out` in place; None if the edges have no or too many classes.

    Edges have many classes if nodes aren't on a grid, or if the pseudo-coordinates contain the time. A kernel of one
    cell needs no classes.
    """
    from nvsdata.kernels.triton.spline import offset_classes

    u = edge_attr.detach()
    if kernel_size == 1 or u.shape[1] != 2 or u.dtype != torch.float32 or not len(u):
        return None
    if not x.dtype == weight.dtype == out.dtype:
        return None
    classes = offset_classes(edge_index, u, x.shape[0])
    if classes is None:
        return None
    shares = x.new_zeros(len(classes.u), weight.shape[0])
    for cell, share in corners(classes.u.to(x.dtype), kernel_size):
        shares.scatter_add_(1, cell.unsqueeze(1), share.unsqueeze(1))
    table = (shares @ weight.reshape(weight.shape[0], -1)).view(-1, *weight.shape[1:])
    given: torch.Tensor = _ClassSum.apply(out, x, table, classes)  # type: ignore[no-untyped-call]
    return given


class _ClassSum(torch.autograd.Function):
    """Add the products of features and the matrices of `table` [K, C_in, C_out] to `out`, by Triton."""

    @staticmethod
    def forward(ctx: Any, out: torch.Tensor, x: torch.Tensor, table: torch.Tensor, classes: Any) -> torch.Tensor:
        from nvsdata.kernels.triton.spline import add_products

        x = x.contiguous()
        add_products(out, classes.target, x, classes.source, table, classes)
        ctx.mark_dirty(out)
        ctx.save_for_backward(x, table)
        ctx.classes = classes
        return out

    @staticmethod
    @once_differentiable  # otherwise, second derivatives would be silently wrong
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        from nvsdata.kernels.triton.spline import add_products, table_gradient

        x, table = ctx.saved_tensors
        _, to_x, to_table, _ = ctx.needs_input_grad
        classes, given, d_x = ctx.classes, gradient.contiguous(), None
        if to_x:
            d_x = torch.zeros_like(x)
            add_products(d_x, classes.source, given, classes.target, table.transpose(1, 2), classes)
        d_table = table_gradient(given, x, classes) if to_table else None
        return gradient, d_x, d_table, None
