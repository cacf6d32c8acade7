"""Windows of long recordings as samples."""

from __future__ import annotations

import hashlib
import os
import random
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from nvsdata.common.progress import bar
from nvsdata.common.validation import microseconds, whole
from nvsdata.data.recording import Recording
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.source import load_facts, save_facts

Data = TypeVar("Data", bound=EventDataset)

INDEX = ".nvsdata-windows-{}.json"
COMPARED = 3  # recordings of an index that are compared with their files
MANY = 1_000  # recordings; with at least this number, a progress bar is shown

# of a recording or a labeled part: the beginning of each window, as (µs, events of that µs to leave out), and the
# first µs after the last event
Places = tuple[list[tuple[int, int]], int]


def windows(dataset: Data, duration: int | None = None, *, events: int | None = None, step: int | None = None) -> Data:
    """Return the dataset with one sample per window of each recording, in order, instead of one per recording.

    The first window begins at the first event or, in a labeled part of a recording (DVS128 Gesture), at the part's
    beginning. No window crosses the end of the recording or part; the last windows may be shorter. Reading a window
    decodes only that window.
    `samples[i].window` is the window (start, stop) of sample i in µs.

    An index `.nvsdata-windows-....json` is kept in the root, if it is a folder that can be written to. It contains the
    modification time, beginning and end of each recording and, for windows of `events`, the beginning of each window,
    for which the recordings are decoded once.

    Args:
        dataset: any dataset of recordings; the result has its targets, transforms and other settings.
        duration: length of a window in µs.
        events: number of events of a window, in place of `duration`.
        step: distance between the starts of two windows, in µs or events (default: `duration` or `events`, so that
            each event is in exactly one window).

    Raises:
        ValueError: not exactly one of `duration` and `events` is given, or a setting isn't a positive whole number.
        TypeError: the samples aren't recordings, or are windows already.

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "waving").mkdir()
        >>> _ = nvsdata.write(nvsdata.example(), root / "waving/0.npy")
        >>> len(nvsdata.windows(nvsdata.EventFolder(root), duration=100_000))
        5
    """
    size = _checked(duration, events, step)
    step = size if step is None else int(step)
    single = (isinstance(sample, Sample) and sample.events is None for sample in dataset.samples)
    if not isinstance(dataset, EventDataset) or not all(single):
        raise TypeError(
            "windows are made from recordings, not from pairs of them, other windows or precomputed samples"
        )
    index = _Index(dataset, None if events is None else step)
    cut = _in_events if events is not None else _in_time
    part = dataset.subset(())
    part.samples = [
        window
        for sample in bar(dataset.samples, "windows", shown=len(dataset) >= MANY, leave=False)
        for window in cut(sample, index.places(sample), size, step)
    ]
    index.save()
    if not part.samples:
        raise ValueError("none of the recordings has any events")
    part._count()
    return part


def _checked(duration: int | None, events: int | None, step: int | None) -> int:
    if (duration is None) == (events is None):
        raise ValueError(f"one of duration and events must be given, not duration={duration}, events={events}")
    check = microseconds if events is None else lambda name, value: whole(name, value, 1)
    for name, value in (("duration", duration), ("events", events), ("step", step)):
        if value is not None:
            check(name, value)
    return int(duration if duration is not None else events)  # type: ignore[arg-type]


def _in_time(sample: Sample, places: Places, duration: int, step: int) -> Iterator[Sample]:
    begins, end = places
    for begin, _ in begins:
        for start in range(begin, end, step):
            yield sample._replace(window=(start, min(start + duration, end)))


def _in_events(sample: Sample, places: Places, count: int, step: int) -> Iterator[Sample]:
    begins, end = places
    last = len(begins)
    for number, (start, before) in enumerate(begins):
        # window `after` is the first that begins after this window's last event, or in the same µs
        after = number - (-count // step)
        stop = begins[after][0] + 1 if after < last else end
        yield sample._replace(window=(start, stop), events=(before, count))


class _Index:
    """Starts of the windows in each recording, stored in a file that later calls of `windows` read."""

    def __init__(self, dataset: EventDataset, step: int | None) -> None:
        self.dataset, self.step, self.changed = dataset, step, False
        kind = "time" if step is None else f"{step}-events"
        view = hashlib.sha256(repr((type(dataset).__name__, dataset.errors == "repair")).encode()).hexdigest()[:8]
        # next to a store, and of a remote one, nothing is written
        folder = dataset.root if isinstance(dataset.root, Path) else Path(os.devnull)
        self.path = folder / INDEX.format(f"{kind}-{view}")
        self.known: dict[str, Any] = self._read()

    def places(self, sample: Sample) -> Places:
        """Return the starts of the windows of a sample, and the end of the last window; see `Places`."""
        key = sample.name + sample.part
        stamp = list(self.dataset.source.stamp(sample.name))
        entry = self.known.get(key)
        if entry is None or entry["stamp"] != stamp:
            begins, end = self._found(sample)
            entry = self.known[key] = {"stamp": stamp, "begins": begins, "end": end}
            self.changed = True
        return [tuple(begin) for begin in entry["begins"]], entry["end"]

    def _found(self, sample: Sample) -> Places:
        recording = self.dataset.part(sample)
        if self.step is not None:
            return _every(recording, self.step)
        if sample.window is not None:
            return [(sample.window[0], 0)], sample.window[1]
        first, last = recording.span
        # a recording without events has the span of one event at 0
        empty = first == last and not len(recording.read())
        return ([], 0) if empty else ([(first, 0)], last + 1)

    def _read(self) -> dict[str, Any]:
        """Return the stored entries; {} if they are damaged, or wrong for one of `COMPARED` random recordings."""
        known = load_facts(self.path)
        if not all(map(_is_place, known.values())):
            return {}
        there = [sample for sample in self.dataset.samples if sample.name + sample.part in known]
        for sample in random.Random().sample(there, min(len(there), COMPARED)):
            entry = known[sample.name + sample.part]
            if entry["stamp"] == list(self.dataset.source.stamp(sample.name)):
                begins, end = self._found(sample)
                if [list(begin) for begin in begins] != entry["begins"] or end != entry["end"]:
                    return {}
        return known

    def save(self) -> None:
        """Write the entries to the file, if possible."""
        if not self.changed or not self.path.parent.is_dir():
            return
        # if the folder can't be written to, the starts are searched each time
        with suppress(OSError):
            save_facts(self.path, self.known)


def _is_place(entry: Any) -> bool:
    """Return whether an entry of an index is valid: windows in order of time, with possible times."""
    try:
        numbers = [entry["end"], *entry["stamp"], *(number for begin in entry["begins"] for number in begin)]
        times = [begin for begin, before in entry["begins"] if before >= 0]
        in_order = len(times) == len(entry["begins"]) and times == sorted(times)
        inside = all(time < entry["end"] for time in times)
    except (TypeError, KeyError, ValueError):
        return False
    return in_order and inside and all(type(number) is int and abs(number) < 1 << 63 for number in numbers)


def _every(recording: Recording, step: int) -> Places:
    """Return the starts of windows, one at every `step`-th event, and the end of the recording; see `Places`."""
    t = recording.read().t
    if not t.size:
        return [], 0
    places = t[::step]
    before = np.arange(0, t.size, step) - np.searchsorted(t, places, "left")
    return list(zip(places.tolist(), before.tolist(), strict=True)), int(t[-1]) + 1
