"""Views of recordings: a time window, a range of events, or mapped events. Only requested windows are decoded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from nvsdata.data.events import Columns, Events, bounds_of, check_window
from nvsdata.data.pieces import in_pieces
from nvsdata.data.recording import Recording

if TYPE_CHECKING:
    from nvsdata.data.samples import Frame, Inertial, Triggers


class _View(Recording):
    """Base class: a recording that forwards to another one, `whole`."""

    def __init__(self, whole: Recording) -> None:
        self.whole = whole
        self.path, self.repairs = whole.path, whole.repairs

    @property
    def sensor_size(self) -> tuple[int, int]:
        return self.whole.sensor_size

    @property
    def span(self) -> tuple[int, int]:
        return self.whole.span

    @property
    def start(self) -> int:
        return self.whole.start

    @property
    def end(self) -> int:
        return self.whole.end

    @property
    def holds_samples(self) -> bool:  # type: ignore[override]
        return self.whole.holds_samples

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return self.whole.frames(start, stop)

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        return self.whole.inertial(start, stop)

    @property
    def holds_triggers(self) -> bool:  # type: ignore[override]
        return self.whole.holds_triggers

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        return self.whole.triggers(start, stop)

    @property
    def about(self) -> Mapping[str, Any]:
        return self.whole.about

    @property
    def knows_span(self) -> bool:
        return self.whole.knows_span

    def pieces(self) -> Iterator[Events]:
        return in_pieces(self) if self.holds_samples else iter((self.read(),))

    def __repr__(self) -> str:
        return f"<{type(self).__name__.lower()} of {self.whole!r}>"


class Slice(_View):
    """The events of a recording with start <= t < stop.

    `span` is the intersection of the window and the recording's span. The slice's first event may be later than the
    beginning of `span`, and its last event earlier than the end.

    Args:
        whole: The recording.
        start: µs in the file's clock.
        stop: µs in the file's clock.
    """

    format = "slice"

    def __init__(self, whole: Recording, start: int, stop: int) -> None:
        check_window(start, stop)
        super().__init__(whole)
        self._from, self._to = start, stop

    @property
    def start(self) -> int:
        return self._from

    @property
    def end(self) -> int:
        return max(self._to - 1, self._from)

    @property
    def span(self) -> tuple[int, int]:
        first, last = self.whole.span
        return max(first, self._from), max(min(last, self._to - 1), max(first, self._from))

    def _cut(self, start: int | None, stop: int | None) -> tuple[int, int]:
        check_window(start, stop)
        lo = self._from if start is None else min(max(start, self._from), self._to)
        return lo, self._to if stop is None else max(min(stop, self._to), lo)

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return self.whole.frames(*self._cut(start, stop))

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        return self.whole.inertial(*self._cut(start, stop))

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        return self.whole.triggers(*self._cut(start, stop))

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        events = self.whole.read(*self._cut(start, stop))
        bounds = bounds_of(start, stop, self.start, self.end)
        return Events.trusted(events.columns, events.sensor_size, *bounds)


class EventRange(_View):
    """`count` events of a recording (or as many as there are) after the first `skip` events."""

    format = "range"

    def __init__(self, whole: Recording, skip: int, count: int) -> None:
        super().__init__(whole)
        self._skip, self._count = skip, count

    @property
    def span(self) -> tuple[int, int]:
        events = self.read()
        return (int(events.t[0]), int(events.t[-1])) if len(events) else (0, 0)

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        events = self.whole.read()[self._skip : self._skip + self._count]
        return events if start is None and stop is None else events.window(start, stop)


class Mapped(_View):
    """A recording whose events are mapped by a function `change`, which must return them sorted by time."""

    format = "mapped"

    def __init__(self, whole: Recording, change: Callable[[Events], Events]) -> None:
        super().__init__(whole)
        self.change = change

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        return self.change(self.whole.read(start, stop))


class FlippedY(_View):
    """A recording with y counted from the top, of a file that counts y from the bottom of the sensor."""

    format = "flipped"

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        events = self.whole.read(start, stop)
        y = np.subtract(np.int16(events.sensor_size[1] - 1), events.y)
        return events.of(Columns(events.t, events.x, y, events.p))


class Scaled(_View):
    """A recording with times in µs, of a file that contains only events and counts time in units of `unit` µs."""

    format = "scaled"
    holds_samples = holds_triggers = False

    def __init__(self, whole: Recording, unit: int) -> None:
        super().__init__(whole)
        self.unit = unit

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        return Recording.triggers(self, start, stop)

    @property
    def span(self) -> tuple[int, int]:
        first, last = self.whole.span
        return first * self.unit, last * self.unit

    @property
    def start(self) -> int:
        return self.whole.start * self.unit

    @property
    def end(self) -> int:
        return self.whole.end * self.unit

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        check_window(start, stop)
        # rounded up to the first time of the file that isn't before the bound
        events = self.whole.read(*(None if bound is None else -(-bound // self.unit) for bound in (start, stop)))
        columns, end = events.columns._replace(t=events.t * self.unit), events.stated_end
        # the given bounds in µs are kept, because the file's unit is coarser
        begin = events.start * self.unit if start is None else None
        bounds = bounds_of(start, stop, begin, None if end is None else end * self.unit)
        return Events.trusted(columns, events.sensor_size, *bounds)
