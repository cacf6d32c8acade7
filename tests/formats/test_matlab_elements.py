"""MATLAB v5 files made element by element."""

import struct
import zlib

import numpy as np
import pytest

import nvsdata
from nvsdata import FormatError
from nvsdata.formats import matlab

HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
# kinds of numbers, as MATLAB's documentation lists them
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
INT8, INT32, UINT32 = 1, 5, 6


def element(kind, body, small=False):
    if small:
        return struct.pack("<HH", kind, len(body)) + body.ljust(4, b"\0")
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def matrix(name, numbers, kind=9, category=6, small=False):
    """A matrix; small: its name and its numbers stand in their tags."""
    column = element(kind, np.asarray(numbers, KINDS.get(kind, "u1")).tobytes(), small)
    flags = element(UINT32, struct.pack("<II", category, 0))
    body = flags + element(INT32, struct.pack("<ii", len(numbers), 1)) + element(INT8, name.encode(), small)
    return element(14, body + column)


def read(tmp_path, *elements, **options):
    (tmp_path / "a.mat").write_bytes(HEAD + b"".join(elements))
    return nvsdata.read(tmp_path / "a.mat", **{"sensor_size": (10, 10), **options})


def others(*left_out, **numbers):
    found = {"ts": [5, 6, 7], "x": [1, 2, 3], "y": [3, 2, 1], "pol": [0, 1, 1]} | numbers
    return [matrix(name, column) for name, column in found.items() if name not in left_out]


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_of_each_kind(tmp_path, kind):
    times = [1, 2, 100]
    assert read(tmp_path, matrix("ts", times, kind), *others("ts")).t.tolist() == times


@pytest.mark.parametrize("category", range(1, 19))
def test_classes_of_numbers_are_read_and_others_passed_over(tmp_path, category):
    elements = [matrix("ts", [5, 6, 7], 9, category), *others("ts")]
    if 6 <= category <= 15:
        assert read(tmp_path, *elements).t.tolist() == [5, 6, 7]
    else:
        with pytest.raises(FormatError, match=r"no variable 'ts'; the file has \['pol', 'x', 'y'\]"):
            read(tmp_path, *elements)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_small_elements(tmp_path, count):
    columns = {"ts": range(count), "x": [3] * count, "y": [4] * count, "pol": [1] * count}
    ev = read(tmp_path, *(matrix(name, column, 2, small=True) for name, column in columns.items()))
    assert (ev.t.tolist(), ev.x.tolist(), ev.y.tolist()) == ([*range(count)], [3] * count, [4] * count)


@pytest.mark.parametrize(("kind", "size"), [(8, 8), (10, 8), (11, 8), (14, 8), (16, 8), (9, 9), (3, 3), (12, 4)])
def test_an_unknown_kind_of_numbers_is_named(tmp_path, kind, size):
    flags = element(UINT32, struct.pack("<II", 6, 0)) + element(INT32, bytes(8)) + element(INT8, b"what")
    wrong = element(14, flags + element(kind, bytes(size)))
    with pytest.raises(FormatError, match="variable 'what' is of an unknown type") as caught:
        read(tmp_path, *others(), wrong)
    assert caught.value.offset == len(HEAD) + len(b"".join(others()))


def test_a_truncated_element_is_named_and_a_torn_tag_left_out(tmp_path):
    whole = b"".join(others())
    for more in range(8):
        assert read(tmp_path, whole, bytes(more)).t.tolist() == [5, 6, 7]
    for left in (0, 7):
        with pytest.raises(FormatError) as caught:
            read(tmp_path, whole, struct.pack("<II", 9, left + 1), bytes(left))
        said = f"truncated: an element of {left + 1} bytes, {left} are left"
        assert (caught.value.reason, caught.value.offset) == (said, len(HEAD + whole))
        assert read(tmp_path, whole, struct.pack("<II", 9, left), bytes(left)).t.tolist() == [5, 6, 7]


def test_elements_of_odd_sizes_are_filled_up_and_compressed_ones_are_not(tmp_path):
    odd = [element(1, bytes(size)) for size in range(1, 9)]
    assert read(tmp_path, *odd, *others()).t.tolist() == [5, 6, 7]
    for column in others():
        body = zlib.compress(column)
        assert len(body) % 8
        packed = [struct.pack("<II", 15, len(body)) + body, *(one for one in others() if one != column)]
        assert read(tmp_path, *packed).t.tolist() == [5, 6, 7]


@pytest.mark.parametrize("size", [0, 7, 8])
def test_a_compressed_element_that_is_cut_short_or_damaged(tmp_path, size):
    body = zlib.compress(struct.pack("<II", 9, 0)[:size])
    packed = struct.pack("<II", 15, len(body)) + body
    begin = len(HEAD + b"".join(others()))
    if size == 8:
        assert read(tmp_path, *others(), packed).t.tolist() == [5, 6, 7]
        for wrong, reason in ((body[:-1], "a compressed element is truncated"), (b"what", "damaged compressed")):
            with pytest.raises(FormatError, match=f"byte {begin}: {reason}"):
                read(tmp_path, *others(), struct.pack("<II", 15, len(wrong)) + wrong)
    else:
        with pytest.raises(FormatError, match=f"byte {begin}: a compressed element is truncated"):
            read(tmp_path, *others(), packed)


