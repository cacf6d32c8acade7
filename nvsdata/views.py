"""Recordings seen through a window in time or a map of their events. What isn't asked for is not decoded."""

from __future__ import annotations

from collections.abc import Callable

from nvsdata.events import Columns, Events, Recording, check_window


class _View(Recording):
    """A recording that answers from another one."""

    def __init__(self, whole: Recording) -> None:
        super().__init__(whole.path, None, whole.strict)
        self.whole = whole
        self.repairs = whole.repairs

    @property
    def sensor_size(self) -> tuple[int, int]:
        return self.whole.sensor_size

    @property
    def span(self) -> tuple[int, int]:
        return self.whole.span

    def _decode(self) -> Columns:
        return self.read().columns

    def events(self) -> Events:
        return self.read()

    def __repr__(self) -> str:
        return f"<{type(self).__name__.lower()} of {self.whole!r}>"


class Slice(_View):
    """The events with start <= t < stop (µs, as in the file) of a recording.

    `span` is that of the slice, as far as the recording reaches: its first event may come later.
    """

    format = "slice"

    def __init__(self, whole: Recording, start: int, stop: int) -> None:
        check_window(start, stop)
        super().__init__(whole)
        self.start, self.stop = start, stop

    @property
    def span(self) -> tuple[int, int]:
        first, last = self.whole.span
        return max(first, self.start), max(min(last, self.stop - 1), max(first, self.start))

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        check_window(start, stop)
        lo = self.start if start is None else min(max(start, self.start), self.stop)
        hi = self.stop if stop is None else max(min(stop, self.stop), lo)
        events = self.whole.read(lo, hi)
        return events if start is None else Events.trusted(events.columns, events.sensor_size, start)


class Mapped(_View):
    """A recording whose events pass through `change`, which must keep their order in time."""

    format = "mapped"

    def __init__(self, whole: Recording, change: Callable[[Events], Events]) -> None:
        super().__init__(whole)
        self.change = change

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        return self.change(self.whole.read(start, stop))


class Scaled(_View):
    """A recording whose times count in `unit` µs, in µs."""

    format = "scaled"

    def __init__(self, whole: Recording, unit: int) -> None:
        super().__init__(whole)
        self.unit = unit

    @property
    def span(self) -> tuple[int, int]:
        first, last = self.whole.span
        return first * self.unit, last * self.unit

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        check_window(start, stop)
        # rounded up: the first time that isn't before the bound
        events = self.whole.read(*(None if bound is None else -(-bound // self.unit) for bound in (start, stop)))
        columns = events.columns._replace(t=events.t * self.unit)
        return Events.trusted(columns, events.sensor_size, start)
