"""Events in memory, sorted by time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
import numpy.typing as npt

from nvsdata.common.notebook import drawers
from nvsdata.kernels.decode import clock
from nvsdata.kernels.decode.order import copy_at, copy_where, is_sorted, late, merge_late, stable_order
from nvsdata.kernels.represent.inside import inside

if TYPE_CHECKING:
    import torch

LATEST = clock.LATEST  # µs; times lie between this and its negative, so that differences can't overflow
MAX_COORDINATE = 32766
FEW = 32  # if at most one event in 32 is late, the late ones are merged; otherwise all events are sorted
ORDER = "; the order is Events(t, x, y, p)"
EVER = (-(2**63), 2**63 - 1)  # µs; a window without bounds
STRUCTURE = np.dtype([("x", np.int16), ("y", np.int16), ("t", np.int64), ("p", np.uint8)])


class Columns(NamedTuple):
    """Decoded events in file order.

    Args:
        t: int64 [N], µs.
        x: int16 [N], pixels.
        y: int16 [N], pixels.
        p: uint8 [N], 1 for ON and 0 for OFF.
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray

    @classmethod
    def empty(cls, size: int) -> Columns:
        """Return uninitialized columns of `size` events.

        numpy allocates them in large pages; other memory would cost a page fault every 4 KiB.
        """
        xy = np.empty(size, np.int16), np.empty(size, np.int16)
        return cls(np.empty(size, np.int64), *xy, np.empty(size, np.uint8))

    def take(self, which: slice | np.ndarray) -> Columns:
        """Return the events selected by a slice, a boolean mask or indices."""
        if isinstance(which, np.ndarray) and which.dtype == np.bool_ and which.shape == self.t.shape:
            # several times as fast as numpy if about half of the events are selected
            count = int(np.count_nonzero(which))
            kept = Columns.empty(count + 1)
            copy_where(which, *self, *kept)
            return kept.first(count)
        return Columns(self.t[which], self.x[which], self.y[which], self.p[which])

    def first(self, count: int) -> Columns:
        """Return the first `count` events."""
        return self if count == self.t.size else self.take(slice(count))


