"""Recordings in memory: handed out in pieces, seen through windows, with what was recorded besides events."""

import itertools

import numpy as np
import pytest

from nvsdata import Events, FormatError
from nvsdata.data.pieces import about_from, cut_pieces, in_pieces
from nvsdata.data.recording import Recording, anomalies_of, as_events, wrong_type
from nvsdata.data.samples import Frame, Inertial, Piece, Triggers, is_empty, within, without_samples
from nvsdata.data.views import EventRange, FlippedY, Mapped, Scaled, Slice


def at(times, **options):
    n = len(times)
    return Events(times, np.arange(n) % 4, np.arange(n) % 3, np.arange(n) % 2, (4, 3), **options)


def frame(time):
    return Frame(time - 2, time, time + 5, time + 9, 0, 0, np.full((2, 3), time % 100, np.uint16))


def inertial(times):
    t = np.array(times, np.int64)
    vectors = np.repeat(t[:, None], 3, 1).astype(np.float32)
    return Inertial(t, vectors, -vectors, t.astype(np.float32))


def triggers(times):
    t = np.array(times, np.int64)
    return Triggers(t, (t % 3).astype(np.uint8), (t % 2).astype(np.uint8))


class Bare(Recording):
    """Events alone, in memory."""

    def __init__(self, events):
        self.events = events

    @property
    def sensor_size(self):
        return self.events.sensor_size

    @property
    def span(self):
        return (int(self.events.t[0]), int(self.events.t[-1])) if len(self.events) else (0, 0)

    def read(self, start=None, stop=None):
        return self.events.window(start, stop)


class Full(Bare):
    """Events, frames, inertial samples and triggers, in memory."""

    holds_samples = holds_triggers = True
    start, end, knows_span, about = 2, 90, False, {"serial": "7", "started": "2024-05-01T10:00:00.000000"}

    def __init__(self, events, frames=(), samples=(), levels=()):
        super().__init__(events)
        self._frames, self._samples, self._levels = [frame(t) for t in frames], inertial(samples), triggers(levels)

    def frames(self, start=None, stop=None):
        return within(self._frames, start, stop)

    def inertial(self, start=None, stop=None):
        return self._samples.window(start, stop)

    def triggers(self, start=None, stop=None):
        return self._levels.window(start, stop)


FULL = Full(at([10, 19, 20, 20, 29, 30, 75]), [10, 20, 40, 49], [5, 14, 15, 50, 74, 75], [10, 20, 30])


def test_pieces_begin_with_what_comes_next():
    pieces = list(in_pieces(FULL, 10))
    assert [piece.t.tolist() for piece in pieces] == [[10], [19, 20, 20], [29, 30], [], [], [75], []]
    assert [[f.exposure_start for f in piece.frames] for piece in pieces] == [[10], [20], [], [40, 49], [], [], []]
    assert [piece.inertial.t.tolist() for piece in pieces] == [[5, 14], [15], [], [], [50], [74, 75], []]
    # the camera's facts come last
    assert [piece.about for piece in pieces] == [{}] * 6 + [FULL.about]
    assert [(piece.start, piece.end) for piece in pieces] == [
        (10, 14), (10, 24), (10, 38), (10, 49), (10, 59), (10, 75), (10, 75)
    ]  # fmt: skip
    assert len(list(in_pieces(FULL, 5))) == 9
    once = list(in_pieces(Full(at([0, 999_999, 1_000_000]))))
    assert [piece.t.tolist() for piece in once] == [[0, 999_999], [1_000_000], []]


def test_samples_out_of_order_are_handed_out_in_order():
    unsorted = Full(at([]), [], [30, 10, 20, 10])
    unsorted._samples.rotation[:, 0] = [3, 1, 2, 9]
    first, second, _ = in_pieces(unsorted, 15)
    assert first.inertial.t.tolist() == [10, 10, 20]
    assert first.inertial.rotation[:, 0].tolist() == [1, 9, 2]
    assert second.inertial.t.tolist() == [30]


