"""ECF, Prophesee's compression: chunks of its own encoder, of the tests' encoder, and damaged ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from metavision_files import EVENT, SEPARATE, TOGETHER, X_WITH_POLARITY, ecf_bytes

from nvsdata.kernels.decode.ecf import expand_ecf

# chunks by Prophesee's encoder (github.com/prophesee-ai/hdf5_ecf), with (x, y, p, t)
T = 1 << 40
TOGETHER_BY_PROPHESEE = (
    "1600000000000000000100000132fdf3fdf0f3020a0b1000f02f90000ff07f00000f00000000000000000000",
    [(5, 1, 1, T), (5, 9, 0, T + 3), (2040, 2, 0, T + 3), (7, 2047, 1, T + 200_000), (7, 0, 1, T + 200_000)],
)
X_WITH_POLARITY_BY_PROPHESEE = (
    "5100000007000000000000000f14005400370113000700370113000700370113000700370113000600260112000600",
    [((9, 3)[n % 2], 2, int(n < 15), 7) for n in range(20)],
)
SEPARATE_BY_PROPHESEE = (
    "8002000007000000000000000fa0005f0064007f003c0035000a01f501ca02b5038a0475054a0635070a08f508ca09b50a8a0b750c4a0d350e"
    "0a0ff50fca10b5118a1274130a00c6008a0149020a03ca03b5048a0575064a0735080a09f509ca0ab50b8a0c750d4a0e350f0a10f510ca11b5"
    "128813ff82001e",
    [(n % 80 * 2 + (n % 7 == 0), 2 + (n >= 100), int(n < 130), 7) for n in range(160)],
)


def events_of(raw, most=1 << 21):
    """Rows of x, y, p and t."""
    return expand_ecf(raw, most).view(EVENT).tolist()


@pytest.mark.parametrize("chunk", [TOGETHER_BY_PROPHESEE, X_WITH_POLARITY_BY_PROPHESEE, SEPARATE_BY_PROPHESEE])
def test_chunks_by_prophesees_encoder(chunk):
    raw, expected = bytes.fromhex(chunk[0]), chunk[1]
    assert events_of(raw) == expected
    # exactly as much room, one byte more, and too little
    assert len(expand_ecf(raw, 16 * len(expected))) == 16 * len(expected)
    assert len(expand_ecf(raw, 16 * len(expected) + 1)) == 16 * len(expected)
    assert len(expand_ecf(raw, 16 * len(expected) - 1)) == 16 * len(expected) - 1
    t, x, y, p = (np.array([row["xypt".index(name)] for row in expected]) for name in "txyp")
    assert ecf_bytes(t, x, y, p, raw[0] & 3) == raw
    for end in range(len(raw)):
        with pytest.raises(ValueError, match="damaged ECF data"):
            expand_ecf(raw[:end], 1 << 21)
    with pytest.raises(ValueError, match="damaged ECF data"):
        expand_ecf(raw + b"\0", 1 << 21)


# runs of the lengths at which the coding changes, and at which the kernel writes by other code
COUNTS = st.sampled_from([1, 2, 3, 4, 5, 8, 9, 14, 15, 16, 17, 30, 31, 126, 127, 128, 300])


@st.composite
def some_events(draw):
    """Columns t, x, y and p."""

    def column(values):
        parts = draw(st.lists(st.tuples(values, COUNTS), min_size=1, max_size=9))
        return np.concatenate([np.full(count, value) for value, count in parts])

    gaps = column(st.sampled_from([0, 0, 1, 14, 15, 16, 255, 10_000_000]))
    slopes = column(st.integers(0, 3))
    columns = gaps, slopes, column(st.integers(0, 2047)), column(st.integers(0, 1))
    count = min(map(len, columns))
    t, x, y, p = (one[:count] for one in columns)
    return draw(st.integers(0, 1 << 61)) + np.cumsum(t), np.cumsum(x) % 2048, y, p


@given(some_events(), st.sampled_from([SEPARATE, X_WITH_POLARITY, TOGETHER]))
def test_events_are_those_that_were_encoded(columns, coding):
    t, x, y, p = (column.tolist() for column in columns)
    assert events_of(ecf_bytes(*columns, coding)) == list(zip(x, y, p, t, strict=True))


def test_times_that_fall_are_raised_to_the_latest():
    """As Prophesee's encoder writes them: a difference of 0."""
    raw = bytearray.fromhex(TOGETHER_BY_PROPHESEE[0])
    raw[13] = 0x02
    assert [row[3] for row in events_of(bytes(raw))] == [T, T, T, T + 199_997, T + 199_997]


@pytest.mark.parametrize("head", [65_536 << 2, 0xFFFFFFFC])
def test_more_events_than_a_chunk_can_have_are_damage(head):
    with pytest.raises(ValueError, match="damaged ECF data"):
        expand_ecf(head.to_bytes(4, "little") + bytes(100), 1 << 21)


@given(some_events(), st.sampled_from([SEPARATE, X_WITH_POLARITY, TOGETHER]), st.data())
def test_changed_bytes_give_events_or_an_error(columns, coding, data):
    raw = bytearray(ecf_bytes(*columns, coding))
    for _ in range(data.draw(st.integers(1, 2))):
        raw[data.draw(st.integers(4, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        events = events_of(bytes(raw))
    except ValueError:
        return
    assert len(events) == len(columns[0])
    assert all(0 <= x < 2053 and 0 <= y < 2048 and p in (0, 1) for x, y, p, _ in events)
    # whatever is read is encoded as it was read; bits without a meaning may differ
    t = np.array([t for *_, t in events])
    if (np.diff(t) >= 0).all() and t[0] >= 0:
        x, y, p = (np.array([event[i] for event in events]) for i in range(3))
        if x.max() < 2048:
            assert events_of(ecf_bytes(t, x, y, p, coding)) == events
