"""The decoder of a camera's stream, against the vendor's library and against itself."""

import csv
import json
import zlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from places import SHARED

from nvsdata.recording.davis.stream import SPECIALS, DavisDecoder
from nvsdata.recording.simulated.camera import SAMPLE_WORDS as SAMPLE
from nvsdata.recording.simulated.camera import readings

FOLDER = SHARED / "davis"
CASES = json.loads((FOLDER / "cases.json").read_text()) if FOLDER.is_dir() else {"cases": {}, "profiles": {}}
VALUES = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z", "temperature")

# what the vendor's library does that no reader should: it repeats a sample whose end comes twice, takes samples without
# a scale word for whole, and gives out frames of no pixels
REPEATED_OR_UNSCALED = {
    "hostile_imu_garbage",
    "hostile_imu_garbage_b",
    "hostile_imu_never_scaled",
    "hostile_random_words",
    "tiny_imu_end_without_start",
    "tiny_imu_end_without_start_b",
    "tiny_imu_no_scale",
}


def decoder(profile):
    def seen(kind):
        columns, rows = profile[f"{kind}_columns"], profile[f"{kind}_rows"]
        return (rows, columns) if profile[f"{kind}_orientation"] & 4 else (columns, rows)

    return DavisDecoder(
        *seen("dvs"),
        swap=bool(profile["dvs_orientation"] & 4),
        frame_size=seen("aps"),
        frame_orientation=profile["aps_orientation"],
        chip=profile["chip_id"],
        inertial=profile["imu_type"],
        inertial_flips=profile["imu_orientation"],
    )


def decoded(decoder, pieces):
    """All that a stream holds: events [n, 4], specials, samples, frames."""
    events, specials, samples, frames = [np.empty((0, 4), np.int64)], [], [], []
    for piece in pieces:
        ev = decoder.feed(piece)
        events.append(np.stack((ev.t, ev.x, ev.y, ev.p), 1).astype(np.int64))
        specials += [tuple(row) for row in np.stack(decoder.specials[:3], 1).tolist()]
        t, *values = decoder.samples
        values = np.concatenate((*values[:2], values[2][:, None]), 1, dtype=np.float32, casting="same_kind")
        samples += zip(decoder.sample_words.tolist(), t.tolist(), map(tuple, values.tolist()), strict=True)
        frames += zip(decoder.frame_words, decoder.frames, strict=True)
    return np.concatenate(events), specials, samples, frames


def pieces_of(name):
    data = (FOLDER / f"{name}.bin").read_bytes()
    ends = [0, *np.cumsum([int(n) for n in (FOLDER / f"{name}.transfers").read_text().split()])]
    return [data[a:b] for a, b in pairwise(ends)]


def rows_of(name, kind):
    path = FOLDER / f"{name}.{kind}.csv"
    if not path.exists():
        return []
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", sorted(CASES["cases"]))
def test_it_agrees_with_the_vendors_library(name):
    ours = decoder(CASES["profiles"][CASES["cases"][name]["profile"]])
    events, specials, samples, frames = decoded(ours, pieces_of(name))

    expected = np.load(FOLDER / f"{name}.events.npz")["events"].copy()
    if (true_times := FOLDER / f"{name}.t_state.npy").exists():
        expected[:, 0] = np.load(true_times)
    assert np.array_equal(events, expected)

    rows = rows_of(name, "special")
    assert [(word, kind) for word, _, kind in specials] == [(int(row["word"]), int(row["type"])) for row in rows]
    # the vendor's times of wraps and resets mean nothing
    assert all(t == int(row["t_state"]) for (_, t, kind), row in zip(specials, rows, strict=True) if kind > 1)

    given_out = {
        int(row["word"]): (int(row["t_state"]), tuple(np.float32([row[value] for value in VALUES]).tolist()))
        for row in rows_of(name, "imu")
    }
    found = {word: (t, values) for word, t, values in samples}
    if name in REPEATED_OR_UNSCALED:
        assert found.keys() <= given_out.keys()
    else:
        assert found == given_out
    compare_frames(name, frames)


