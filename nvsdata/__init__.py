"""Datasets, transforms and models for event cameras.

    read, open, write, example       recordings of all formats; `example` makes events without a file
    EventFolder                      a folder with a subfolder of recordings per class
    NMNIST, NCARS, DVS128Gesture...  published datasets
    transforms                       graphs, frames and other tensors, augmentation, filters
    collate                          batches: DataLoader(dataset, collate_fn=nvsdata.collate)
    windows, pack, cache             parts of long recordings, datasets that are read faster
    models, metrics                  networks, and measures of their results and of events
    PIX2NVS, emulation               video to events
    plot, plots                      figures of events, graphs and tensors

`help(nvsdata.read)` describes one name, and `nvsdata --help` in the shell lists the commands.

The public names are listed in `__init__.pyi`, and are imported when they are first used, so `import nvsdata` is fast.

Example:
    >>> import nvsdata
    >>> from nvsdata import transforms as T
    >>> T.ToFrames(bins=10)(nvsdata.example()).shape
    torch.Size([10, 2, 180, 240])
"""

from typing import Any

import lazy_loader

from nvsdata._version import __version__ as __version__
from nvsdata.common.notebook import drawers

_imported, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# names that torchvision has for these
_ELSEWHERE = {"DatasetFolder": "EventFolder", "ImageFolder": "EventFolder"}


def __getattr__(name: str) -> Any:
    if name in _ELSEWHERE:
        # Python doesn't show the text of an AttributeError of `from nvsdata import ...`, but that of an ImportError
        raise ImportError(f"module {__name__!r} has no attribute {name!r}; it is {_ELSEWHERE[name]} here")
    return _imported(name)


def _png_of_events(events: Any) -> bytes:
    from nvsdata.plots.show import png

    return png(events)


# registered here, because `nvsdata.data` is below `nvsdata.plots` and can't import it
drawers["Events"] = _png_of_events
