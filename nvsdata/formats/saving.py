"""Writing files of events, whole or not at all."""

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

READ_BACK = 4096  # events at the end of a file that are compared after it was written


def write(
    events: Events | Recording | Iterable[Events], path: str | os.PathLike[str], *, format: str | None = None
) -> int:
    """Write events in the format that the extension of `path` names; returns the number of events.

    - `events`: Events, a Recording, or an iterable of pieces, each no earlier than the one before (as `PIX2NVS.stream`
      gives them). Pieces are written as they come, in constant memory; the first one states the sensor size
    - `path`: the file, which appears whole or not at all, in place of any file there
    - `format`: the format's name, where an extension has several: "evt3" (the default for `.raw`), "evt2" or "evt2.1";
      "hdf5" (the default for `.h5`), or "hdf5-gzip", which takes a third of the disk

    HDF5, AEDAT 2 and AEDAT 4 hold frames and inertial samples of a Recording, or of a `Piece`; others events alone.

    Raises ValueError for an unknown extension, a format that can't be written, events that
    the format can't hold (every format except HDF5 and text has limits), and pieces that are out of
    order, of different sensors, or none at all. OSError if the disk is full or gives back other data.
    """
    path = os.path.expanduser(path)
    how = writer_of(path, format)
    given = [events] if isinstance(events, Events) else events.pieces() if isinstance(events, Recording) else events
    if not how.holds_samples:
        given = map(without_samples, given)
    pieces = Pieces(given)
    with atomic(path, through_link=True) as temporary:
        assert how.write is not None, "writer_of finds those that write"
        how.write(pieces, temporary)
        _check_written(how, temporary, pieces)
    return pieces.count


def left_out(recording: Recording, path: str | os.PathLike[str], format: str | None = None) -> list[str]:
    """What a recording has that a file with the extension of `path`, in this format, can't hold.

    ValueError for an extension, or a format, that can't be written.
    """
    how, found = writer_of(path, format), []
    if recording.holds_samples and not how.holds_samples and _has_samples(recording):
        found.append("frames and inertial samples")
    # no format is written with them
    if recording.holds_triggers and _has_triggers(recording):
        found.append("external triggers")
    return found


def _has_samples(recording: Recording) -> bool:
    try:
        return bool(recording.inertial().t.size) or next(iter(recording.frames()), None) is not None
    except FormatError:  # damaged ones are some, too
        return True


def _has_triggers(recording: Recording) -> bool:
    try:
        return bool(recording.triggers().t.size)
    except FormatError:
        return True


def _check_written(how: Format, path: Path, pieces: Pieces) -> None:
    """OSError unless the file's last events are those that were written: not every full disk raises an error."""
    if pieces.last is None:
        return
    first = int(pieces.last.t[-READ_BACK:][0])
    wanted = pieces.last.window(first, None)
    try:
        found = how.open(str(path), pieces.sensor_size, head_of(str(path)), True).read(first, None)
        # events at the same time may have come in the piece before
        same = found[max(len(found) - len(wanted), 0) :] == wanted
    except FormatError as error:
        raise OSError(errno.EIO, f"can't be read back after it was written: {error.reason}") from error
    if not same:
        raise OSError(errno.EIO, "doesn't hold what was written to it: is the disk full, or broken?")
