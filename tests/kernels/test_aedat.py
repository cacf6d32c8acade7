"""Records of AEDAT against slow decoders, and packets' headers at exactly their bounds."""

from struct import pack

import numpy as np
import pytest

from nvsdata.kernels.aedat import (
    CUT,
    DAVIS,
    DVS128,
    FINE,
    NONSENSE,
    TORN,
    aedat2_decode,
    aedat2_encode,
    aedat3_decode,
    aedat3_packets,
)
from nvsdata.kernels.decode.clock import FELL, LAST, MIXED, NEXT, UNKNOWN, clock_at, nearest

CHIPS = {DVS128: (128, 128), DAVIS: (240, 180)}


def place_of(address, layout, chip):
    """Column, row, polarity of an address, and whether it is that of a polarity event."""
    if layout == DVS128:
        column, row, on, other = address >> 1 & 127, address >> 8 & 127, 1 - (address & 1), address & 0x80008000
    else:
        column, row, on, other = address >> 12 & 1023, address >> 22 & 511, address >> 11 & 1, address & 0x80000400
    return chip[0] - 1 - column, chip[1] - 1 - row, on, not other


def slow(records, layout, chip, size, time):
    """Columns of events, the first outside the sensor, and the last time."""
    events, bad = [], -1
    for i, (address, word) in enumerate(records):
        time = int(nearest(word, time, 32))
        x, y, on, event = place_of(address, layout, chip)
        if event:
            bad = i if bad < 0 and not (0 <= x < size[0] and 0 <= y < size[1]) else bad
            events.append((time, x, y, on))
    return events, bad, time


def addresses_of(rng, layout, chip, n, kind):
    """Addresses of events within the chip; or of all kinds; or of events anywhere in the address."""
    x, y = rng.integers(0, chip[0], n), rng.integers(0, chip[1], n)
    x[rng.random(n) < 0.2], y[rng.random(n) < 0.2] = chip[0] - 1, 0
    if kind == "any":
        return rng.integers(0, 2**32, n)
    if kind == "outside":
        x[-1:], y[:1] = rng.choice((chip[0], 1023)), rng.choice((chip[1], 511))
    bits = rng.integers(0, 2, n)
    address = y << 8 | x << 1 | bits if layout == DVS128 else y << 22 | x << 12 | bits << 11
    if kind == "one" and n:
        address[rng.integers(n)] |= rng.choice((0x80000000, 0x8000 if layout == DVS128 else 0x400))
    return address & 0x7FFF if layout == DVS128 and kind == "outside" else address


@pytest.mark.parametrize("layout", [DVS128, DAVIS], ids=["dvs128", "davis"])
@pytest.mark.parametrize("kind", ["inside", "outside", "one", "any"])
def test_records_decode_as_a_slow_decoder_does(layout, kind):
    rng = np.random.default_rng(layout)
    chip = CHIPS[layout]
    for n in (0, 1, 2, 5, 9) * 8:
        address = addresses_of(rng, layout, chip, n, kind)
        last = int(rng.choice((0, 70_000, 2**32 - 50, 2**31 + 7, 3 * 2**32 - 5)))
        t = last + np.cumsum(rng.choice((0, 1, 40, -3), n, p=(0.3, 0.5, 0.15, 0.05)))
        t = np.sort(t) if rng.random() < 0.7 else t
        size = chip if rng.random() < 0.7 else (chip[0] - 20, chip[1] - 10)
        raw = np.stack([address, t % 2**32], 1).astype(">u4").view(np.uint8).ravel()
        # a first word in the first wrap needs no time before it
        known = last >= 2**31 or n == 0 or t[0] < last
        state, columns = (
            clock_at(last if known else UNKNOWN, 100),
            [np.full(n + 3, -9, kind) for kind in (np.int64, np.int16, np.int16)],
        )
        columns.append(np.full(n + 3, 9, np.uint8))
        count, bad = aedat2_decode(raw, 4, layout, *chip, *size, state, 2, *columns)
        expected, first, time = slow(zip(address.tolist(), (t % 2**32).tolist(), strict=True), layout, chip, size, last)
        assert list(zip(*(column[2 : 2 + count].tolist() for column in columns), strict=True)) == expected
        assert bad == first
        assert state[[LAST, NEXT, MIXED]].tolist() == [time, 100 + n, count < n]
        assert state[FELL] == any(np.diff(t, prepend=last) < 0)
        assert columns[0][[0, 1, -1]].tolist() == [-9, -9, -9]


@pytest.mark.parametrize("layout", [DVS128, DAVIS], ids=["dvs128", "davis"])
def test_records_are_encoded_as_the_description_says(layout):
    chip = CHIPS[layout]
    x, y, p = np.array([0, 5, chip[0] - 1]), np.array([chip[1] - 1, 7, 0]), np.array([1, 0, 1], np.uint8)
    t = np.array([2**32 - 1, 2**32 + 5, 0x1_2345_6789])
    raw = aedat2_encode(t, x.astype(np.int16), y.astype(np.int16), p, layout, *chip)
    words = raw.view(">u4").astype(np.int64)
    assert words[:, 1].tolist() == (t % 2**32).tolist()
    places = [place_of(address, layout, chip) for address in words[:, 0].tolist()]
    assert places == list(zip(x.tolist(), y.tolist(), p.tolist(), [True] * 3, strict=True))
    assert raw.shape == (3, 8)


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
    many = packets_of(packet() * 40)
    assert [row[0] for row in many[0]] == [28 + 44 * k for k in range(40)]
    assert many[1:] == (FINE, 40 * 44)


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


def decoded(packets, size=(0, 0), kept=1, base=4):
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
        ((0, 0), (32_767, 32_767), True),
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