class Events:
    """Events sorted by time, as one array per column.

    Treat Events as immutable: operations return new Events, which share memory where possible. Indexing and iteration
    return Events of one event each; in loops, use the columns instead.

    Args:
        t: Times in µs. Unsorted input is sorted; events at equal times keep their order. It becomes int64 [N].
        x: Columns of pixels, counted from the left. It becomes int16 [N].
        y: Rows of pixels, counted from the top. It becomes int16 [N].
        p: Polarity, 1 for ON and 0 for OFF. It becomes uint8 [N].
        sensor_size: (width, height) in pixels (default: the smallest that contains the coordinates).
        start: First moment in µs of the time range in which these events were observed, such as the start of the
            window that they were cut from, or the time of the first frame of an emulated video (default: the time of
            the first event, 0 if there is none).
        end: Last moment in µs of that range (default: the time of the last event).

    Raises:
        ValueError: If columns have different lengths, for times at or beyond 2^62 µs, coordinates outside the sensor,
            and polarities other than 0 and 1.

    Example:
        >>> events = Events([0, 10, 30], [0, 3, 1], [1, 1, 0], [1, 0, 1], sensor_size=(4, 2))
        >>> events.window(0, 20)
        Events(2 events, 10 µs, 4x2)
        >>> events[events.p == 1].t.tolist()
        [0, 30]
    """

    __slots__ = ("p", "sensor_size", "start", "stated_end", "t", "x", "y")

    t: npt.NDArray[np.int64]
    x: npt.NDArray[np.int16]
    y: npt.NDArray[np.int16]
    p: npt.NDArray[np.uint8]
    sensor_size: tuple[int, int]
    start: int
    stated_end: int | None  # None: `end` is the time of the last event

    def __init__(
        self,
        t: npt.ArrayLike,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        p: npt.ArrayLike,
        sensor_size: tuple[int, int] | None = None,
        *,
        start: int | None = None,
        end: int | None = None,
    ) -> None:
        given = {"t": np.asarray(t), "x": np.asarray(x), "y": np.asarray(y), "p": np.asarray(p)}
        _check_columns(given)
        columns = Columns(
            _as_column(given["t"], np.int64),
            _as_column(given["x"], np.int16),
            _as_column(given["y"], np.int16),
            _as_column(given["p"], np.uint8),
        )
        needed = extent(columns)
        size = needed if sensor_size is None else check_sensor_size(sensor_size)
        if needed[0] > size[0] or needed[1] > size[1]:
            # times as small as coordinates are probably coordinates in the wrong column
            hint = ORDER if int(columns.t.max()) < max(size) else ""
            outside = f"outside the sensor of {size[0]}x{size[1]}"
            raise ValueError(f"events reach {needed[0]}x{needed[1]} pixels, {outside}{hint}")
        columns = sort_by_time(columns)
        _check_time(columns.t, start, end)
        self._set(*columns, size, start, end)

    def _set(self, t: Any, x: Any, y: Any, p: Any, size: tuple[int, int], start: int | None, end: int | None) -> None:
        self.t, self.x, self.y, self.p = t, x, y, p
        self.sensor_size = size
        self.start = start if start is not None else int(t[0]) if t.size else 0
        self.stated_end = end

    @classmethod
    def trusted(
        cls, columns: Columns, sensor_size: tuple[int, int], start: int | None = None, end: int | None = None
    ) -> Events:
        """Return events of columns that are known to be valid and sorted, without checks."""
        events = cls.__new__(cls)
        events._set(*columns, sensor_size, start, end)
        return events

    @classmethod
    def empty(cls, sensor_size: tuple[int, int], start: int = 0, end: int | None = None) -> Events:
        """Return Events without any event; `start` and `end` are in µs."""
        return cls.trusted(Columns.empty(0), sensor_size, start, end)

    def of(self, columns: Columns) -> Events:
        """Return events with the given sorted columns, and the sensor size and time range of this object."""
        return Events.trusted(columns, self.sensor_size, self.start, self.stated_end)

    def resized(self, columns: Columns, sensor_size: tuple[int, int]) -> Events:
        """Return events of sorted columns on a sensor of another size, with the same time range.

        ValueError for an invalid size, and for events outside the sensor.
        """
        return check_inside(Events.trusted(columns, check_sensor_size(sensor_size), self.start, self.stated_end))

    @property
    def columns(self) -> Columns:
        """The four arrays."""
        return Columns(self.t, self.x, self.y, self.p)

    @property
    def end(self) -> int:
        """Last moment in µs of the time range in which these events were observed."""
        if self.stated_end is not None:
            return self.stated_end
        return int(self.t[-1]) if self.t.size else self.start

    @property
    def duration(self) -> int:
        """Time from the first to the last event in µs; 0 for fewer than two events."""
        return int(self.t[-1]) - int(self.t[0]) if self.t.size else 0

    def __len__(self) -> int:
        return int(self.t.size)

    def __getitem__(self, which: SupportsIndex | slice | npt.NDArray[Any]) -> Events:
        """Return the events selected by an index, a slice, a boolean mask [N] or indices [M], sorted by time.

        Raises:
            IndexError: If an index is out of range.
        """
        if isinstance(which, int | np.integer):
            at = range(len(self))[which]
            which = slice(at, at + 1)
        return self.of(sort_by_time(self.columns.take(which)))  # type: ignore[arg-type]

    def window(self, start: int | None = None, stop: int | None = None) -> Events:
        """Return the events with start <= t < stop, without a copy.

        Args:
            start: µs, absolute; None (default) for no bound.
            stop: µs, absolute; None (default) for no bound.

        Raises:
            ValueError: If stop < start.
        """
        check_window(start, stop)
        lo = 0 if start is None else int(self.t.searchsorted(start, "left"))
        hi = self.t.size if stop is None else int(self.t.searchsorted(stop, "left"))
        columns = Columns(self.t[lo:hi], self.x[lo:hi], self.y[lo:hi], self.p[lo:hi])
        return Events.trusted(columns, self.sensor_size, *bounds_of(start, stop, self.start, self.stated_end))

    def to_structured(self) -> np.ndarray:
        """Convert to a structured array [N] with fields x, y (int16), t (int64, µs) and p (uint8)."""
        out = np.empty(len(self), STRUCTURE)
        for name in ("t", "x", "y", "p"):
            out[name] = getattr(self, name)
        return out

    @classmethod
    def from_structured(cls, array: np.ndarray, sensor_size: tuple[int, int] | None = None) -> Events:
        """Convert a structured array to events.

        Args:
            array: Array [N] with fields t (µs), x, y and p, in any order and of any integer type.
            sensor_size: (width, height) in pixels (default: the smallest that contains the events).

        Raises:
            ValueError: If a field is missing, or if `Events` doesn't take the values.
        """
        missing = {"t", "x", "y", "p"} - set(array.dtype.names or ())
        if missing:
            raise ValueError(f"the array has no fields {sorted(missing)}; it has {array.dtype.names}")
        return cls(array["t"], array["x"], array["y"], array["p"], sensor_size)

    def torch(self) -> dict[str, torch.Tensor]:
        """Convert to tensors `t` int64, `x` and `y` int16, `p` uint8, each [N]; they share memory where possible."""
        import torch

        return {
            name: torch.from_numpy(np.require(column, requirements=["C", "W"]))
            for name, column in self.columns._asdict().items()
        }

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Events):
            return NotImplemented
        same = all(np.array_equal(a, b) for a, b in zip(self.columns, other.columns, strict=True))
        return same and self.sensor_size == other.sensor_size

    __hash__ = None  # type: ignore[assignment]

    def _repr_png_(self) -> bytes | None:
        """Return the PNG that a notebook shows; with None it shows the repr."""
        draw = drawers.get("Events")
        return None if draw is None else draw(self)

    def __repr__(self) -> str:
        width, height = self.sensor_size
        return f"Events({len(self)} events, {self.duration} µs, {width}x{height})"