def test_elements_inflate_to_the_bound_all_together(tmp_path, monkeypatch):
    column = others()[0]
    body = zlib.compress(column)
    packed = struct.pack("<II", 15, len(body)) + body
    for times in (1, 3):
        monkeypatch.setattr(matlab, "most_bytes", lambda size, times=times: times * len(column))
        assert read(tmp_path, *others("ts"), packed * times).t.tolist() == [5, 6, 7]
        with pytest.raises(FormatError, match="expands too far: a file of") as caught:
            read(tmp_path, *others("ts"), packed * (times + 1))
        size = (tmp_path / "a.mat").stat().st_size
        assert caught.value.reason == (
            f"expands too far: a file of {size} bytes may expand to {times * len(column)} at most"
        )
        assert caught.value.offset == len(HEAD + b"".join(others("ts"))) + times * len(packed)


def struct_of(fields, length, name="TD"):
    """A struct of matrices by name; `length`: bytes that each name takes."""
    body = element(UINT32, struct.pack("<II", 2, 0)) + element(INT32, struct.pack("<ii", 1, 1))
    body += element(INT8, name.encode()) + element(INT32, struct.pack("<i", length), small=True)
    body += element(INT8, b"".join(field.encode().ljust(length, b"\0") for field in fields))
    return element(14, body + b"".join(fields.values()))


@pytest.mark.parametrize("length", [3, 4, 5, 32])
def test_fields_of_a_struct(tmp_path, length):
    names = {"ts": [5, 6], "x": [1, 2], "y": [3, 4], "pol": [0, 1]}
    fields = {name: matrix("", column) for name, column in names.items()}
    ev = read(tmp_path, struct_of(fields, length))
    assert [column.tolist() for column in ev.columns] == [[5, 6], [1, 2], [3, 4], [0, 1]]
    # a struct within a struct is passed over
    inner = struct_of({"ts": matrix("", [1])}, 3)
    assert read(tmp_path, struct_of({"a": inner} | fields, length)).t.tolist() == [5, 6]
    with pytest.raises(FormatError, match=r"no variable 'ts'; the file has \['pol', 'x', 'y'\]"):
        read(tmp_path, struct_of({name: fields[name] for name in ("x", "y", "pol")}, length))


def test_a_struct_of_more_fields_than_are_looked_at(tmp_path, monkeypatch):
    monkeypatch.setattr(matlab, "MOST_FIELDS", 5)
    names = {"ts": [5, 6], "x": [1, 2], "y": [3, 4], "pol": [0, 1]}
    fields = {name: matrix("", column) for name, column in names.items()}
    assert len(read(tmp_path, struct_of({"a": matrix("", [1])} | fields, 4))) == 2
    with pytest.raises(FormatError, match="no variable 'pol'"):
        read(tmp_path, struct_of({name: matrix("", [1]) for name in "ab"} | fields, 4))


@pytest.mark.parametrize(
    ("x", "y", "shifted"),
    [
        ([1, 5, 10], [1, 2, 3], True),
        ([1, 5, 9], [1, 2, 10], True),
        ([2, 5, 10], [3, 4, 10], True),
        ([1, 5, 9], [1, 2, 9], False),
        ([0, 5, 10], [1, 2, 3], None),
        ([1, 5, 10], [0, 2, 3], None),
        ([1, 5, 11], [1, 2, 3], None),
    ],
)
def test_coordinates_that_count_from_one(tmp_path, x, y, shifted):
    if shifted is None:
        with pytest.raises(FormatError, match=r"event [02]: outside the sensor of 10x10"):
            read(tmp_path, *others(x=x, y=y))
        return
    ev = read(tmp_path, *others(x=x, y=y))
    assert (ev.x.tolist(), ev.y.tolist()) == (
        [value - shifted for value in x],
        [value - shifted for value in y],
    )


def test_files_of_a_byte_order_or_beginning_that_is_not_read(tmp_path):
    for head in (HEAD[:124] + b"\x01\x00MI", HEAD[:127], HEAD[:100]):
        (tmp_path / "a.mat").write_bytes(head)
        with pytest.raises(FormatError, match="byte 124: not a little-endian MATLAB v5 file, or truncated"):
            nvsdata.read(tmp_path / "a.mat")
    (tmp_path / "a.mat").write_bytes(HEAD)
    with pytest.raises(FormatError, match=r"no variable 'ts'; the file has \[\]"):
        nvsdata.read(tmp_path / "a.mat")


def test_matrices_of_too_few_parts_are_passed_over(tmp_path):
    parts = [element(UINT32, struct.pack("<II", 6, 0)), element(INT32, bytes(8)), element(INT8, b"what")]
    short = [element(14, b"".join(parts[:count])) for count in range(4)]
    # flags of less than 8 bytes
    flagless = element(14, element(UINT32, bytes([6, 0, 0, 0]), small=True) + b"".join(parts[1:]) + element(2, b"\1"))
    assert read(tmp_path, *short, flagless, *others()).t.tolist() == [5, 6, 7]
