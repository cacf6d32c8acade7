"""Registration of data classes of tensors as pytrees of torch, for `torch.export`, `torch.func` and `tree_map`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, TypeVar

import torch
from torch.utils._pytree import GetAttrKey, KeyEntry, register_pytree_node

Kind = TypeVar("Kind", bound=type)
# names of the leaves; names and values of the other fields
Context = tuple[tuple[str, ...], tuple[tuple[str, Any], ...]]


def pytree_node(kind: Kind) -> Kind:
    """Register a data class as a pytree: fields that are tensors are leaves, all others are its context.

    `torch.export.save` stores the context as JSON. An exported network takes only objects whose context is equal to
    that of its example input.
    """

    def flatten(value: Any) -> tuple[list[Any], Context]:
        given = {field.name: getattr(value, field.name) for field in fields(kind)}
        leaves = {name: held for name, held in given.items() if isinstance(held, torch.Tensor)}
        return list(leaves.values()), (tuple(leaves), tuple(item for item in given.items() if item[0] not in leaves))

    def unflatten(leaves: Iterable[Any], context: Context) -> Any:
        return kind(**dict(zip(context[0], leaves, strict=True)), **dict(context[1]))

    def with_keys(value: Any) -> tuple[list[tuple[KeyEntry, Any]], Context]:
        leaves, context = flatten(value)
        return [(GetAttrKey(name), leaf) for name, leaf in zip(context[0], leaves, strict=True)], context

    register_pytree_node(
        kind,
        flatten,
        unflatten,
        serialized_type_name=f"{kind.__module__}.{kind.__qualname__}",
        to_dumpable_context=lambda context: context,
        from_dumpable_context=_tuples,
        flatten_with_keys_fn=with_keys,
    )
    # example inputs of an exported network are pickled; these classes contain data only
    torch.serialization.add_safe_globals([kind])
    return kind


def _tuples(value: Any) -> Any:
    """Convert lists, which JSON has in place of tuples, to tuples; also nested ones."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
