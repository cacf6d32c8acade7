"""The registry of transforms by name, which `from_repr` reads."""

from __future__ import annotations

from typing import Any, TypeVar

from nvsdata.common.registry import Registry

Kind = TypeVar("Kind", bound=type)

TRANSFORMS: Registry[type] = Registry("transform", "transforms", lambda _, kind: register_transform(kind))


def register_transform(kind: Kind) -> Kind:
    """Class decorator: makes a transform known by the name of its class, so `from_repr` and `models.load` can build it.

    The transform's repr must be the call that builds it, with literals or other transforms as arguments, like the
    repr of a dataclass. A package can use an entry point instead (group `nvsdata.transforms`, whose object is the
    class). ValueError for a name that is taken, TypeError for anything but a class.
    """
    if not isinstance(kind, type):
        raise TypeError(f"register_transform takes a class, not {kind!r}")
    return TRANSFORMS.register(kind.__name__, kind)  # type: ignore[return-value]


def transform_named(name: str) -> Any:
    """The transform class with that name; if there is none, ValueError, which says how to register one."""
    try:
        return TRANSFORMS[name]
    except KeyError:
        how = "import the module that defines it, with @nvsdata.transforms.register_transform"
        raise ValueError(f"no transform {name!r} is registered here: {how}") from None
