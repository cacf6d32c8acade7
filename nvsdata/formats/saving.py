"""`nvsdata.write`, which writes files completely or not at all."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path

from nvsdata.common.errors import FormatError
from nvsdata.common.files import atomic
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.data.samples import without_samples
from nvsdata.formats.reading import head_of
from nvsdata.formats.registry import Format, writer_of
from nvsdata.formats.writing import Pieces

READ_BACK = 4096  # events at the end of a file that are read and compared after it was written


def write(
    events: Events | Recording | Iterable[Events], path: str | os.PathLike[str], *, format: str | None = None
) -> int:
    """Write events in the format that belongs to the extension of `path`.

    HDF5, AEDAT 2 and AEDAT 4 also contain the frames and inertial samples of a Recording, or of a `Piece`; other
    formats contain only events.

    Args:
        events: Events, a Recording, or an iterable of pieces in order of time (as `PIX2NVS.stream` returns). Pieces are
            written one by one, in constant memory. The first one states the sensor size.
        path: The file, which is written completely or not at all. An existing file is replaced.
        format: Name of the format, if an extension has several: "evt3" (the default for `.raw`), "evt2" or "evt2.1";
            "hdf5" (the default for `.h5`) or "hdf5-gzip", which takes a third of the disk space.

    Returns:
        The number of events.

    Raises:
        ValueError: For an unknown extension, a format that can't be written, events that the format doesn't support
            (every format except HDF5 and text has limits), pieces that are out of order or of different sensors, and
            an iterable without pieces.
        OSError: If the disk is full, or returns other data than were written.

    Example:
        >>> import os, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write(Events([0, 10, 30], [0, 3, 1], [1, 1, 0], [1, 0, 1]), os.path.join(folder, "a.aedat"))
        3
    """
    path = os.path.expanduser(path)
    how = writer_of(path, format)
    given = [events] if isinstance(events, Events) else events.pieces() if isinstance(events, Recording) else events
    if not how.holds_samples:
        given = map(without_samples, given)
    pieces = Pieces(given)
    with atomic(path, through_link=True) as temporary:
        assert how.write is not None, "writer_of returns only formats that can be written"
        how.write(pieces, temporary)
        _check_written(how, temporary, pieces)
    return pieces.count


def left_out(recording: Recording, path: str | os.PathLike[str], format: str | None = None) -> list[str]:
    """List the kinds of data of a recording that `write` would leave out, because the format doesn't support them.

    Args:
        recording: The recording.
        path: The file, whose extension selects the format.
        format: Name of the format, as in `write` (default None).

    Returns:
        "frames and inertial samples", "external triggers", both, or nothing.

    Raises:
        ValueError: For an extension or a format that can't be written.

    Example:
        >>> import nvsdata, os, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = os.path.join(folder, "a.h5")
        ...     _ = write(Events([0, 10], [0, 3], [1, 1], [1, 0]), path)
        ...     left_out(nvsdata.open(path), "a.txt")
        []
    """
    how, found = writer_of(path, format), []
    if recording.holds_samples and not how.holds_samples and _has_samples(recording):
        found.append("frames and inertial samples")
    # nvsdata doesn't write triggers to any format
    if recording.holds_triggers and _has_triggers(recording):
        found.append("external triggers")
    return found


def _has_samples(recording: Recording) -> bool:
    try:
        return bool(recording.inertial().t.size) or next(iter(recording.frames()), None) is not None
    except FormatError:  # damaged data are data, too
        return True


def _has_triggers(recording: Recording) -> bool:
    try:
        return bool(recording.triggers().t.size)
    except FormatError:
        return True


def _check_written(how: Format, path: Path, pieces: Pieces) -> None:
    """Raise OSError unless the file's last events are those that were written: not every full disk raises an error."""
    if pieces.last is None:
        return
    first = int(pieces.last.t[-READ_BACK:][0])
    wanted = pieces.last.window(first, None)
    try:
        found = how.open(str(path), pieces.sensor_size, head_of(str(path)), True).read(first, None)
        # earlier events of the file may have the same time as the first of these
        same = found[max(len(found) - len(wanted), 0) :] == wanted
    except FormatError as error:
        raise OSError(errno.EIO, f"can't be read back after it was written: {error.reason}") from error
    if not same:
        raise OSError(errno.EIO, "doesn't contain what was written to it: check whether the disk is full or broken")
