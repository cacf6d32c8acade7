"""The transforms that are known by their names, which their reprs are read by."""

from __future__ import annotations

from typing import Any, TypeVar

from nvsdata.common.registry import Registry

Kind = TypeVar("Kind", bound=type)

TRANSFORMS: Registry[type] = Registry("transform", "transforms", lambda _, kind: register_transform(kind))


def register_transform(kind: Kind) -> Kind:
    """Class decorator: makes a transform known under its class's name, so that `from_repr` and `models.load` build it.

    Its repr must be the call that builds it, with literals or other transforms as arguments, as that of a dataclass
    is. A package does it by an entry point, too (group `nvsdata.transforms`, the object the class). ValueError for a
    name that is taken, TypeError for what is no class.
    """
    if not isinstance(kind, type):
        raise TypeError(f"register_transform takes a class, not {kind!r}")
    return TRANSFORMS.register(kind.__name__, kind)  # type: ignore[return-value]


def transform_named(name: str) -> Any:
    """The class of a transform; ValueError, which says how to register one, if none has the name."""
    try:
        return TRANSFORMS[name]
    except KeyError:
        how = "import the module that defines it, with @nvsdata.transforms.register_transform"
        raise ValueError(f"no transform {name!r} is registered here: {how}") from None
