"""Pairs of frames and events in a file of arrays, for recipes."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from nvsdata import Events, FormatError


def read_arrays(path: Path) -> tuple[np.ndarray, np.ndarray, Events]:
    """Return frames uint8 [F, H, W], their times in µs, and events in the same clock.

    Raises:
        FormatError: It isn't an `.npz` file with frames uint8 [F, H, W], frame_times, t (µs), x, y and p.
    """
    try:
        with np.load(path) as arrays:
            frames, times, t, x, y, p = (arrays[name] for name in ("frames", "frame_times", "t", "x", "y", "p"))
    except (ValueError, KeyError, TypeError, EOFError, BadZipFile) as error:
        # numpy's message would advise to load the file unsafely
        reason = str(error) if isinstance(error, KeyError) else "no .npz file, or damaged"
        raise FormatError(path, f"isn't a file of frames and events: {reason}") from None
    if frames.ndim != 3 or frames.dtype != np.uint8 or not times.size or times.shape != frames.shape[:1]:
        raise FormatError(path, "frames must be uint8 [F, H, W], with F times, at least 1")
    return frames, times, Events(t, x, y, p, (frames.shape[2], frames.shape[1]))
