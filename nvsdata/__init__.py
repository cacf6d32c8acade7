"""Datasets, transforms and models for event cameras.

The public names stand in `__init__.pyi`, and are imported when they are first used: `import nvsdata` costs nothing.
"""

import lazy_loader

from nvsdata._version import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
