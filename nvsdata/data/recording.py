"""The interface of recordings, wherever their events are stored; transforms and datasets are given recordings."""

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
    """Events that are not decoded yet; `read` decodes the window that is asked for.

    A subclass must define `sensor_size`, `span` and `read`; it defines `start`, `end`, `frames`, `inertial` and `about`
    if its file holds more than events.

    - `path`: the file that the events come from
    - `format`: name of the file's format
    - `holds_samples`: whether frames and inertial samples can be read; default False
    - `holds_triggers`: whether external triggers can be read; default False
    - `repairs`: kinds of what was left out or corrected when it was read without `strict`, with counts
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
        """Events with start <= t < stop (µs, as in the file; None is without bound), sorted by time.

        A window outside the recording gives empty Events. Raises FormatError if the decoded part
        is damaged, ValueError if stop < start.
        """

    @property
    def knows_span(self) -> bool:
        """True if `span` is known without decoding more events."""
        return True

    @property
    def start(self) -> int:
        """The first moment of the recording in µs: as the file states, else the time of its first event."""
        return self.span[0]

    @property
    def end(self) -> int:
        """The last moment of the recording in µs: as the file states, else the time of its last event."""
        return self.span[1]

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        """Frames whose exposure begins at start <= t < stop (µs, as in the file), one by one, if there are any.

        They are read from HDF5, AEDAT 2, AEDAT 4 and a DAVIS camera's stream. FormatError for other formats, of which
        nvsdata reads only events.
        """
        raise FormatError(self.path, f"frames aren't read from {self.format} files")

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        """Inertial samples with start <= t < stop (µs, as in the file), from the same formats as `frames`."""
        raise FormatError(self.path, f"inertial samples aren't read from {self.format} files")

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        """External triggers with start <= t < stop (µs, as in the file).

        They are read from Prophesee's `.raw` and AEDAT 4. FormatError for other formats.
        """
        raise FormatError(self.path, f"external triggers aren't read from {self.format} files")

    @property
    def about(self) -> Mapping[str, Any]:
        """What the file states about its camera; keys are missing where it states nothing.

        `camera` and `serial`, `started` (wall-clock time at µs 0, ISO 8601), `biases` (name to two numbers),
        `temperature` (°C). Of events that were emulated: `emulator`, its settings, `imperfections`,
        how many events they added and left out, and `frame_times`, those of the video's frames (int64, µs).
        """
        return {}

    @property
    def frame_times(self) -> np.ndarray:
        """Times of the frames, int64 [N], µs: of the video that events were emulated from, else of the sensor's own
        frames, in the middle of their exposure. FormatError for formats of which nvsdata reads only events.
        """
        known = self.about.get("frame_times")
        if known is not None:
            return np.asarray(known, np.int64)
        middles = ((frame.exposure_start + frame.exposure_end) // 2 for frame in self.frames())
        return np.fromiter(middles, np.int64)

    def between_frames(self, first: int, last: int | None = None) -> Events:
        """Events after frame `first` up to frame `last` (default: the one after it), by `frame_times`: t_i < t <= t_j.

        IndexError for a frame that isn't there, ValueError if `last` comes before `first`.
        """
        times = self.frame_times
        last = first + 1 if last is None else last
        if not 0 <= first < times.size or not last < times.size:
            raise IndexError(f"frames {first} to {last} of {times.size}")
        if last < first:
            raise ValueError(f"frame {last} comes before frame {first}")
        return self.read(int(times[first]) + 1, int(times[last]) + 1)

    def pieces(self) -> Iterator[Events]:
        """The whole recording in pieces for `nvsdata.write`, with frames and inertial samples if `holds_samples`."""
        return iter((self.read(),))

    def anomalies(self) -> Mapping[str, int]:
        """Counts of oddities in the recording: steps back in time, and duplicate events."""
        return anomalies_of(self.read().columns)

    def __repr__(self) -> str:
        return f"<{self.format} recording {self.path}>"


def anomalies_of(raw: Columns) -> dict[str, int]:
    """Counts of steps back in time and of duplicate events, for events in file order."""
    steps_back = int(np.count_nonzero(raw.t[1:] < raw.t[:-1]))
    raw = sort_by_time(raw)
    # duplicates at one time need not be adjacent in the file
    order = np.lexsort((raw.p, raw.y, raw.x, raw.t))
    twins = np.ones(max(raw.t.size - 1, 0), bool)
    for column in raw:
        ordered = column[order]
        twins &= ordered[1:] == ordered[:-1]
    return {"steps back in time": steps_back, "duplicate events": int(np.count_nonzero(twins))}


def as_events(sample: object) -> Events:
    """The events of a sample: Events as they are, a Recording read whole. TypeError for anything else."""
    if isinstance(sample, Events):
        return sample
    if isinstance(sample, Recording):
        return sample.read()
    raise misplaced("Events or a Recording", sample)


def events_inside(sample: object) -> Events:
    """`as_events`, for kernels that take coordinates as indices; ValueError for events outside their sensor."""
    return check_inside(as_events(sample))


def misplaced(wanted: str, given: object) -> TypeError:
    """The error to raise where a transform or a network is given a wrong type."""
    return TypeError(f"it takes {wanted}, but was given {_kind(given)}: are the steps in the right order?")


def _kind(given: object) -> str:
    name = type(given).__name__
    if isinstance(given, list | tuple) and given:
        return f"a {name} of {type(given[0]).__name__}"
    shape = getattr(given, "shape", None)
    return f"{name} {list(shape)}" if shape is not None else f"{name}"
