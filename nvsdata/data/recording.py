"""What a recording is, wherever its events lie: the interface that transforms and datasets are given."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, Events, sort_by_time

if TYPE_CHECKING:
    from nvsdata.data.samples import Frame, Inertial


class Recording(ABC):
    """Events that are not decoded yet; `read` decodes the window that is asked for.

    A subclass has `sensor_size`, `span` and `read`; and `start`, `end`, `frames`, `inertial`, `about`, where there is
    more to tell than the events do.

    - `path`: the file that they come from
    - `format`: name of the file's format
    - `holds_samples`: whether frames and inertial samples can be read
    - `repairs`: what was left out or put right when it was read without `strict`, counted
    """

    path: str
    format: str
    holds_samples: bool = False
    repairs: dict[str, int]

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
        """Events with start <= t < stop (µs, as in the file), sorted by time.

        A window outside the recording gives empty Events. Raises FormatError if what was decoded
        is broken, ValueError if stop < start.
        """

    @property
    def knows_span(self) -> bool:
        """Whether `span` can be told without decoding more than has been."""
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
        """Frames whose exposure begins at start <= t < stop (µs, as in the file), one by one; none if none are there.

        Of HDF5, AEDAT 2 and a DAVIS camera's stream; FormatError for other formats: nvsdata reads events alone of them.
        """
        raise FormatError(self.path, None, f"frames aren't read of {self.format} files")

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        """Inertial samples with start <= t < stop (µs, as in the file), of the formats that `frames` are read of."""
        raise FormatError(self.path, None, f"inertial samples aren't read of {self.format} files")

    @property
    def about(self) -> Mapping[str, Any]:
        """What the file says of its camera, as far as it does.

        `camera` and `serial`, `started` (wall-clock time at µs 0, ISO 8601), `biases` (two numbers each, by name),
        `temperature` (°C).
        """
        return {}

    def pieces(self) -> Iterator[Events]:
        """The whole recording as `nvsdata.write` takes it, with frames and inertial samples if there can be any."""
        return iter((self.read(),))

    def anomalies(self) -> Mapping[str, int]:
        """What is odd about the recording, counted: steps back in time, and events given twice."""
        return anomalies_of(self.read().columns)

    def __repr__(self) -> str:
        return f"<{self.format} recording {self.path}>"


def anomalies_of(raw: Columns) -> dict[str, int]:
    """Steps back in time of events in file order, and events given twice, counted."""
    steps_back = int(np.count_nonzero(raw.t[1:] < raw.t[:-1]))
    raw = sort_by_time(raw)
    # twins at one time need not be neighbors in the file
    order = np.lexsort((raw.p, raw.y, raw.x, raw.t))
    twins = np.ones(max(raw.t.size - 1, 0), bool)
    for column in raw:
        ordered = column[order]
        twins &= ordered[1:] == ordered[:-1]
    return {"steps back in time": steps_back, "duplicate events": int(np.count_nonzero(twins))}


def as_events(sample: object) -> Events:
    """The events themselves: a Recording is read whole. TypeError for anything else."""
    if isinstance(sample, Events):
        return sample
    if isinstance(sample, Recording):
        return sample.read()
    raise misplaced("Events or a Recording", sample)


def misplaced(wanted: str, given: object) -> TypeError:
    """What to raise where a transform or a network is given something else than it takes."""
    return TypeError(f"it takes {wanted}, but was given {_kind(given)}: are the steps in the right order?")


def _kind(given: object) -> str:
    name = type(given).__name__
    if isinstance(given, list | tuple) and given:
        return f"a {name} of {type(given[0]).__name__}"
    shape = getattr(given, "shape", None)
    return f"{name} {list(shape)}" if shape is not None else f"{name}"
