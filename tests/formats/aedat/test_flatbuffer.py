"""Flatbuffers that are read in place: no byte outside the buffer is ever taken for one of it."""

import struct

import numpy as np
import pytest
from flatbuffers import inertial, row, vector

from nvsdata.formats.aedat.flatbuffer import Rows, Table

# a table of the fields 0: 7, 2: a string, 3: -5; 1 is missing
TEXT = "häh?".encode()
LAYOUT = struct.pack("<6H", 12, 20, 4, 0, 8, 16)
BUFFER = struct.pack("<I4s", 20, b"NAME") + LAYOUT + struct.pack("<iiiii", 12, 7, 12, 0, -5)
BUFFER += struct.pack("<I", len(TEXT)) + TEXT


@pytest.mark.parametrize("before", [0, 4])
def test_fields_of_a_table(before):
    table = Table.root(memoryview(bytes(before) + BUFFER), before, b"NAME")
    assert [table.number(field, "<i", 99) for field in (0, 1, 3, 4, 5, 1_000)] == [7, 99, -5, 99, 99, 99]
    assert table.number(3, "<H", 0) == 65_531
    assert table.vector(2) == (before + 44, len(TEXT))
    assert table.vector(1) == table.vector(4) == (0, 0)
    assert table.string(2) == "häh?"
    assert table.string(1) == ""


def test_a_table_of_another_name_says_which():
    with pytest.raises(ValueError, match="no THIS but b'NAME'"):
        Table.root(memoryview(BUFFER), 0, b"THIS")


@pytest.mark.parametrize("end", range(len(BUFFER)))
def test_a_table_that_is_cut_is_broken(end):
    with pytest.raises((struct.error, ValueError)):
        Table.root(memoryview(BUFFER[:end]), 0, b"NAME").string(2)


@pytest.mark.parametrize("offset", [21, 2**31 - 1])
def test_a_layout_before_the_buffer_is_broken(offset):
    broken = BUFFER[:20] + struct.pack("<i", offset) + BUFFER[24:]
    with pytest.raises(ValueError, match="an offset is before the buffer"):
        Table.root(memoryview(broken), 0, b"NAME").number(0, "<i", 0)


def test_a_layout_may_begin_with_the_buffer():
    # field 2 of this layout lies 12 bytes into the table, as byte 8 says
    first = BUFFER[:20] + struct.pack("<i", 20) + BUFFER[24:32] + struct.pack("<i", 77) + BUFFER[36:]
    assert Table.root(memoryview(first), 0, b"NAME").number(2, "<i", 99) == 77


def test_a_string_up_to_the_end_is_whole():
    assert Table.root(memoryview(BUFFER), 0, b"NAME").string(2) == "häh?"
    longer = BUFFER[: -len(TEXT) - 4] + struct.pack("<I", len(TEXT) + 1) + TEXT
    with pytest.raises(ValueError, match=f"a string of {len(TEXT) + 1} bytes beyond the buffer"):
        Table.root(memoryview(longer), 0, b"NAME").string(2)


SAMPLES = [(1_000 * k, 20.5 + k, 0.25, -0.5, 1.0, 10.0 + k, -20.0, 30.0) for k in range(3)]


def columns(payload):
    rows = Rows(payload, *Table.root(payload, 4, b"IMUS").vector(0))
    return [rows.column(0, "<i8").tolist(), *(rows.column(field, "<f4").tolist() for field in range(1, 9))]


def test_rows_are_columns():
    expected = [list(column) for column in zip(*SAMPLES, strict=True)]
    assert columns(memoryview(inertial(SAMPLES))) == [*expected, [0, 0, 0]]
    assert columns(memoryview(inertial([]))) == [[]] * 9


def test_rows_need_not_have_the_same_fields():
    tables = [row([("<q", 5), None, ("<i", -1)]), row([None, ("<i", 3)]), row([("<q", 9)])]
    payload = memoryview(vector(b"SOME", tables))
    rows = Rows(payload, *Table.root(payload, 4, b"SOME").vector(0))
    assert rows.column(0, "<i8").tolist() == [5, 0, 9]
    assert rows.column(1, "<i4").tolist() == [0, 3, 0]
    assert rows.column(2, "<i4").tolist() == [-1, 0, 0]
    assert rows.column(0, "<u2", inside=1).tolist() == [0, 0, 0]
    assert rows.column(2, "<u2", inside=2).tolist() == [65_535, 0, 0]


def test_rows_that_are_cut_are_broken():
    # the last field takes 8 bytes of which 4 are used
    payload = inertial(SAMPLES)[:-4]
    assert columns(memoryview(payload))[7] == [30.0] * 3
    for end in range(8, len(payload)):
        with pytest.raises((struct.error, ValueError)):
            columns(memoryview(payload[:end]))


def test_more_tables_than_fit_are_named():
    # each takes four bytes in the vector and at least four of its own
    data = memoryview(bytes(12 + 8 * 7))
    with pytest.raises(ValueError, match="8 tables in 68 bytes"):
        Rows(data, 12, 8)
    with pytest.raises(ValueError, match="an offset is outside the buffer"):
        Rows(memoryview(np.full(68, 255, np.uint8)), 12, 7)
    # each of the tables is its own slot
    assert Rows(data, 12, 7).at.tolist() == [12, 16, 20, 24, 28, 32, 36]
