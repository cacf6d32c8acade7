"""Building transforms from their reprs, without running code."""

from __future__ import annotations

import ast
from typing import Any

from nvsdata.transforms.registry import transform_named


def from_repr(text: str) -> Any:
    """The transform with the repr `text`, which may only contain calls of registered transforms, and literals.

    ValueError for anything else.
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError(f"not the repr of a transform: {text[:200]!r} ({error})") from None


def _value(node: ast.expr) -> Any:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        options = {}
        for keyword in node.keywords:
            if keyword.arg is None:
                raise ValueError("a repr holds no **")
            options[keyword.arg] = _value(keyword.value)
        return transform_named(node.func.id)(*map(_value, node.args), **options)
    if isinstance(node, ast.List):
        return [_value(item) for item in node.elts]
    if isinstance(node, ast.Tuple):
        return tuple(map(_value, node.elts))
    try:
        return ast.literal_eval(node)
    except ValueError:
        raise ValueError(f"not the repr of a transform: {ast.unparse(node)[:200]!r}") from None
