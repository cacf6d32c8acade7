"""`FileRecording`, the base class of all formats, and conversions of columns that several formats use."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import (
    EVER,
    LATEST,
    MAX_COORDINATE,
    Columns,
    Events,
    bounds_of,
    check_sensor_size,
    check_window,
    extent,
    sort_by_time,
)
from nvsdata.data.pieces import in_pieces, in_windows
from nvsdata.data.recording import Recording, anomalies_of
from nvsdata.kernels.decode.order import is_sorted

LONG, PART = 1 << 26, 1 << 24  # bytes: `pieces` splits a file larger than LONG into parts of PART on average


class FileRecording(Recording):
    """A file that is opened but not decoded; `read` decodes only the requested window.

    A format is a subclass. It must define `decode`. It defines `decode_window`, `decode_span` and `decode_size` if it
    needn't decode the entire file for them. It sets `_size` (the sensor size that the file states, unless one was
    given), `_begins` and `_ends` (the first and last moment in µs that the file states), and `_rises` (True if the
    times of the last decoding never fall). It raises FormatError for damage if `strict`. Otherwise it leaves out
    damaged parts, and counts them by `_repair`.

    Args:
        path: The file.
        sensor_size: (width, height) in pixels, in place of the size that the file states (default None).
        strict: Whether damage raises a FormatError (default True). Otherwise damaged parts are left out, and counted in
            `repairs`.

    Example:
        >>> import numpy as np
        >>> from nvsdata.data.events import Columns
        >>> class Ticks(FileRecording):
        ...     format = "ticks"
        ...     def decode(self):
        ...         t = np.fromfile(self.path, "<i8")
        ...         return Columns(t, t * 0, t * 0, t * 0 + 1)
        >>> np.array([10, 20, 30]).tofile("a.ticks")
        >>> Ticks("a.ticks", (240, 180)).read(0, 25).t
        array([10, 20])
    """

    _begins: int | None = None
    _ends: int | None = None
    _guessed = False  # whether `_size` was derived from the events
    _rises = False  # whether the last decoded events are known to be in order of time

    def __init__(
        self, path: str | os.PathLike[str], sensor_size: tuple[int, int] | None = None, strict: bool = True
    ) -> None:
        self.path = os.fspath(path)
        self.strict = strict
        self.repairs: dict[str, int] = {}
        self._size = None if sensor_size is None else check_sensor_size(sensor_size)
        self._whole: Events | None = None

    @property
    def sensor_size(self) -> tuple[int, int]:
        """(width, height) in pixels: as given, as the file states, or the smallest that contains its events."""
        if self._size is None:
            self._size, self._guessed = self.decode_size(), True
        return self._size

    @property
    def size_is_guessed(self) -> bool:
        return self._guessed or self._size is None

    @abstractmethod
    def decode(self) -> Columns:
        """Decode all events, in file order."""

    def decode_window(self, start: int, stop: int) -> Columns | None:
        """Decode the events with start <= t < stop (µs), or return None if that needs the entire file."""
        return None

    def decode_span(self) -> tuple[int, int] | None:
        """Return the first and last time in µs, or None if that needs the entire file."""
        return None

    @property
    def certainly_rises(self) -> bool:
        """True if all times were checked and never fall, so that consecutive windows contain all events."""
        return False

    def decode_size(self) -> tuple[int, int]:
        """Return the smallest sensor that contains the events; called if neither file nor caller states a size."""
        return extent(self.decode())

    @property
    def knows_span(self) -> bool:
        return self._whole is not None or self.decode_span() is not None

    @property
    def span(self) -> tuple[int, int]:
        bounds = self.decode_span()
        if bounds is not None:
            return bounds
        self._whole = self._all()
        t = self._whole.t
        return (int(t[0]), int(t[-1])) if t.size else (0, 0)

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        check_window(start, stop)
        if start is None and stop is None:
            return self._all()
        if self._whole is None:
            known = self._size is not None
            columns = self.decode_window(EVER[0] if start is None else start, EVER[1] if stop is None else stop)
            # if the file was changed since its index was made, the window may be wrong
            if columns is not None and is_sorted(columns.t):
                columns, size = self._repaired(columns), self.sensor_size
                columns = columns if known else Columns(*self._inside(columns))
                return Events.trusted(columns, size, *bounds_of(start, stop, self._begins, self._ends))
            self._whole = self._all()
        return self._whole.window(start, stop)

    def _all(self) -> Events:
        """Return all events, sorted by time."""
        return self._as_events(self.decode()) if self._whole is None else self._whole

    def _as_events(self, decoded: Columns) -> Events:
        """Return decoded events, checked and sorted by time."""
        columns = self._repaired(decoded)
        if not self._rises:
            columns = sort_by_time(columns)
        if self._size is None:
            self._size, self._guessed = extent(columns), True
        if columns.t.size and self._begins is not None and self._ends is not None:
            self._check_time(int(columns.t[0]), int(columns.t[-1]))
        return Events.trusted(columns, self._size, self._begins, self._ends)

    def _state_times(self, time: tuple[int, int] | None) -> None:
        """Store the first and last moment in µs that the file states; None if it states none."""
        if time is None:
            return
        if -LATEST < time[0] <= time[1] < LATEST:
            self._begins, self._ends = time
        elif self.strict:
            raise FormatError(self.path, f"states invalid times of start and end: {time[0]} to {time[1]} µs")
        else:
            self._repair("invalid times of start and end, left out", 1)

    def _check_time(self, first: int, last: int) -> None:
        """Drop the time range that the file states unless it contains the times of its `first` and `last` event (µs).

        If `strict`, FormatError instead.
        """
        assert self._begins is not None
        assert self._ends is not None
        if self._begins <= first and last <= self._ends:
            return
        if self.strict:
            stated = f"{self._begins} to {self._ends} µs"
            raise FormatError(self.path, f"events at {first} to {last} µs, outside the time that it states: {stated}")
        self._repair("times of start and end that don't contain the events, left out", 1)
        self._begins = self._ends = None

    @property
    def start(self) -> int:
        return self.span[0] if self._begins is None else self._begins

    @property
    def end(self) -> int:
        return self.span[1] if self._ends is None else self._ends

    def pieces(self) -> Iterator[Events]:
        if self.holds_samples:
            return in_pieces(self)
        size = os.path.getsize(self.path)
        if self._whole is None and size > LONG and self.certainly_rises and (span := self.decode_span()) is not None:
            if self._begins is not None and self._ends is not None:
                self._check_time(*span)
            return in_windows(self, -(-size // PART))
        return iter((self.read(),))

    def _repaired(self, columns: Columns) -> Columns:
        """Return the columns unchanged or, if not `strict`, without events that `Events` doesn't support."""
        if self.strict:
            return columns
        columns = Columns(*self._inside(columns))
        self._repair("steps back in time, sorted", int(np.count_nonzero(columns.t[1:] < columns.t[:-1])))
        return columns

    @property
    def _limits(self) -> tuple[int, int]:
        """(width, height) below which coordinates must be: the sensor's or, if unknown, the largest supported."""
        return self._size or (MAX_COORDINATE + 1, MAX_COORDINATE + 1)

    def _inside(self, columns: Sequence[np.ndarray], first: int = 0) -> Sequence[np.ndarray]:
        """Return columns t, x, y, p without events outside the sensor or with a polarity other than 0 and 1.

        If `strict`, FormatError for such an event. `first` is the number of the first event, for the message.
        """
        _, x, y, p = columns
        width, height = self._limits
        # the largest values show whether any event is outside
        if all(c.size == 0 or _unsigned(c).max() < end for c, end in ((x, width), (y, height), (p, 2))):
            return columns
        bad = (x < 0) | (x >= width) | (y < 0) | (y >= height) | (p < 0) | (p > 1)
        if self.strict:
            where = f"event {first + int(np.argmax(bad))}"
            reason = f"outside the sensor of {width}x{height}, or a polarity other than 0 and 1"
            raise FormatError(self.path, f"{where}: {reason}")
        self._repair("events outside the sensor, dropped", int(np.count_nonzero(bad)))
        return [column[~bad] for column in columns]

    def _repair(self, what: str, count: int) -> None:
        """Set the number of repairs of the kind `what` in `repairs`, unless it is 0."""
        if count:
            self.repairs[what] = count

    def anomalies(self) -> Mapping[str, int]:
        raw = self.decode()
        # `read` needn't decode again
        self._whole = self._as_events(raw)
        return anomalies_of(raw)


def _unsigned(column: np.ndarray) -> np.ndarray:
    """View integers as unsigned, so that negative ones are larger than all others."""
    return column.view(column.dtype.str.replace("i", "u")) if column.dtype.kind == "i" else column


def as_integers(path: str, name: str, column: np.ndarray) -> np.ndarray:
    """Convert a column of any numeric type to integers; integers keep their type.

    FormatError, which names the column as `name`, for fractions, NaN, and numbers at or beyond 2^62.
    """
    if column.dtype.kind == "b":
        return column.astype(np.uint8)
    if column.dtype.kind == "f":
        # NaN fails the comparison
        if not ((np.abs(column) < LATEST) & (column == np.rint(column))).all():
            raise FormatError(path, f"{name} has numbers that aren't whole, or beyond 2^62")
        return column.astype(np.int64)
    if column.dtype.itemsize == 8 and column.size and not -LATEST < column.min() <= column.max() < LATEST:
        raise FormatError(path, f"{name} has numbers beyond 2^62")
    return column


def as_polarity(column: np.ndarray) -> np.ndarray:
    """Convert polarity to 0 and 1; OFF may be -1."""
    return np.where(column == -1, 0, column) if column.dtype.kind == "i" else column
