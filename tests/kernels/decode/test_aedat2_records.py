"""Records of AEDAT 2 against a slow decoder."""

import numpy as np
import pytest

from nvsdata.kernels.decode.aedat2 import DAVIS, DVS128, aedat2_decode, aedat2_encode
from nvsdata.kernels.decode.clock import FELL, LAST, MIXED, NEXT, UNKNOWN, clock_at, nearest_time

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
        time = int(nearest_time(word, time, 32))
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
