"""Packets of AEDAT 3: headers at exactly their bounds, and events that don't fit."""

from struct import pack

import numpy as np
import pytest

from nvsdata.kernels.decode.aedat3 import CUT, FINE, NONSENSE, TORN, aedat3_decode, aedat3_packets


def packet(kind=1, size=8, when=4, overflow=0, number=2, valid=2, body=b"\7" * 16):
    return pack("<HHIIIIII", kind, 0, size, when, overflow, number, number, valid) + body


def packets_of(raw, start=0):
    index, fault, at = aedat3_packets(np.frombuffer(raw, np.uint8), -1, len(raw), start)
    return index.tolist(), fault, at


TWO = 0x07070707


def test_packets_of_events_are_listed():
    assert len({FINE, TORN, NONSENSE, CUT}) == 4
    raw = b"#" * 5 + packet() + packet(kind=2, size=3, number=3, body=bytes(9)) + packet(overflow=3, valid=1)
    raw += packet(number=0, valid=0, body=b"") + packet(number=1, valid=1, body=pack("<II", 1, 9))
    # first byte, number, what is added, first and last time, whether some are invalid
    first, third, last = 5 + 28, 5 + 44 + 37 + 28, 5 + 44 + 37 + 44 + 28 + 28
    add = 3 * 2**31
    assert packets_of(raw, 5) == (
        [[first, 2, 0, TWO, TWO, 0], [third, 2, add, add + TWO, add + TWO, 1], [last, 1, 0, 9, 9, 0]],
        FINE,
        len(raw),
    )
    assert packets_of(b"##", 2) == ([], FINE, 2)
    for count in (40, 64, 65, 64 + 256, 64 + 257, 2_000):
        many = packets_of(packet() * count)
        assert [row[0] for row in many[0]] == [28 + 44 * k for k in range(count)]
        assert many[1:] == (FINE, count * 44)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    ("header", "sound"),
    [
        ({"size": 0, "kind": 2}, False),
        ({"size": 1, "kind": 2, "number": 16}, True),
        ({"size": 2**31, "number": 0, "valid": 0, "kind": 2}, False),
        ({"size": 2**31 - 1, "number": 0, "valid": 0, "kind": 2, "body": b""}, True),
        ({"overflow": 2**31}, False),
        ({"overflow": 2**31 - 1}, True),
        ({"number": 2**31, "kind": 2}, False),
        ({"valid": 3}, False),
        ({"valid": 0}, True),
        ({"size": 7}, False),
        ({"size": 9}, False),
        ({"when": 5}, False),
        ({"when": 3}, False),
        ({"when": 3, "kind": 2}, True),
    ],
    ids=str,
)
def test_headers_at_their_bounds(tmp_path, header, sound, known):
    raw = packet() + packet(**header)
    if known:
        listed, fault, at = packets_of(raw)
    else:
        (tmp_path / "a").write_bytes(raw)
        with (tmp_path / "a").open("rb") as file:
            index, fault, at = aedat3_packets(np.frombuffer(raw[:3], np.uint8), file.fileno(), len(raw), 0)
        listed = index.tolist()
    assert (fault, at) == ((FINE, len(raw)) if sound else (NONSENSE, 44))
    assert len(listed) == 1 + (sound and header.get("kind", 1) == 1)
    assert listed[0] == [28, 2, 0, TWO, TWO, 0]