def test_the_last_time_there_is():
    last = 2**62 - 1
    assert [piece.t.tolist() for piece in in_pieces(Full(at([last])), 2**63 - 1)] == [[last], []]


def test_a_cut_counts_from_its_start():
    pieces = list(cut_pieces(FULL, 10, 31, 10))
    assert [piece.t.tolist() for piece in pieces] == [[0, 9], [10, 10, 19], [20]]
    assert [(piece.start, piece.end) for piece in pieces] == [(0, 9), (10, 19), (20, 20)]
    assert [[(f.start, f.exposure_start, f.exposure_end, f.end) for f in piece.frames] for piece in pieces] == [
        [(-2, 0, 5, 9)],
        [(8, 10, 15, 19)],
        [],
    ]
    assert [piece.inertial.t.tolist() for piece in pieces] == [[4, 5], [], []]
    assert [piece.about for piece in pieces] == [{"serial": "7", "started": "2024-05-01T10:00:00.000010"}, {}, {}]
    assert [type(piece) for piece in cut_pieces(Bare(FULL.events), 10, 31, 10)] == [Events] * 3
    assert [piece.t.tolist() for piece in cut_pieces(Full(at([0, 1_000_000, 2_000_000])), 0, 2_000_001)] == [
        [0],
        [1_000_000],
        [2_000_000],
    ]


@pytest.mark.parametrize(
    ("about", "expected"),
    [
        ({}, {}),
        ({"serial": "7"}, {"serial": "7"}),
        ({"started": "2024-02-28T23:59:59"}, {"started": "2024-02-29T00:00:01.500000"}),
        ({"started": "2024-02-28T23:59:59+02:00"}, {"started": "2024-02-29T00:00:01.500000+02:00"}),
        ({"started": "yesterday"}, {"started": "yesterday"}),
        ({"started": None}, {"started": None}),
    ],
)
def test_when_a_cut_began(about, expected):
    assert about_from(about, 2_500_000) == expected


def test_a_slice_lasts_from_its_bounds():
    def of(start, stop):
        return Slice(FULL, start, stop)

    assert [(of(*b).start, of(*b).end) for b in ((10, 30), (10, 11), (10, 10))] == [(10, 29), (10, 10), (10, 10)]
    spans = [((0, 100), (10, 75)), ((20, 75), (20, 74)), ((0, 5), (10, 10)), ((80, 90), (80, 80)), ((75, 75), (75, 75))]
    assert [of(*bounds).span for bounds, _ in spans] == [span for _, span in spans]
    assert of(20, 30).read().t.tolist() == [20, 20, 29]
    assert of(20, 30).read(25).t.tolist() == [29]
    assert of(20, 30).read(0, 25).t.tolist() == [20, 20]
    read = of(20, 30).read(0, 25)
    assert (read.start, read.end) == (20, 24)
    # a window beside the slice holds nothing
    for window in ((0, 10), (0, 20), (30, 90), (50, 60), (25, 25)):
        assert not len(of(20, 30).read(*window))
        assert not list(of(10, 50).frames(*(50 + t for t in window)))
    assert [f.exposure_start for f in of(20, 41).frames()] == [20, 40]
    assert [f.exposure_start for f in of(10, 41).frames(None, 40)] == [10, 20]
    assert of(5, 75).inertial(6).t.tolist() == [14, 15, 50, 74]
    assert of(20, 31).triggers().t.tolist() == [20, 30]
    assert of(20, 30).triggers(0, 90).level.tolist() == [0]
    with pytest.raises(ValueError, match="ends before it begins"):
        of(20, 30).read(9, 8)


@pytest.mark.parametrize(("skip", "count"), [(0, 3), (2, 3), (5, 9), (7, 1), (0, 0)])
def test_a_run_is_some_events_of_a_recording(skip, count):
    run = EventRange(Bare(FULL.events), skip, count)
    expected = FULL.events.t.tolist()[skip : skip + count]
    assert run.read().t.tolist() == expected
    assert run.span == ((expected[0], expected[-1]) if expected else (0, 0))
    assert run.read(20).t.tolist() == [t for t in expected if t >= 20]
    assert run.read(None, 20).t.tolist() == [t for t in expected if t < 20]


