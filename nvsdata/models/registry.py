"""The registry of networks: what each is called, and what an instance was built with, so that it can be built again."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from torch import nn

from nvsdata.common.registry import Registry

Network = TypeVar("Network", bound=type[nn.Module])

NETWORKS: Registry[type[nn.Module]] = Registry("network", "networks", lambda name, kind: register_network(name)(kind))


def register_network(name: str) -> Callable[[Network], Network]:
    """Class decorator: makes a network known under `name` to `models.save`, `models.load` and `models.NETWORKS`.

    Each instance keeps the arguments it was built with (`settings`), which JSON must be able to hold, and its name
    (`kind`). A subclass of a network is registered under a name of its own. A package does it by an entry point, too
    (group `nvsdata.networks`, the name and the class). ValueError for a name that is taken, TypeError for what is no
    class of modules.
    """

    def enter(kind: Network) -> Network:
        if not (isinstance(kind, type) and issubclass(kind, nn.Module)):
            raise TypeError(f"register_network takes a subclass of torch.nn.Module, not {kind!r}")
        NETWORKS.register(name, kind)
        build = kind.__init__
        signature = inspect.signature(build)

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
