"""Functions that draw objects in notebooks, by class name.

`_repr_png_` of a class looks up its function here, because the class can't import `nvsdata.plots`, which is above it.
"""

from collections.abc import Callable
from typing import Any

drawers: dict[str, Callable[[Any], bytes]] = {}
"""Class name to a function that returns the PNG of an object."""