@pytest.mark.parametrize("start", [None, -25, -20, -1, 0, 99, 100, 101, 190, 200, 750, 751, 900])
@pytest.mark.parametrize("stop", [None, 901, 1000])
def test_times_in_other_units(start, stop):
    whole = at([-2, 10, 19, 20, 20, 75], start=-5, end=80)
    scaled = Scaled(Bare(whole), 10)
    found = scaled.read(start, stop)
    least = -np.inf if start is None else start
    assert found.t.tolist() == [10 * t for t in whole.t.tolist() if least <= 10 * t]
    assert (found.start, found.end) == (-50 if start is None else start, max(-50 if start is None else start, 800))
    assert (scaled.span, scaled.start, scaled.end) == ((-20, 750), -20, 750)
    assert scaled.read(None, 190).t.tolist() == [-20, 100]
    assert scaled.read(None, 191).t.tolist() == [-20, 100, 190]
    assert scaled.read(None, 191).end == 190


def test_a_scaled_recording_has_events_alone():
    scaled = Scaled(FULL, 10)
    assert not scaled.holds_samples
    assert not scaled.holds_triggers
    with pytest.raises(FormatError, match="external triggers aren't read from scaled files"):
        scaled.triggers()
    with pytest.raises(ValueError, match="ends before it begins"):
        scaled.read(9, 8)
    assert (scaled.start, scaled.end) == (20, 900)
    # an end that isn't stated follows from the events
    assert Scaled(Bare(at([1, 7])), 10).read(20).end == 70


def test_a_view_has_what_its_whole_has():
    mapped = Mapped(FULL, lambda events: events[::2])
    assert (mapped.span, mapped.start, mapped.end, mapped.sensor_size) == ((10, 75), 2, 90, (4, 3))
    assert mapped.holds_samples
    assert mapped.holds_triggers
    assert not mapped.knows_span
    assert mapped.about is FULL.about
    assert [f.exposure_start for f in mapped.frames(20, 41)] == [20, 40]
    assert mapped.inertial(15, 74).t.tolist() == [15, 50]
    assert mapped.triggers(20).channel.tolist() == [2, 0]
    assert [len(piece) for piece in mapped.pieces()] == [4, 0]
    assert [len(piece.frames) for piece in mapped.pieces()] == [4, 0]
    assert repr(mapped) == f"<mapped of {FULL!r}>"
    (only,) = Mapped(Bare(FULL.events), lambda events: events).pieces()
    assert type(only) is Events
    flipped = FlippedY(FULL).read(20, 30)
    assert (flipped.y.tolist(), flipped.y.dtype) == ([0, 2, 1], np.int16)


def test_a_recording_of_events_says_that_it_has_no_more():
    bare = Bare(at([5, 9]))
    for what, name in ((bare.frames, "frames"), (bare.inertial, "inertial samples"), (bare.triggers, "external trig")):
        with pytest.raises(FormatError, match=f"^{name}.* aren't read from recording files$"):
            what()
    assert (bare.start, bare.end, bare.knows_span) == (5, 9, True)
    assert not bare.holds_samples
    assert not bare.holds_triggers
    assert dict(bare.about) == dict(bare.repairs) == {}
    assert [piece.t.tolist() for piece in bare.pieces()] == [[5, 9]]
    assert bare.anomalies() == {"steps back in time": 0, "duplicate events": 0}
    assert repr(bare) == "<recording recording >"


@pytest.mark.parametrize(
    ("t", "x", "back", "twins"),
    [
        ([], [], 0, 0),
        ([3], [0], 0, 0),
        ([3, 3], [0, 0], 0, 1),
        ([3, 3, 3], [0, 0, 0], 0, 2),
        # not adjacent in the file
        ([3, 3, 3], [0, 1, 0], 0, 1),
        ([3, 4, 3, 4, 3], [0, 1, 0, 0, 0], 2, 2),
        ([9, 8, 8, 7], [0, 1, 2, 3], 2, 0),
    ],
)
def test_steps_back_and_duplicates_are_counted(t, x, back, twins):
    columns = Events.empty((4, 4)).columns._replace(
        t=np.array(t, np.int64), x=np.array(x, np.int16), y=np.zeros(len(t), np.int16), p=np.zeros(len(t), np.uint8)
    )
    assert anomalies_of(columns) == {"steps back in time": back, "duplicate events": twins}


