"""Datasets, transforms and models for event cameras.

The public names are listed in `__init__.pyi`, and are imported when they are first used, so `import nvsdata` is fast.
"""

from typing import Any

import lazy_loader

from nvsdata._version import __version__ as __version__
from nvsdata.common.notebook import drawers

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _png_of_events(events: Any) -> bytes:
    from nvsdata.plots.show import png

    return png(events)


# registered here, because `nvsdata.data` is below `nvsdata.plots` and can't import it
drawers["Events"] = _png_of_events
