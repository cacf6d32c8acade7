"""The registry of transforms by name, and their construction from reprs without running code."""

from __future__ import annotations

import ast
from typing import Any, TypeVar

from nvsdata.common.registry import Registry
from nvsdata.data.camera_model import CameraModel

Kind = TypeVar("Kind", bound=type)

TRANSFORMS: Registry[type] = Registry("transform", "transforms", lambda _, kind: register_transform(kind))

SETTINGS = {"CameraModel": CameraModel}  # plain data that transforms take, by their names in reprs


def register_transform(kind: Kind) -> Kind:
    """Register a transform under the name of its class, so that `from_repr` and `models.load` can build it.

    A package can use an entry point instead (group `nvsdata.transforms`, whose object is the class).

    Args:
        kind: The class. The repr of its instances must be the call that builds them, with literals or other transforms
            as arguments, like the repr of a dataclass.

    Returns:
        The class, so that this is a decorator.

    Raises:
        TypeError: `kind` isn't a class.
        ValueError: The name is taken.

    Example:
        >>> from dataclasses import dataclass
        >>> from nvsdata import transforms as T
        >>> @T.register_transform
        ... @dataclass(frozen=True)
        ... class EveryOther:
        ...     step: int = 2
        ...     def __call__(self, events):
        ...         return events[:: self.step]
        >>> T.from_repr("EveryOther(step=3)")
        EveryOther(step=3)
    """
    if not isinstance(kind, type):
        raise TypeError(f"register_transform takes a class, not {kind!r}")
    return TRANSFORMS.register(kind.__name__, kind)  # type: ignore[return-value]


def from_repr(text: str) -> Any:
    """Build a transform from its repr, without running code.

    Args:
        text: Calls of registered transforms, camera models and literals, such as
            `"Compose([RandomWindow(duration=30000)])"`.

    Returns:
        The transform.

    Raises:
        ValueError: The text contains anything else, or a name that isn't registered.

    Example:
        >>> from nvsdata import transforms as T
        >>> T.from_repr("VoxelGrid(bins=5)")
        VoxelGrid(bins=5, interpolation='linear')
    """
    try:
        built = _value(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError(f"not the repr of a transform: {text[:200]!r} ({error})") from None
    if isinstance(built, tuple(SETTINGS.values())):
        raise ValueError(f"not the repr of a transform, but of a setting: {text[:200]!r}")
    return built


def _value(node: ast.expr) -> Any:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        options = {}
        for keyword in node.keywords:
            if keyword.arg is None:
                raise ValueError("the repr of a transform contains no **")
            options[keyword.arg] = _value(keyword.value)
        return _class_named(node.func.id)(*map(_value, node.args), **options)
    if isinstance(node, ast.List):
        return [_value(item) for item in node.elts]
    if isinstance(node, ast.Tuple):
        return tuple(map(_value, node.elts))
    try:
        return ast.literal_eval(node)
    except ValueError:
        raise ValueError(f"not the repr of a transform: {ast.unparse(node)[:200]!r}") from None


def _class_named(name: str) -> Any:
    if name in SETTINGS:
        return SETTINGS[name]
    try:
        return TRANSFORMS[name]
    except KeyError:
        how = "import the module that defines it, with @nvsdata.transforms.register_transform"
        raise ValueError(f"no transform {name!r} is registered here: {how}") from None