def test_what_was_given_in_place_of_events_is_told():
    given = {"int": 5, "a list of int": [5], "list": [], "a tuple of str": ("a",), "ndarray [2, 3]": np.zeros((2, 3))}
    for words, value in given.items():
        message = f"sample must be a graph, not {words}: check the order of the transforms"
        assert str(wrong_type("sample", "a graph", value)) == message
    with pytest.raises(TypeError, match="sample must be Events or a Recording, not NoneType:"):
        as_events(None)
    with pytest.raises(TypeError, match="real must be Events"):
        as_events(None, "real")
    assert as_events(FULL.events) is FULL.events
    assert as_events(Bare(FULL.events)) == FULL.events


def test_samples_and_triggers_are_cut_and_joined():
    samples, levels = inertial([3, 5, 5, 9]), triggers([3, 5, 5, 9])
    bounds = [None, 3, 4, 5, 9, 10]
    for start, stop in itertools.product(bounds, bounds):
        inside = [t for t in (3, 5, 5, 9) if (start is None or t >= start) and (stop is None or t < stop)]
        assert samples.window(start, stop).t.tolist() == levels.window(start, stop).t.tolist() == inside
        assert [f.exposure_start for f in within(map(frame, (3, 5, 5, 9)), start, stop)] == inside
    window = samples.window(5, None)
    assert window.acceleration.tolist() == [[5] * 3, [5] * 3, [9] * 3]
    assert (-window.rotation).tolist() == window.acceleration.tolist()
    assert window.temperature.tolist() == [5, 5, 9]
    assert samples.shifted(3).t.tolist() == [0, 2, 2, 6]
    assert Inertial.joined([samples, samples.shifted(-10)]).t.tolist() == [3, 5, 5, 9, 13, 15, 15, 19]
    assert [column.shape for column in Inertial.joined([])] == [(0,), (0, 3), (0, 3), (0,)]
    assert [column.dtype for column in Inertial.empty()] == [np.int64, np.float32, np.float32, np.float32]
    assert Triggers.joined([levels, levels]).channel.tolist() == [0, 2, 2, 0] * 2
    assert [(column.shape, column.dtype) for column in Triggers.joined([])] == [
        ((0,), np.int64), ((0,), np.uint8), ((0,), np.uint8)
    ]  # fmt: skip


def test_without_bounds_is_all_the_time_there_is():
    ends = [-(2**63), 2**63 - 2]
    assert inertial(ends).window(None, None).t.tolist() == triggers(ends).window(None, None).t.tolist() == ends
    assert inertial(ends).window(ends[0] + 1, None).t.tolist() == ends[1:]
    assert [f.exposure_start for f in within(map(frame, ends), None, None)] == ends


def test_a_piece_is_bare_without_anything():
    none, some = Events.empty((4, 3), 5, 9), at([5])
    assert Piece.of_camera(none).is_empty
    assert is_empty(Piece.of_camera(none))
    assert is_empty(none)
    assert not is_empty(some)
    for piece in (
        Piece.of_camera(some),
        Piece.of_camera(none, [frame(5)]),
        Piece.of_camera(none, (), inertial([5])),
        Piece.of_camera(none, (), None, {"serial": "7"}),
    ):
        assert not piece.is_empty
        assert not is_empty(piece)
    piece = Piece.of_camera(at([5], start=2, end=9), [frame(5)])
    assert (piece.start, piece.end, piece.sensor_size, piece.t.tolist()) == (2, 9, (4, 3), [5])
    plain = without_samples(piece)
    assert type(plain) is Events
    assert (plain.start, plain.end) == (2, 9)
    assert without_samples(some) is some
