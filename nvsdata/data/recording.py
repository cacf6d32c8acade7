"""`Recording`: the interface of files and other sources of events, which transforms and datasets use."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, Events, check_inside, sort_by_time

if TYPE_CHECKING:
    from nvsdata.data.samples import Frame, Inertial, Triggers


class Recording(ABC):
    """Events that are not decoded yet; `read` decodes only the requested window.

    A subclass must define `sensor_size`, `span` and `read`. It defines `start`, `end`, `frames`, `inertial`, `triggers`
    and `about` if its file contains more than events.

    Attributes:
        path: File that contains the events.
        format: Name of the file's format.
        holds_samples: Whether frames and inertial samples can be read (default False).
        holds_triggers: Whether external triggers can be read (default False).
        repairs: Number of events or records that were left out or corrected, by kind, if the file was read with
            `strict=False`.

    Example:
        >>> import nvsdata, os, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = os.path.join(folder, "a.h5")
        ...     _ = nvsdata.write(Events([0, 10, 30], [0, 3, 1], [1, 1, 0], [1, 0, 1]), path)
        ...     recording = nvsdata.open(path)
        ...     recording.span, recording.read(0, 20)
        ((0, 30), Events(2 events, 10 µs, 4x2))
    """

    path: str = ""
    format: str = "recording"
    holds_samples: bool = False
    holds_triggers: bool = False
    repairs: Mapping[str, int] = MappingProxyType({})

    @property
    @abstractmethod
    def sensor_size(self) -> tuple[int, int]:
        """(width, height) in pixels."""

    @property
    @abstractmethod
    def span(self) -> tuple[int, int]:
        """Times of the first and the last event in µs; (0, 0) if there is none."""

    @abstractmethod
    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        """Return the events with start <= t < stop, sorted by time; no events for a window outside the recording.

        Args:
            start: µs in the file's clock; None (default) for no bound.
            stop: µs in the file's clock; None (default) for no bound.

        Raises:
            FormatError: If the decoded part is damaged.
            ValueError: If stop < start.
        """

    @property
    def size_is_guessed(self) -> bool:
        """True if neither file nor caller states `sensor_size`: it is the smallest that contains the events.

        A sensor row or column without events is missing in it. `nvsdata.open(path, sensor_size=...)` states the size.
        """
        return False

    @property
    def knows_span(self) -> bool:
        """True if `span` is known without decoding more events."""
        return True

    @property
    def start(self) -> int:
        """First moment of the recording in µs, as the file states it; otherwise the time of its first event."""
        return self.span[0]

    @property
    def end(self) -> int:
        """Last moment of the recording in µs, as the file states it; otherwise the time of its last event."""
        return self.span[1]

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        """Yield the frames whose exposure begins at start <= t < stop (µs, in the file's clock).

        They are read from HDF5, AEDAT 2, AEDAT 4, ROS bags and recordings of a DAVIS camera's raw stream.

        Raises:
            FormatError: If nvsdata reads only events of this format.
        """
        raise FormatError(self.path, f"frames aren't read from {self.format} files")

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        """Return the inertial samples with start <= t < stop (µs, in the file's clock).

        They are read from the same formats as `frames`.

        Raises:
            FormatError: If nvsdata reads only events of this format.
        """
        raise FormatError(self.path, f"inertial samples aren't read from {self.format} files")

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        """Return the external triggers with start <= t < stop (µs, in the file's clock).

        They are read from Prophesee's `.raw`, AEDAT 4 and ROS bags.

        Raises:
            FormatError: If the file has another format.
        """
        raise FormatError(self.path, f"external triggers aren't read from {self.format} files")

    @property
    def about(self) -> Mapping[str, Any]:
        """Metadata that the file states; a key is missing if the file doesn't state it.

        For a camera: `camera` (name), `serial`, `started` (wall-clock time at µs 0, ISO 8601), `biases` (two numbers by
        name), `temperature` (°C). For emulated events: `emulator` (its settings), `imperfections` (numbers of events
        that each imperfection of the sensor added or removed), `frame_times` (times of the video's frames, int64, µs).
        """
        return {}

    @property
    def frame_times(self) -> np.ndarray:
        """Times of the frames in µs, int64 [N].

        They are the frames of the video that the events were emulated from, otherwise the sensor's own frames, at the
        midpoint of their exposure. FormatError if nvsdata reads only events of this format.
        """
        known = self.about.get("frame_times")
        if known is not None:
            return np.asarray(known, np.int64)
        middles = ((frame.exposure_start + frame.exposure_end) // 2 for frame in self.frames())
        return np.fromiter(middles, np.int64)

    def between_frames(self, first: int, last: int | None = None) -> Events:
        """Return the events after frame `first` up to frame `last`, that is, those with t_first < t <= t_last.

        Args:
            first: Index of a frame in `frame_times`.
            last: Index of a later frame (default: `first` + 1).

        Raises:
            IndexError: If there is no such frame.
            ValueError: If `last` comes before `first`.
        """
        times = self.frame_times
        last = first + 1 if last is None else last
        if not 0 <= first < times.size or not last < times.size:
            raise IndexError(f"there are no frames {first} to {last}: the recording has {times.size}")
        if last < first:
            raise ValueError(f"frame {last} comes before frame {first}")
        return self.read(int(times[first]) + 1, int(times[last]) + 1)

    def pieces(self) -> Iterator[Events]:
        """Yield the entire recording in pieces for `nvsdata.write`, with its frames and inertial samples."""
        return iter((self.read(),))

    def anomalies(self) -> Mapping[str, int]:
        """Return the number of anomalies of each kind: steps back in time, and duplicate events."""
        return anomalies_of(self.read().columns)

    def __repr__(self) -> str:
        return f"<{self.format} recording {self.path}>"


def anomalies_of(raw: Columns) -> dict[str, int]:
    """Count steps back in time and duplicate events among events in file order."""
    steps_back = int(np.count_nonzero(raw.t[1:] < raw.t[:-1]))
    t, x, y, p = sort_by_time(raw)
    # duplicates may be apart among the events of their moment, so these are sorted; other moments have one event
    repeated = t[1:] == t[:-1]
    moment = np.cumsum(~repeated)
    shared = np.flatnonzero(np.append(repeated, False) | np.append(False, repeated))
    key = np.append(0, moment)[shared]
    for column in (x[shared], y[shared], p[shared]):
        low, high = (int(column.min()), int(column.max())) if column.size else (0, 0)
        key = key * (high - low + 1) + (column - np.int64(low))
    key.sort()
    return {"steps back in time": steps_back, "duplicate events": int(np.count_nonzero(key[1:] == key[:-1]))}


def as_events(sample: object, name: str = "sample") -> Events:
    """Return the events of a sample: Events as they are, all events of a Recording. TypeError for anything else.

    `name` is the name of the caller's argument, for the message.
    """
    if isinstance(sample, Events):
        return sample
    if isinstance(sample, Recording):
        return sample.read()
    raise wrong_type(name, "Events or a Recording", sample)


def events_inside(sample: object) -> Events:
    """Return `as_events(sample)` for kernels that use coordinates as indices. ValueError for events off the sensor."""
    return check_inside(as_events(sample))


def wrong_type(name: str, wanted: str, given: object) -> TypeError:
    """Return the error for an argument `name` of a transform or a network that has a wrong type."""
    return TypeError(f"{name} must be {wanted}, not {_kind(given)}: check the order of the transforms")


def _kind(given: object) -> str:
    name = type(given).__name__
    if isinstance(given, list | tuple) and given:
        return f"a {name} of {type(given[0]).__name__}"
    shape = getattr(given, "shape", None)
    return f"{name} {list(shape)}" if shape is not None else f"{name}"
