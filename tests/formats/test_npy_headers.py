"""NumPy arrays that are cut, of unusual shapes, or at the bounds of what events hold."""

import io

import numpy as np
import pytest
from numpy.lib import format as npy

import nvsdata
from nvsdata import FormatError
from nvsdata.formats.npy import NpyRecording

FIELDS = [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "u1")]


def header(shape, descr="<f8", fortran=False, version=1):
    file = io.BytesIO()
    write = npy.write_array_header_1_0 if version == 1 else npy.write_array_header_2_0
    write(file, {"shape": shape, "fortran_order": fortran, "descr": descr})
    return file.getvalue()


def opened(tmp_path, raw, **options):
    (tmp_path / "a.npy").write_bytes(raw)
    return nvsdata.open(tmp_path / "a.npy", sensor_size=(10, 10), **options)


@pytest.mark.parametrize("version", [1, 2])
def test_headers_of_either_version(tmp_path, version):
    body = np.array([[1, 2, 5, 1], [3, 4, 9, 0]], "<f8").tobytes()
    assert opened(tmp_path, header((2, 4), version=version) + body).read().t.tolist() == [5, 9]


@pytest.mark.parametrize(
    ("shape", "descr", "reason"),
    [
        ((2**48, 4), "<f8", f"an array of shape ({2**48}, 4)"),
        ((2**48 - 1, 4), "<f8", f"truncated: 1 of {2**48 - 1} events are there"),
        ((-1, 4), "<f8", "an array of shape (-1, 4)"),
        ((1, 3), "<f8", "an array of shape (1, 3); events are [N] with fields t, x, y, p, or [N, 4]"),
        ((1, 4, 1), "<f8", "an array of shape (1, 4, 1); events are [N] with fields t, x, y, p, or [N, 4]"),
        ((4,), "<f8", "an array of shape (4,); events are [N] with fields t, x, y, p, or [N, 4]"),
        ((1, 4), FIELDS, "an array of shape (1, 4); events are [N] with fields t, x, y, p, or [N, 4]"),
        ((1,), [*FIELDS[:3], ("p", "S1")], "not of numbers"),
        ((1, 4), "<c16", "an array of complex128, not of numbers"),
    ],
)
def test_shapes_that_hold_no_events(tmp_path, shape, descr, reason):
    with pytest.raises(FormatError) as caught:
        opened(tmp_path, header(shape, descr) + bytes(32))
    assert caught.value.reason.endswith(reason)
    assert caught.value.offset == (0 if "truncated" not in reason else len(header(shape, descr)) + 32)


def test_a_header_that_numpy_cannot_read_is_quoted_in_part(tmp_path):
    for raw in (b"\x93NUMPY\x01\x00\x05\x00what?", b"\x93NUMPY\x09\x00" + bytes(9), header((1, 4))[:40]):
        with pytest.raises(FormatError, match=r"byte 0: damaged header of a NumPy array: .") as caught:
            opened(tmp_path, raw)
        assert len(caught.value.reason) <= len("damaged header of a NumPy array: ") + 100


@pytest.mark.parametrize("fortran", [False, True])
@pytest.mark.parametrize("cut", [1, 8, 31, 32, 33, 64])
def test_arrays_that_are_cut(tmp_path, cut, fortran):
    rows = np.array([[1, 2, 5, 1], [3, 4, 9, 0], [5, 6, 11, 1]], "<f8")
    raw = header((3, 4), fortran=fortran) + rows.tobytes("F" if fortran else "C")
    raw = raw[:-cut]
    left = (96 - cut) // 32
    with pytest.raises(FormatError, match="truncated: ") as caught:
        opened(tmp_path, raw)
    torn = (96 - cut) % 32
    reason = f"{torn} bytes are left over, but a record has 32" if torn else f"{left} of 3 events are there"
    assert (caught.value.reason, caught.value.offset) == (f"truncated: {reason}", len(raw) - torn)
    if fortran:
        with pytest.raises(FormatError, match=f"truncated: {left} of 3 events are there"):
            opened(tmp_path, raw, strict=False)
    else:
        found = opened(tmp_path, raw, strict=False)
        assert found.read().t.tolist() == [5, 9, 11][:left]
        expected = {"bytes of a torn record, cut off": torn, "events that are cut off": 3 - left}
        assert found.repairs == {what: count for what, count in expected.items() if count}