def concatenate(pieces: Sequence[Columns]) -> Columns:
    """Concatenate columns; a single piece is returned without a copy."""
    return pieces[0] if len(pieces) == 1 else Columns(*(np.concatenate(column) for column in zip(*pieces, strict=True)))


def concatenate_events(pieces: Sequence[Events]) -> Events:
    """Concatenate pieces of a stream in order of time, from the start of the first piece to the end of the last one."""
    columns = concatenate([piece.columns for piece in pieces])
    return Events.trusted(columns, pieces[0].sensor_size, pieces[0].start, pieces[-1].stated_end)


def extent(columns: Columns) -> tuple[int, int]:
    """Return the smallest (width, height) that contains the events; (1, 1) for none."""
    return (int(columns.x.max()) + 1, int(columns.y.max()) + 1) if columns.t.size else (1, 1)


def sort_by_time(columns: Columns) -> Columns:
    """Sort columns stably by time; columns that are sorted are returned without a copy."""
    if is_sorted(columns.t):
        return columns
    strays = late(columns.t, columns.t.size // FEW)
    if strays is not None:
        merged = Columns.empty(columns.t.size)
        merge_late(strays, strays[np.argsort(columns.t[strays], kind="stable")], *columns, *merged)
        return merged
    # sorting by digits is faster than by comparisons, unless there are few events or many digits
    digits = 1_000 < columns.t.size <= np.iinfo(np.int32).max and int(columns.t.max()) - int(columns.t.min()) < 1e13
    order = stable_order(columns.t) if digits else np.argsort(columns.t, kind="stable")
    sorted_columns = Columns.empty(order.size)
    copy_at(order, *columns, *sorted_columns)
    return sorted_columns


def bounds_of(start: int | None, stop: int | None, begin: int | None, end: int | None) -> tuple[int | None, int | None]:
    """Return first and last moment (µs) of the window [start, stop) of a recording from `begin` to `end`.

    `start` or `stop` is None for no bound. Any other None, also in the result, means unknown.
    """
    if end is None:
        # without `end`, `begin` isn't certain either, so it doesn't limit `start`
        return begin if start is None else start, None
    begin = begin if start is None else start if begin is None else max(start, begin)
    end = end if stop is None else min(stop - 1, end)
    return begin, end if begin is None else max(begin, end)


def check_window(start: int | None, stop: int | None) -> None:
    """Raise ValueError for a window that ends before it begins."""
    if start is not None and stop is not None and stop < start:
        raise ValueError(f"the window [{start}, {stop}) ends before it begins")


def check_sensor_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size as two ints. ValueError if it isn't a valid sensor size."""
    given_width, given_height = size
    width, height = int(given_width), int(given_height)
    if not (0 < width <= MAX_COORDINATE + 1 and 0 < height <= MAX_COORDINATE + 1):
        raise ValueError(f"sensor_size must be (width, height) between 1 and {MAX_COORDINATE + 1}, not {size}")
    return width, height


def check_inside(events: Events, sensor_size: tuple[int, int] | None = None) -> Events:
    """Check that kernels can use the coordinates of events as indices, and return the events.

    Only Events that weren't built by `Events(...)`, or whose arrays were changed, can fail the check.

    Raises:
        ValueError: If events are outside a sensor of `sensor_size` (default: their own), if a polarity is neither 0
            nor 1, or if columns have different lengths.
    """
    width, height = sensor_size or events.sensor_size
    if not inside(*events.columns, width, height):
        _check_columns(events.columns._asdict())
        reached = "x".join(map(str, extent(events.columns)))
        raise ValueError(f"events reach {reached} pixels, outside the sensor of {width}x{height}")
    return events


def _as_column(values: np.ndarray, kind: type[np.generic]) -> np.ndarray:
    """Convert values to a type. Fields of packed structured arrays are copied, because kernels need aligned numbers."""
    values = values.astype(kind, copy=False)
    return values if values.flags.aligned else values.copy()


def _check_time(t: np.ndarray, start: int | None, end: int | None) -> None:
    for name, bound in (("start", start), ("end", end)):
        if bound is not None and not -LATEST < bound < LATEST:
            raise ValueError(f"{name} must be between -2^62 and 2^62 µs, not {bound}")
    if start is not None and end is not None and end < start:
        raise ValueError(f"events end at {end} µs, before they start at {start} µs")
    if t.size and ((start is not None and start > t[0]) or (end is not None and end < t[-1])):
        raise ValueError(f"events at {t[0]} to {t[-1]} µs aren't within start={start} and end={end}")


def _check_columns(given: dict[str, np.ndarray]) -> None:
    shapes = {name: column.shape for name, column in given.items()}
    if len(set(shapes.values())) != 1 or given["t"].ndim != 1:
        raise ValueError(f"t, x, y and p must be one-dimensional and equally long, not {shapes}")
    if given["t"].size == 0:
        return
    for name in ("t", "x", "y"):
        if given[name].dtype.kind not in "iu":
            raise ValueError(f"{name} must be integers (whole µs and pixels), not {given[name].dtype}")
    for name in ("x", "y"):
        if given[name].min() < 0 or given[name].max() > MAX_COORDINATE:
            hint = ORDER if given[name].max() > MAX_COORDINATE else ""
            raise ValueError(
                f"{name} must be between 0 and {MAX_COORDINATE}, not {given[name].min()} to {given[name].max()}{hint}"
            )
    t = given["t"]
    if not -LATEST < int(t.min()) <= int(t.max()) < LATEST:
        raise ValueError(f"times must be between -2^62 and 2^62 µs, not {t.min()} to {t.max()}")
    if not np.isin(given["p"], (0, 1)).all():
        raise ValueError(f"polarity must be 0 (OFF) or 1 (ON), not {np.unique(given['p'])[:4].tolist()}")
