"""Readers and emulators of other libraries, as the benchmarks call them."""

from __future__ import annotations

import numpy as np
import pytest
import trees

from nvsdata.benchmarks.case import Options
from nvsdata.benchmarks.peers.emulators import EMULATORS, events_of
from nvsdata.benchmarks.peers.readers import READERS, columns_of, differing
from nvsdata.benchmarks.tasks.decode import written
from nvsdata.video.frames import VideoFrame

EVENTS = trees.some(0)


class Stream:
    """Events as eventcv returns them."""

    def numpy(self) -> np.ndarray:
        return np.stack([EVENTS.x, EVENTS.y, EVENTS.t, EVENTS.p], 1).astype(np.uint64)


class Table(dict):
    """A table of columns, as polars has them."""

    columns = ("x", "y", "t", "polarity")


@pytest.mark.parametrize(
    "found",
    [
        EVENTS,
        EVENTS.to_structured(),
        {"ts": EVENTS.t, "x": EVENTS.x, "y": EVENTS.y, "on": EVENTS.p == 1},
        Table(t=EVENTS.t.astype("timedelta64[us]"), x=EVENTS.x, y=EVENTS.y, polarity=2 * EVENTS.p.astype(np.int8) - 1),
        Stream(),
    ],
    ids=["ours", "structured", "dict", "table", "stream"],
)
def test_columns_of_all_kinds_of_results(found):
    assert all(np.array_equal(ours, theirs) for ours, theirs in zip(EVENTS.columns, columns_of(found), strict=True))
    assert differing(EVENTS, found) == 0
    assert differing(EVENTS[1:], found) == 1


@pytest.mark.parametrize(
    ("suffix", "library"),
    [(suffix, library) for suffix, some in READERS.items() for library in some],
)
def test_other_libraries_read_the_same_events(tmp_path, suffix, library):
    path, events = written(Options(tmp_path), suffix, 1_000)
    try:
        read = READERS[suffix][library](path)
    except ImportError:
        pytest.skip(f"{library} isn't installed")
    wrong = differing(events, read())
    # expelliarmus takes other times from files of EVT3
    assert wrong == 0 or (suffix, library) == (".evt3.raw", "expelliarmus")


@pytest.mark.parametrize("level", [40, 80, 120])
@pytest.mark.parametrize("library", EMULATORS)
def test_other_libraries_emulate_a_step(library, level):
    dark, bright = np.full((4, 6), level, np.uint8), np.full((4, 6), level, np.uint8)
    bright[1, 2] = 2 * level
    frames = [VideoFrame(time, pixels) for time, pixels in ((0, dark), (10_000, bright), (20_000, bright))]
    try:
        run = EMULATORS[library](frames, 0.2, 0.2)
    except ImportError:
        pytest.skip(f"{library} isn't installed")
    made = events_of(run(), (6, 4))
    # log 2 has three thresholds of 0.2
    assert set(zip(made.x.tolist(), made.y.tolist(), made.p.tolist(), strict=True)) == {(2, 1, 1)}
    assert len(made) == 3


@pytest.mark.parametrize(
    "found",
    [
        np.array([[2e-3, 3, 1, -1], [1e-3, 2, 0, 1]]),
        [(np.array([]),) * 4, (np.array([3, 2]), np.array([1, 0]), np.array([2e-3, 1e-3]), np.array([-1, 1]))],
    ],
    ids=["rows", "lists of columns"],
)
def test_events_of_emulators_are_sorted(found):
    made = events_of(found, (6, 4))
    assert [column.tolist() for column in made.columns] == [[1_000, 2_000], [2, 3], [0, 1], [1, 0]]
