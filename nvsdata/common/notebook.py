"""Functions that draw objects in notebooks, by class name: plots registers them, and the classes look them up."""

from collections.abc import Callable
from typing import Any

drawers: dict[str, Callable[[Any], bytes]] = {}
"""Each returns a PNG."""
