"""Functions that draw objects in notebooks, by class name. A class looks up its own; a package above registers it."""

from collections.abc import Callable
from typing import Any

drawers: dict[str, Callable[[Any], bytes]] = {}
"""Each returns a PNG."""
