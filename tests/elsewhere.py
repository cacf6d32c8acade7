"""A pretended device, for machines without a GPU: its tensors hold values, but can't be mixed with the CPU's.

They are computed with on the CPU and report the device "meta", so that code takes the ways that it takes on a GPU,
and what would fail there for lying on two devices, or for being handed to numpy, fails here.
"""

from __future__ import annotations

import torch
from torch.utils._python_dispatch import TorchDispatchMode, return_and_correct_aliasing
from torch.utils._pytree import tree_leaves, tree_map

DEVICE = torch.device("meta")
# what a GPU takes the CPU's tensors for
BETWEEN = {"aten::_to_copy", "aten::copy_", "aten::index.Tensor", "aten::index_put_"}


class Elsewhere(torch.Tensor):
    """A tensor on the pretended device; `value` is what it holds, on the CPU."""

    value: torch.Tensor
    __torch_function__ = torch._C._disabled_torch_function_impl

    @staticmethod
    def __new__(cls, value):
        layout = {"strides": value.stride(), "storage_offset": value.storage_offset()}
        made = torch.Tensor._make_wrapper_subclass(cls, value.shape, dtype=value.dtype, device=DEVICE, **layout)
        made.value = value
        return made

    @classmethod
    def __torch_dispatch__(cls, function, types, args=(), kwargs=None):
        return _called(function, args, kwargs or {})

    def numpy(self, *_, **__):
        raise TypeError("a tensor on another device has no numpy array")

    def new_tensor(self, data, *, dtype=None):
        # torch makes it on the CPU and moves it past all that is seen here
        return Elsewhere(torch.tensor(data, dtype=dtype or self.dtype))


class Factories(TorchDispatchMode):
    """Within it, tensors that are made on the pretended device are there, too."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        return _called(function, args, kwargs or {})


def _called(function, args, kwargs):
    name = function.name()
    tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, torch.Tensor)]
    away = [isinstance(tensor, Elsewhere) for tensor in tensors]
    # single numbers of the CPU may go with any device
    if any(away) and not all(is_away or t.ndim == 0 for is_away, t in zip(away, tensors, strict=True)):
        assert name in BETWEEN, f"{name} of tensors on two devices"
    stays = away[0] if name in BETWEEN and away else any(away)
    if kwargs.get("device") is not None:
        stays = torch.device(kwargs["device"]) == DEVICE
        kwargs = {**kwargs, "device": torch.device("cpu")}
    found = function(*tree_map(_value, args), **tree_map(_value, kwargs))
    if not stays:
        return found
    moved = tree_map(lambda leaf: Elsewhere(leaf) if isinstance(leaf, torch.Tensor) else leaf, found)
    return return_and_correct_aliasing(function, args, kwargs, moved)


def _value(leaf):
    return leaf.value if isinstance(leaf, Elsewhere) else leaf