def compare_frames(name, frames):
    path = FOLDER / f"{name}.frames.npz"
    kept = np.load(path) if path.exists() else {"word": []}
    expected = []
    for n, word in enumerate(kept["word"]):
        shape = int(kept["length_y"][n]), int(kept["length_x"][n])
        pixels = kept["pixels"][kept["offset"][n] : kept["offset"][n + 1]].reshape(shape)
        # frames of no pixels are none; the vendor's times are right modulo 2^31 only
        times = [
            int(kept[key][n]) % 2**31 for key in ("t_start_frame", "t_start_exposure", "t_end_exposure", "t_end_frame")
        ]
        if pixels.size:
            place = int(kept["position_x"][n]), int(kept["position_y"][n])
            expected.append((int(word), times, place, shape, zlib.crc32(pixels.tobytes())))
    ours = [
        (
            word,
            [t % 2**31 for t in (f.start, f.exposure_start, f.exposure_end, f.end)],
            (f.x, f.y),
            f.pixels.shape,
            zlib.crc32(f.pixels.tobytes()),
        )
        for word, f in frames
    ]
    assert ours == expected


@pytest.mark.parametrize("cut", range(20))
def test_a_lost_wrap_to_the_next_period_is_reported_wherever_the_stream_is_cut(cut):
    # 2^31 µs are 65,536 wraps: sixteen words of 4,095, one of 15, and one that is lost
    words = np.array([0x0001, *[0x7FFF] * 16, 0x700F, 0x800A, 0x8005, 0x7001], "<u2")
    ours = DavisDecoder(240, 180, steady=True)
    specials = decoded(ours, [words[:cut].tobytes(), words[cut:].tobytes()])[1]
    assert specials == [(0, 0, 1), (20, (1 << 31) + (1 << 15), 0)]


@given(st.lists(st.integers(0, 0xFFFF), max_size=400), st.lists(st.integers(1, 50), max_size=30))
def test_any_split_gives_the_same(words, cuts):
    data = np.array(words, "<u2").tobytes()
    ends = np.minimum(2 * np.cumsum(cuts, dtype=np.int64), len(data)).tolist() if cuts else []
    pieces = [data[a:b] for a, b in zip([0, *ends], [*ends, len(data)], strict=True)]
    whole, split = DavisDecoder(64, 48), DavisDecoder(64, 48)
    one, many = decoded(whole, [data]), decoded(split, pieces)
    assert np.array_equal(one[0], many[0])
    assert one[1:3] == many[1:3]
    assert [(word, f.end, f.pixels.tobytes()) for word, f in one[3]] == [
        (word, f.end, f.pixels.tobytes()) for word, f in many[3]
    ]
    assert whole.error_counts == split.error_counts


def test_events_rows_and_times():
    ours = DavisDecoder(240, 180)
    # time 5, row 3, ON at column 7, OFF at 8, one wrap, time 1, column 9 in the same row
    ev = ours.feed(np.array([0x8005, 0x1003, 0x3007, 0x2008, 0x7001, 0x8001, 0x3009], "<u2").tobytes())
    assert ev.t.tolist() == [5, 5, 32769]
    assert (ev.x.tolist(), ev.y.tolist(), ev.p.tolist()) == ([7, 8, 9], [3, 3, 3], [1, 0, 1])
    assert ev.sensor_size == (240, 180)


def test_times_go_on_where_wraps_and_resets_break_them():
    def words(*times):
        """A time word for each, and an event with it; None is a reset."""
        return [word for t in times for word in ((0x0001,) if t is None else (0x8000 | t, 0x3001))]

    ours = DavisDecoder(240, 180, steady=True)
    stream = [*words(None, 1, 5), 0x7001, *words(32, 7_000, 232), *SAMPLE, *words(None, 100)]
    ev = ours.feed(np.array(stream, "<u2").tobytes())
    assert ev.t.tolist() == [1, 5, 32_768 + 32, 39_768, 65_536 + 232, 98_304 + 100]
    # what comes beside has the same clock
    assert ours.samples.t.tolist() == [65_536 + 232]
    assert {name: count for name, count in ours.error_counts.items() if count} == {
        "time_not_rising": 2,
        "lost_wraps": 2,
        "late_resets": 1,
    }
    # an earlier time within the same wrap can only be of a later one
    assert ours.feed(np.array(words(99), "<u2").tobytes()).t.tolist() == [131_072 + 99]