def test_bytes_after_the_array_are_left_out(tmp_path):
    rows = np.array([[1, 2, 5, 1], [3, 4, 9, 0]], "<f8")
    raw = header((2, 4)) + rows.tobytes()
    assert opened(tmp_path, raw + rows.tobytes()).read().t.tolist() == [5, 9]
    records = np.array([(1, 2, 5, 1)], FIELDS)
    assert opened(tmp_path, header((1,), FIELDS) + records.tobytes() * 3).read().t.tolist() == [5]


@pytest.mark.parametrize(
    ("rows", "t", "p"),
    [
        ([[1, 2, 1, 0], [1, 2, 0, 1]], [0, 1], [1, 0]),
        ([[1, 2, 7, 0], [1, 2, 8, -1]], [7, 8], [0, 0]),
        ([[1, 2, -1, 7], [1, 2, 1, 8]], [7, 8], [0, 1]),
        ([[1, 2, 0.5, 0], [1, 2, 2, 1]], [500_000, 2_000_000], [0, 1]),
        ([[1, 2, 1, 0], [1, 2, 2.25, 1]], [1_000_000, 2_250_000], [0, 1]),
        ([[1, 2, 1, 0], [1, 2, 2, 1]], [1, 2], [0, 1]),
    ],
)
def test_what_columns_without_names_mean(tmp_path, rows, t, p):
    ev = opened(tmp_path, header((2, 4)) + np.array(rows, "<f8").tobytes()).read()
    assert (sorted(ev.t.tolist()), [value for _, value in sorted(zip(ev.t, ev.p, strict=True))]) == (t, p)


@pytest.mark.parametrize(("seconds", "fine"), [(2.0**42 - 0.5, True), (2.0**43, False), (-(2.0**43), False)])
def test_seconds_up_to_2_to_the_62_us(tmp_path, seconds, fine):
    rows = np.array([[1, 2, 0.5, 0], [1, 2, seconds, 1]])
    recording = opened(tmp_path, header((2, 4)) + rows.tobytes())
    if fine:
        # the digits of a float64 are 512 µs apart there
        assert np.abs(recording.read().t - [500_000, 2**42 * 10**6 - 500_000]).max() < 512
    else:
        with pytest.raises(FormatError, match=r"has times that are not numbers, or beyond 2\^62 µs"):
            recording.read()


@pytest.mark.parametrize("kind", ["rows", "columns", "fields"])
@pytest.mark.parametrize(
    ("came", "went", "result"),
    [
        (5, 6, None),
        (2, 7, None),
        (5, 11, None),
        (4, 11, 8),
        (3, 9, 8),
        (1, 13, 12),
        (12, 1, 0),
        (7, 1, None),
        (8, 1, 0),
        (13, 6, 4),
        # a block out of order: windows are cut from the whole
        (0, 8, None),
        (1, 16, None),
    ],
)
def test_events_that_strayed_over_a_block_are_told(tmp_path, monkeypatch, kind, came, went, result):
    monkeypatch.setattr(NpyRecording, "block", 4)
    t = 100 * np.arange(17)
    t = np.insert(np.delete(t, came), went, t[came])
    array = np.stack([t * 0 + 1, t * 0 + 2, t, t * 0], 1)
    if kind == "fields":
        array = np.array([tuple(row) for row in array.tolist()], FIELDS)
    np.save(tmp_path / "a.npy", np.asfortranarray(array) if kind == "columns" else array)
    recording = nvsdata.open(tmp_path / "a.npy", sensor_size=(10, 10))
    if result is None:
        whole = recording.read()
        for start in range(-50, 1_700, 150):
            window = nvsdata.open(tmp_path / "a.npy", sensor_size=(10, 10)).read(start, start + 300)
            assert window == whole.window(start, start + 300)
        assert nvsdata.open(tmp_path / "a.npy").span == (0, 1_600)
        return
    with pytest.raises(FormatError, match="events are displaced by more than 4 records") as caught:
        recording.read()
    assert caught.value.offset == recording.header_size + result * recording.record_size


def test_whole_numbers_keep_all_their_digits(tmp_path):
    rows = np.array([[1, 2, 2**60 + 1, 0], [3, 4, 2**62 - 1, 1]])
    ev = opened(tmp_path, header((2, 4), "<i8") + rows.tobytes()).read()
    assert ev.t.tolist() == [2**60 + 1, 2**62 - 1]
