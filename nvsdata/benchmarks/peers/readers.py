"""Readers of event files in other libraries, and the columns of what they return."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.data.events import Events

Reader = Callable[[Path], Callable[[], Any]]
TONIC = np.dtype([("x", int), ("y", int), ("t", int), ("p", int)])  # of its structured arrays
MASKS = 127, 127, 1  # of x, y and polarity of a DVS128
NAMES = ("t", "ts", "timestamp"), ("x",), ("y",), ("p", "on", "polarity")


def columns_of(found: Any) -> tuple[np.ndarray, ...]:
    """Return t, x, y and p of events, a structured array, a dict or table of columns, or a stream of eventcv."""
    if isinstance(found, Events):
        return found.columns
    if hasattr(found, "numpy"):
        x, y, t, p = found.numpy().T
        return t, x, y, p
    names = found.dtype.names if isinstance(found, np.ndarray) else getattr(found, "columns", found)
    t, x, y, p = (np.asarray(found[next(name for name in names if name in any_)]) for any_ in NAMES)
    # some have polarities of -1 and 1
    return t.astype(np.int64), x, y, p > 0


def differing(events: Events, found: Any) -> float:
    """Count the events that differ; if the numbers of events differ, return their difference."""
    theirs = columns_of(found)
    if len(theirs[0]) != len(events):
        return float(abs(len(theirs[0]) - len(events)))
    wrong = np.zeros(len(events), bool)
    for ours, other in zip(events.columns, theirs, strict=True):
        wrong |= ours != other
    return float(np.count_nonzero(wrong))


def _expelliarmus(kind: str, path: Path) -> Callable[[], Any]:
    from expelliarmus import Wizard

    wizard = Wizard(kind)
    return lambda: wizard.read(str(path))


def _faery(path: Path) -> Callable[[], Any]:
    import faery

    return lambda: faery.events_stream_from_file(path).to_array()


def _evlib(path: Path) -> Callable[[], Any]:
    import evlib

    return lambda: evlib.load_events(str(path)).collect()


def _eventcv(path: Path, **known: Any) -> Callable[[], Any]:
    import eventcv

    return lambda: eventcv.load(str(path), **known)


def _aedat(path: Path) -> Callable[[], Any]:
    import aedat

    def run() -> Any:
        packets = [packet["events"] for packet in aedat.Decoder(path) if "events" in packet]
        return np.concatenate(packets)

    return run


def _tonic_digits(path: Path) -> Callable[[], Any]:
    from tonic import io

    return lambda: io.read_mnist_file(str(path), TONIC)


def _tonic_aedat(version: float, shifts: tuple[int, int, int], flips: bool, path: Path) -> Callable[[], Any]:
    """Read with parts of tonic: the readers of tonic 1.7.0 raise an error on the result of its own header reader.

    In AEDAT 2, the address of a DVS128 counts from the bottom right, and 1 is OFF.
    """
    from tonic import io

    def run() -> Any:
        start = io.read_aedat_header_from_file(str(path))[1]
        raw = io.get_aer_events_from_file(str(path), version, start)
        x, y, p = (raw["address"] >> shift & mask for shift, mask in zip(shifts, MASKS, strict=True))
        if flips:
            x, y, p = (mask - field for field, mask in zip((x, y, p), MASKS, strict=True))
        return io.make_structured_array(x, y, raw["timeStamp"], p)

    return run


READERS: dict[str, dict[str, Reader]] = {
    ".bin": {"tonic": _tonic_digits},
    ".dat": {"expelliarmus": partial(_expelliarmus, "dat"), "faery": _faery, "eventcv": _eventcv},
    ".aedat": {"tonic": partial(_tonic_aedat, 2.0, (1, 8, 0), True)},
    ".aedat3": {"tonic": partial(_tonic_aedat, 3.1, (17, 2, 1), False)},
    ".aedat4": {"aedat": _aedat, "faery": _faery, "evlib": _evlib, "eventcv": _eventcv},
    # without the unit, eventcv derives another one from the times
    ".h5": {"evlib": _evlib, "eventcv": partial(_eventcv, time_unit="microseconds")},
    **{
        f".{kind}.raw": {
            "expelliarmus": partial(_expelliarmus, kind),
            "faery": _faery,
            "evlib": _evlib,
            "eventcv": _eventcv,
        }
        for kind in ("evt2", "evt3")
    },
}
