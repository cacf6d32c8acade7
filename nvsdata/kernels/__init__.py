"""Compiled loops by subject, in C++ with Python wrappers: arrays in, arrays out; no files, no torch.

`native/` has the C++ code that they share. `_native` is the compiled extension module.
"""

try:
    # not `from ... import`, whose error would speak of a circle
    import nvsdata.kernels._native as _native
except ImportError as error:
    raise ImportError(
        f"nvsdata's compiled kernels can't be loaded ({error}): they are missing, or were built for another Python or "
        "processor. `pip install .` in the folder of nvsdata's sources builds them, `pip install nvsdata` fetches them"
    ) from error

__all__ = ["_native"]
