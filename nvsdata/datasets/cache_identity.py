"""A transform as a string that is the same in every process, and differs if its settings differ."""

from __future__ import annotations

import hashlib
import re
import types
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from itertools import chain
from pathlib import PurePath
from typing import Any

import numpy as np
import torch
from torch import nn

PLAIN = (type(None), bool, int, float, complex, str, bytes, PurePath, Enum, torch.dtype, torch.device, np.dtype)
ADDRESS = re.compile(r"\bat 0x[0-9a-f]+", re.IGNORECASE)
FUNCTIONS = (
    types.FunctionType,
    types.BuiltinFunctionType,
    types.MethodType,
    types.BuiltinMethodType,
    np.ufunc,
    partial,
)


def described(thing: Any) -> str:
    """The string: class and fields of a dataclass; class and `__repr__` of anything else.

    TypeError for things that don't show their settings: functions; objects whose `__repr__` is that of `object`, of
    `torch.nn.Module`, or of a base class of the one that defines `__init__`; and those whose `__repr__` contains an
    address or is shortened ("...").
    """
    if isinstance(thing, PLAIN):
        return f"{type(thing).__qualname__} {thing!r}"
    if isinstance(thing, torch.Tensor):
        content = thing.detach().cpu().contiguous().view(-1).view(torch.uint8).numpy().tobytes()
        return f"{type(thing).__qualname__} {thing.dtype} {thing.shape} {hashlib.sha256(content).hexdigest()}"
    if isinstance(thing, np.ndarray | np.generic):
        values = np.asarray(thing)
        content = np.ascontiguousarray(values).tobytes()
        digest = described(values.tolist()) if values.dtype.hasobject else hashlib.sha256(content).hexdigest()
        return f"{type(thing).__qualname__} {values.dtype} {values.shape} {digest}"
    if isinstance(thing, type):
        return f"class {thing.__module__}.{thing.__qualname__}"
    name = f"{type(thing).__module__}.{type(thing).__qualname__}"
    if isinstance(thing, list | tuple):
        return f"{name}[{', '.join(map(described, thing))}]"
    if isinstance(thing, set | frozenset):
        return f"{name}[{', '.join(sorted(map(described, thing)))}]"
    if isinstance(thing, dict):
        return f"{name}[{', '.join(f'{described(key)}: {described(value)}' for key, value in thing.items())}]"
    if isinstance(thing, FUNCTIONS):
        raise TypeError(_advice(thing, "is a function, which doesn't say what it does"))
    if is_dataclass(thing):
        settings = {field.name: getattr(thing, field.name, None) for field in fields(thing)}
        # and other attributes, such as those that a subclass sets
        settings |= getattr(thing, "__dict__", {})
        return f"{name}({', '.join(f'{setting}={described(value)}' for setting, value in settings.items())})"
    if isinstance(thing, nn.Module):
        return f"{name}: {_described_module(thing)}"
    text = repr(thing)
    if _silent(type(thing), "__repr__", object) or ADDRESS.search(text) or "..." in text:
        raise TypeError(_advice(thing, "has a repr that doesn't say its settings"))
    return f"{name}: {text}"


def _described_module(module: nn.Module) -> str:
    if _inherits(module, nn.Module):
        if any(True for _ in chain(module.parameters(), module.buffers())):
            raise TypeError(_advice(module, "has weights, which its repr doesn't say"))
        for part in module.modules():
            silent = _inherits(part, nn.Module) and _silent(type(part), "extra_repr", nn.Module)
            if silent and not isinstance(part, nn.Sequential | nn.ModuleList | nn.ModuleDict):
                raise TypeError(_advice(part, "is a Module without an extra_repr that says its settings"))
    return repr(module)


def _inherits(thing: Any, base: type, method: str = "__repr__") -> bool:
    """Whether a method is the one that `base` defines."""
    return getattr(type(thing), method) is getattr(base, method)


def _silent(kind: type, method: str, base: type) -> bool:
    """Whether `method` comes from `base`, or from a base class of the one whose `__init__` takes the settings."""
    for one in kind.__mro__:
        if method in vars(one):
            return one is base
        if "__init__" in vars(one) and one is not base:
            return True
    return True


def _advice(thing: Any, what: str) -> str:
    return (
        f"{thing!r} {what}, so a cache can't distinguish it from others: make it a dataclass whose fields are its "
        "settings, or give its class a __repr__ that names them"
    )