@given(st.lists(st.integers(0, 0xFFFF), max_size=400), st.integers(0, 400))
def test_a_steady_clock_never_falls_whatever_comes(words, cut):
    ours = DavisDecoder(64, 48, steady=True)
    pieces = [ours.feed(np.array(part, "<u2").tobytes()).t for part in (words[:cut], words[cut:])]
    reset = next((n for n, word in enumerate(words) if word == 1), None)
    if reset is None:
        assert (np.diff(np.concatenate(pieces)) >= 0).all()


def test_what_is_amiss_is_counted():
    ours = DavisDecoder(240, 180)
    ours.feed(np.array([0x8005, 0x8005, 0x10B4, 0x30F0, 0x0FFF, 0x5F00, 0x6C00], "<u2").tobytes() + b"\1")
    error_counts = {name: count for name, count in ours.error_counts.items() if count}
    assert error_counts == {
        "row_out_of_range": 1,
        "column_out_of_range": 1,
        "time_not_rising": 1,
        "unknown_special": 1,
        "unknown_data": 2,
        "odd_bytes": 1,
    }


def test_more_special_events_than_the_kernel_has_room_for():
    ours = DavisDecoder(240, 180)
    ours.feed(np.full(5000, 0x0004, "<u2").tobytes())
    assert ours.specials.word.tolist() == list(range(5000))
    assert {SPECIALS[kind] for kind in ours.specials.kind.tolist()} == {"external_pulse"}


@pytest.mark.parametrize("size", [1, 3, 100])
def test_rising_edges_and_pulses_after_the_first_reset_are_triggers(size):
    rising, falling, pulse, generator = 0x0003, 0x0002, 0x0004, 0x0011
    before = [0x8005, rising, pulse]
    words = [*before, 0x0001, 0x800A, rising, 0x8014, falling, 0x801E, pulse, 0x8028, generator, 0x8032, rising]
    blocks = [np.array(words[i : i + size], "<u2").tobytes() for i in range(0, len(words), size)]

    def times(last):
        found = [times for _, times in DavisDecoder(240, 180, steady=True).decoded(blocks, last)]
        return np.concatenate(found).tolist()

    assert times(None) == [10, 30, 50]
    assert times(50) == [10, 30]
    assert times(30) == [10]


@pytest.mark.parametrize("size", [1, 4, 100])
@pytest.mark.parametrize(("last", "end"), [(None, 30), (31, 30), (30, 29), (21, 20), (20, 19), (10, 9)])
def test_what_comes_before_the_first_reset_or_from_the_end_on_is_left_out(size, last, end):
    before = [0x8005, 0x1003, 0x3001, *SAMPLE, *frame_words()]
    words = [*before, 0x0001, 0x800A, 0x1003, 0x3002, *SAMPLE, 0x8014, 0x3003, *SAMPLE, *frame_words(), 0x801E, 0x3004]
    blocks = [np.array(words[i : i + size], "<u2").tobytes() for i in range(0, len(words), size)]
    found = [piece for piece, _ in DavisDecoder(240, 180, steady=True).decoded(blocks, last)]
    kept = [t for t in (10, 20, 30) if last is None or t < last]
    assert [t for piece in found for t in piece.t.tolist()] == kept
    assert [t for piece in found for t in piece.inertial.t.tolist()] == [t for t in kept if t < 30]
    assert [frame.end for piece in found for frame in piece.frames] == [t for t in kept if t == 20]
    assert ({piece.start for piece in found}, found[-1].end) == ({0}, end)
    assert [piece.about for piece in found if piece.about] == [
        {"temperature": 25.0} for piece in found if piece.inertial.t.size
    ]


def frame_words():
    """Of one pixel."""
    first, last = readings(np.zeros((1, 1), int), [0, 0, 0, 0])
    return np.frombuffer(first + last, "<u2").tolist()
