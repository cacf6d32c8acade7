"""The registry of networks by name; instances store their constructor arguments, so that they can be built again."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from torch import nn

from nvsdata.common.registry import Registry

Network = TypeVar("Network", bound=type[nn.Module])

NETWORKS: Registry[type[nn.Module]] = Registry("network", "networks", lambda _, kind: _decorated(kind))


def register_network(name: str) -> Callable[[Network], Network]:
    """Return a class decorator that registers a network under `name`.

    `models.save`, `models.load` and `models.NETWORKS` then know the network. Each instance stores its constructor
    arguments (`settings`), which must be representable in JSON, and its name (`kind`). A subclass of a network needs a
    name of its own. A package can use an entry point instead (group `nvsdata.networks`, with the name and the class).

    Args:
        name: Name of the network.

    Returns:
        The decorator, which returns the class.

    Raises:
        ValueError: For a name that is taken.
        TypeError: For anything but a subclass of torch.nn.Module, and for a constructor with * or ** arguments.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> @models.register_network("example-linear")
        ... class Linear(torch.nn.Linear):
        ...     def __init__(self, num_classes: int) -> None:
        ...         super().__init__(2, num_classes)
        >>> Linear(3).settings
        {'num_classes': 3}
    """

    def enter(kind: Network) -> Network:
        if not (isinstance(kind, type) and issubclass(kind, nn.Module)):
            raise TypeError(f"register_network takes a subclass of torch.nn.Module, not {kind!r}")
        build = kind.__init__
        # a network without __init__ inherits that of nn.Module, which accepts any arguments
        signature = inspect.signature(_without_arguments if build is nn.Module.__init__ else build)
        unnamed = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD, inspect.Parameter.POSITIONAL_ONLY)
        if any(parameter.kind in unnamed for parameter in list(signature.parameters.values())[1:]):
            raise TypeError(f"{kind.__name__} can't be built again from a file: its arguments need names, not * or **")
        NETWORKS.register(name, kind)

        @functools.wraps(build)
        def noting(self: nn.Module, *args: Any, **options: Any) -> None:
            bound = signature.bind(self, *args, **options)
            bound.apply_defaults()
            build(self, *args, **options)
            self.settings = dict(list(bound.arguments.items())[1:])  # type: ignore[assignment]
            self.kind = name  # type: ignore[assignment]

        setattr(kind, "__init__", noting)  # noqa: B010
        return kind

    return enter


def _without_arguments(self: nn.Module) -> None:
    """Signature of a network without arguments."""


def _decorated(kind: Any) -> None:
    """Raise TypeError for the class of an entry point that isn't decorated, because its instances can't be saved."""
    raise TypeError(f"{kind!r} isn't decorated with @register_network('a-name')")
