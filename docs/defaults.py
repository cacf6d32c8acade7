"""Extension of griffe: signatures show the values of constants in place of their names, such as 8 for DEGREE."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import griffe


class Defaults(griffe.Extension):
    """Replace names of constants by their values, in defaults of functions and of fields of dataclasses."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Replace the value of a class's field."""
        if attr.parent is not None and attr.parent.is_class:
            attr.value = _value(attr.value, attr.parent)

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Replace the defaults of parameters."""
        for one in func.parameters:
            one.default = _value(one.default, func)


def _value(default: Any, owner: griffe.Object) -> Any:
    name = str(default)
    if not name.isidentifier() or not name.isupper():
        return default
    value = getattr(import_module(owner.module.path), name, None)
    return repr(value) if isinstance(value, int | float | str) else default