def test_what_is_cut_is_told_from_what_is_torn(tmp_path):
    raw = packet() + packet(number=3, valid=3, body=b"\1" * 24)
    for length, numbers in ((44, [2]), (45, [2]), (71, [2]), (72, [2]), (79, [2]), (80, [2, 1]), (95, [2, 2])):
        listed, fault, at = packets_of(raw[:length])
        assert [row[1] for row in listed] == numbers
        # a torn packet ends after its last complete event
        assert (fault, at) == (
            (FINE, 44) if length == 44 else (TORN, 44 if length < 72 else 72 + 8 * (length // 8 - 9))
        )
        (tmp_path / "a").write_bytes(raw[:length])
        with (tmp_path / "a").open("rb") as file:
            index, fault, at = aedat3_packets(np.frombuffer(raw[:3], np.uint8), file.fileno(), len(raw), 0)
        # the file was longer when it was opened
        assert fault == CUT
        assert index[:, 1].tolist() in ([], [2])
    assert packets_of(raw)[1:] == (FINE, len(raw))


def decoded(packets, size=(32_768, 32_768), kept=1, base=4):
    """What is decoded of packets, each a list of (t, x, y, p, marked), and whether its header tells of invalid ones."""
    body, index = b"", []
    for events, some_invalid, first, last in packets:
        index.append((base + len(body), len(events), 2**31, 2**31 + first, 2**31 + last, some_invalid))
        for t, x, y, p, marked in events:
            body += pack("<II", x << 17 | y << 2 | p << 1 | marked, t)
    n = len(body) // 8 + kept
    columns = [np.zeros(n, kind) for kind in (np.int64, np.int16, np.int16, np.uint8)]
    found = aedat3_decode(
        np.frombuffer(body, np.uint8), base, np.array(index, np.int64).reshape(-1, 6), *size, kept, *columns
    )
    return found, list(zip(*(column[kept : kept + found[0]].tolist() for column in columns), strict=True))


@pytest.mark.parametrize(
    ("t", "strays"),
    [(4_000, False), (3_999, True), (5_000, False), (5_007, False), (6_007, False), (6_008, True), (0, True)],
)
@pytest.mark.parametrize("marked", [1, 0])
def test_events_lie_between_the_first_and_the_last_of_their_packet(t, strays, marked):
    events = [(5_000, 1, 2, 0, marked), (t, 3, 4, 1, 1), (5_007, 0, 0, 1, 1)]
    calm = ([(9, 5, 6, 1, 1)], 0, 9, 9)
    (count, bad, unmarked, strayed), columns = decoded([calm, (events, 0, 5_000, 5_007), calm])
    assert (count, bad, unmarked, strayed) == (5, -1, 1 - marked, 1 if strays else -1)
    assert columns[1:4] == [(2**31 + when, x, y, p) for when, x, y, p, _ in events]
    # an event that counts as invalid may be anywhere, and so may the others then
    (count, bad, unmarked, strayed), columns = decoded([calm, (events, 1, 5_000, 5_007), calm])
    assert (count, bad, unmarked, strayed) == (4 + marked, -1, 0, -1)
    assert columns[-3:] == [(2**31 + t, 3, 4, 1), (2**31 + 5_007, 0, 0, 1), (2**31 + 9, 5, 6, 1)]


@pytest.mark.parametrize(
    ("size", "place", "inside"),
    [
        ((4, 9), (3, 8), True),
        ((4, 9), (4, 8), False),
        ((4, 9), (3, 9), False),
        ((1, 1), (0, 0), True),
        ((1, 1), (0, 1), False),
        ((32_768, 32_768), (32_767, 32_767), True),
    ],
)
@pytest.mark.parametrize("marked", [1, 0])
def test_the_first_event_outside_is_told_by_its_byte(size, place, inside, marked):
    events = [(5, 0, 0, 1, marked), (6, *place, 0, 1), (7, *place, 0, 1)]
    (count, bad, _, _), columns = decoded([([(5, 0, 0, 0, 1)], 0, 5, 5), (events, 0, 5, 7)], size)
    assert count == 4
    assert bad == (-1 if inside else 4 + 8 + 8)
    assert columns[2][1:3] == place


def test_times_near_both_ends_of_their_bits():
    last = 2**31 - 1
    for first, end in ((0, 999), (last - 999, last)):
        events = [(t, 1, 1, 1, 1) for t in (first, 0 if first == 0 else last, end)]
        found, _ = decoded([(events, 0, first, end)])
        assert found == (3, -1, 0, -1)
