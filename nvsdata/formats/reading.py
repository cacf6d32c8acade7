"""Opening and reading of recordings in any format: `nvsdata.open` and `nvsdata.read`."""

from __future__ import annotations

import os
import stat
import warnings

from nvsdata.common.errors import FormatError, shown
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.formats.contents import HEAD
from nvsdata.formats.registry import format_of, split_stream

# without O_NONBLOCK, opening a pipe without a writer would wait
_READING = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)


def open(path: str | os.PathLike[str], *, sensor_size: tuple[int, int] | None = None, strict: bool = True) -> Recording:
    """Open a file of events without decoding it.

    Args:
        path: The file, or the folder of a ROS 2 bag. Its format is recognized by its content, otherwise by its
            extension. `FILE#/TOPIC` selects a topic of a ROS bag that has several topics of events.
        sensor_size: (width, height) in pixels, in place of the size that the file states (default: that size,
            otherwise the smallest that contains the events). Some formats, such as that of N-MNIST, state no size:
            without `sensor_size=(34, 34)`, a file without events in the last row or column gets a smaller size than
            other files.
        strict: Whether damage raises a FormatError (default True). Otherwise damaged parts are left out: a torn tail is
            cut off, and events outside the sensor are dropped. `Recording.repairs` counts them.

    Returns:
        The recording, whose `read` decodes a window.

    Raises:
        FileNotFoundError: If there is no such file.
        FormatError: For a directory, a pipe, an empty file of a format that needs a header, or an unknown format.

    Example:
        >>> import nvsdata, os, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = os.path.join(folder, "a.h5")
        ...     _ = nvsdata.write(Events([0, 10, 30], [0, 3, 1], [1, 1, 0], [1, 0, 1]), path)
        ...     nvsdata.open(path).span
        (0, 30)
    """
    path = os.path.expanduser(os.fspath(path))
    file, stream = split_stream(path)
    head = head_of(file)
    found = format_of(file, head)
    if stream and not found.has_streams:
        raise FormatError(file, f"no stream {stream}: files of {found.name} have no named streams")
    recording: Recording = found.open(path, sensor_size, head, strict)
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
    """Read the events of a file with start <= t < stop.

    The clock of most cameras doesn't begin at 0. So `read(path, 0, 30_000)` returns no events for most files, with a
    warning; with `relative=True`, times are relative to the first event.

    Args:
        path: The file. Its format is recognized by its content, otherwise by its extension.
        start: Start of the window in µs, in the file's clock; None (default) for no bound.
        stop: End of the window in µs, in the file's clock; None (default) for no bound.
        sensor_size: (width, height) in pixels, in place of the size that the file states (default: that size,
            otherwise the smallest that contains the events).
        relative: Whether `start` and `stop` are relative to the recording's first event (default False). The times of
            the events are those of the file in both cases.
        strict: Whether damage raises a FormatError (default True). Otherwise damaged parts are left out.

    Returns:
        The events, sorted by time.

    Raises:
        FileNotFoundError: If there is no such file.
        FormatError: If `open` raises it, or if the decoded part is damaged.
        ValueError: If stop < start.

    Example:
        >>> import nvsdata, os, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = os.path.join(folder, "a.h5")
        ...     _ = nvsdata.write(Events([100, 110, 130], [0, 3, 1], [1, 1, 0], [1, 0, 1]), path)
        ...     nvsdata.read(path, 0, 20, relative=True).t.tolist()
        [100, 110]
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
    """Warn about a window before the first or after the last event."""
    if not recording.knows_span:
        return
    first, last = recording.span
    if first < last and ((stop is not None and stop <= first) or (start is not None and start > last)):
        window = f"[{'' if start is None else start}, {'' if stop is None else stop})"
        fault = f"the window {window} has no events; the file's are at {first} to {last} µs"
        warnings.warn(f"{shown(recording.path)}: {fault}; relative=True counts from the first event", stacklevel=3)


def head_of(path: str) -> bytes:
    """Return the first 64 KiB of a file, or all of it if it is smaller; for a ROS 2 bag, those of its metadata."""
    # system calls take half the time of a file object, and a dataset may have 100,000 small files
    handle = os.open(path, _READING)
    try:
        head = os.read(handle, HEAD)
        if not head and not stat.S_ISREG(os.fstat(handle).st_mode):
            raise FormatError(path, "is a pipe or a device, not a recording")
        return head
    except BlockingIOError:
        raise FormatError(path, "is a pipe or a device, not a recording") from None
    except IsADirectoryError:
        metadata = os.path.join(path, "metadata.yaml")
        if os.path.isfile(metadata):
            return head_of(metadata)
        raise FormatError(path, "is a folder, not a recording: give a file in it") from None
    finally:
        os.close(handle)
