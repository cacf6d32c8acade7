"""The registry of networks: what each is called, and what an instance was built with, so that it can be built again."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from torch import nn

Network = TypeVar("Network", bound=type[nn.Module])

NETWORKS: dict[str, type[nn.Module]] = {}


def network(name: str) -> Callable[[Network], Network]:
    """Class decorator: enters a network under `name`, and keeps each instance's arguments as `settings`."""

    def enter(kind: Network) -> Network:
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
        NETWORKS[name] = kind
        return kind

    return enter
