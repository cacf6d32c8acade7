"""Functions that draw objects in notebooks, by class name: whoever can draw registers one, and the class looks it up."""

from collections.abc import Callable
from typing import Any

drawers: dict[str, Callable[[Any], bytes]] = {}
"""Each returns a PNG."""
