"""Opening files of events, and reading one in a single call."""

from __future__ import annotations

import os
import stat
import warnings

from nvsdata.common.errors import FormatError, shown
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.formats.contents import HEAD
from nvsdata.formats.registry import format_of

# O_NONBLOCK: opening a pipe that nobody writes to would wait
_READING = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)


def open(path: str | os.PathLike[str], *, sensor_size: tuple[int, int] | None = None, strict: bool = True) -> Recording:
    """Open a file of events without decoding it.

    - `path`: the file; its format is recognized by its content, else by its extension
    - `sensor_size`: (width, height) in pixels, in place of what the file states; by default what it states, else the
      smallest size that holds the events. Some formats state none, such as N-MNIST's: without `sensor_size=(34, 34)`,
      a file without events in the last row or column gets another size than the others
    - `strict`: whether damage is a FormatError; default True. Otherwise a damaged file is read as far as it makes
      sense: a torn tail is cut off and events outside the sensor are dropped, and the recording's `repairs` counts them

    Raises FileNotFoundError, and FormatError for a directory, a pipe, an empty file of a format that
    needs a header, or content that fits no known format.
    """
    path = os.path.expanduser(os.fspath(path))
    head = head_of(path)
    recording: Recording = format_of(path, head).open(path, sensor_size, head, strict)
    return recording


def read(
    path: str | os.PathLike[str],
    start: int | None = None,
    stop: int | None = None,
    *,
    sensor_size: tuple[int, int] | None = None,
    relative: bool = False,
    strict: bool = True,
) -> Events:
    """Events of a file with start <= t < stop.

    - `path`, `sensor_size`, `strict`: as in `open`
    - `start`, `stop`: the window in µs of the file's own clock; None, the default, is without bound
    - `relative`: whether `start` and `stop` count from the recording's first event; default False. The events keep the
      file's times in any case

    Few cameras' clocks begin at 0, so `read(path, 0, 30_000)` has no events for most files, and warns.

    Raises what `open` raises, FormatError if the decoded part is damaged, and ValueError if stop < start.
    """
    recording = open(path, sensor_size=sensor_size, strict=strict)
    if relative:
        first = recording.span[0]
        start, stop = (None if bound is None else first + bound for bound in (start, stop))
    events = recording.read(start, stop)
    if not len(events) and (start, stop) != (None, None):
        _warn_outside(recording, start, stop)
    return events


def _warn_outside(recording: Recording, start: int | None, stop: int | None) -> None:
    """Warn about a window that lies before the first or after the last event."""
    if recording.knows_span and (told := outside(recording, start, stop)):
        warnings.warn(f"{told}; relative=True counts from the first", stacklevel=3)


def outside(recording: Recording, start: int | None, stop: int | None) -> str | None:
    """A message if a window lies before the first or after the last event of a recording; else None."""
    first, last = recording.span
    if first < last and ((stop is not None and stop <= first) or (start is not None and start > last)):
        window = f"[{'' if start is None else start}, {'' if stop is None else stop})"
        return f"{shown(recording.path)}: the window {window} holds nothing, its events lie at {first} to {last} µs"
    return None


def head_of(path: str) -> bytes:
    """The first bytes of a file; all of it if it is small."""
    # plain system calls: a file object costs twice as much, and a dataset may have 100,000 small files
    handle = os.open(path, _READING)
    try:
        head = os.read(handle, HEAD)
        if not head and not stat.S_ISREG(os.fstat(handle).st_mode):
            raise FormatError(path, "is a pipe or a device, not a recording")
        return head
    except BlockingIOError:
        raise FormatError(path, "is a pipe or a device, not a recording") from None
    except IsADirectoryError:
        raise FormatError(path, "is a directory, not a recording") from None
    finally:
        os.close(handle)
