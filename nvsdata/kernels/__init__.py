"""Numba loops: arrays in, arrays out; no classes, no files, no torch."""

import os


def _load_numba() -> None:
    """Load what numba loads at a process's first call, so that forked workers needn't, each for itself.

    That's a second of a DataLoader's start on a busy core, at every epoch unless its workers persist.
    """
    from nvsdata.kernels.compiling import nothing

    nothing()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_load_numba)
