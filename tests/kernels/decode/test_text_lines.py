"""Lines of numbers, at exactly the bounds of what is one."""

from itertools import permutations

import numpy as np
import pytest

from nvsdata.data.events import Columns
from nvsdata.kernels.decode.text import BAD_COUNT, BAD_NUMBER, OK, OUT_OF_RANGE, TOO_LATE, text_decode

LATEST = 2**62 - 1


def decoded(text, order="xytp", seconds=False, skip=False):
    """What is decoded of a text: events, fault, byte of the fault, lines dropped."""
    raw = np.frombuffer(text.encode(), np.uint8)
    columns = Columns.empty(9)
    kept, fault, at, dropped = text_decode(raw, order, seconds, skip, *columns)
    return [list(event) for event in zip(*(c[:kept].tolist() for c in columns), strict=True)], fault, at, dropped


def test_faults_are_told_apart():
    assert len({OK, BAD_NUMBER, BAD_COUNT, OUT_OF_RANGE, TOO_LATE}) == 5


@pytest.mark.parametrize("end", ["", "\n", "\r\n", " ", ".0\n", ".000,"])
@pytest.mark.parametrize(
    ("numbers", "event"),
    [
        ("0 0 0 0", [0, 0, 0, 0]),
        ("32766 32765 5 1", [5, 32766, 32765, 1]),
        ("5\t32766,19 -1", [19, 5, 32766, 0]),
        ("1;2;;3 ;1", [3, 1, 2, 1]),
        (f"1 2 {LATEST} 1", [LATEST, 1, 2, 1]),
        (f" 1,, 2 {-LATEST} 0", [-LATEST, 1, 2, 0]),
        ("1 2 00000000000000000000003 1", [3, 1, 2, 1]),
        ("1.0 2.00 3. 1", [3, 1, 2, 1]),
    ],
)
def test_lines_of_whole_numbers(numbers, event, end):
    assert decoded(numbers + end) == ([event], OK, 0, 0)
    both = decoded(f"{numbers}{end}\n# 1 2 3\n\n \r\n8 9 4 1")
    assert both == ([event, [4, 8, 9, 1]], OK, 0, 0)


@pytest.mark.parametrize(
    ("line", "fault", "at"),
    [
        ("32767 2 3 1", OUT_OF_RANGE, 0),
        ("1 32767 3 1", OUT_OF_RANGE, 0),
        ("-1 2 3 1", OUT_OF_RANGE, 0),
        ("1 -1 3 1", OUT_OF_RANGE, 0),
        ("1 2 3 2", OUT_OF_RANGE, 0),
        ("1 2 3 -2", OUT_OF_RANGE, 0),
        (f"1 2 {2**62} 1", TOO_LATE, 0),
        (f"1 2 {-(2**62)} 1", TOO_LATE, 0),
        ("1 2 9223372036854775808 1", BAD_NUMBER, 22),
        ("1 2 92233720368547758070 1", BAD_NUMBER, 22),
        ("1", BAD_COUNT, 0),
        ("1 2 3", BAD_COUNT, 0),
        ("1 2 3 1 1", BAD_COUNT, 0),
        ("1 2 3 1 15 6 7 8", BAD_COUNT, 0),
        ("1 2 3 1.1", BAD_NUMBER, 8),
        ("1 2 3 1.05", BAD_NUMBER, 9),
        ("1 2 3 -", BAD_NUMBER, 7),
        ("1 2 3 --1", BAD_NUMBER, 7),
        ("1 2 3 1x", BAD_NUMBER, 7),
        ("1 2 : 1", BAD_NUMBER, 4),
        ("1 2 / 1", BAD_NUMBER, 4),
        ("1 2 3|1", BAD_NUMBER, 5),
        ("1 2 3\b1", BAD_NUMBER, 5),
        ("# 1\n1 #", BAD_NUMBER, 6),
    ],
)
def test_the_first_fault_is_told_and_others_are_dropped(line, fault, at):
    assert decoded(f"4 5 6 1\n{line}\n7 8 9 0\n") == ([[6, 4, 5, 1]], fault, 8 + at, 0)
    assert decoded(line)[1:] == (fault, at, 0)
    faults = f"4 5 6 1\n{line}\n7 8 9 0\n{line}\n"
    assert decoded(faults, skip=True) == ([[6, 4, 5, 1], [9, 7, 8, 0]], OK, 0, 2)


@pytest.mark.parametrize(
    ("seconds", "time"),
    [
        ("0", 0),
        ("1", 1_000_000),
        ("1.", 1_000_000),
        ("1.5", 1_500_000),
        ("-0.000001", -1),
        ("0.0000019", 1),
        ("12.345678901", 12_345_678),
        (f"{LATEST // 10**6}.{LATEST % 10**6:06}", LATEST),
        ("9223372036853.999999", "a time too late"),
        ("9223372036854", "a number too large"),
        ("99223372036853.1", "a number too large"),
        ("1.2.3", "no number"),
        ("1.2x", "no number"),
    ],
)
def test_seconds_are_read_to_the_microsecond(seconds, time):
    events, fault, _, _ = decoded(f"{seconds} 3 4 1", order="txyp", seconds=True)
    if isinstance(time, str):
        assert (events, fault) == ([], TOO_LATE if "late" in time else BAD_NUMBER)
    else:
        assert (events, fault) == ([[time, 3, 4, 1]], OK)
    assert decoded("1.5 3.5 4 1", order="txyp", seconds=True)[1] == BAD_NUMBER


@pytest.mark.parametrize("order", ["".join(order) for order in permutations("txyp")])
@pytest.mark.parametrize("seconds", [False, True])
def test_any_order_of_the_numbers(order, seconds):
    event = {"t": "1.5" if seconds else "7", "x": "3", "y": "4", "p": "-1"}
    line = ";".join(event[name] for name in order)
    assert decoded(f"% {line}\n{line}\n# {line}\n", order, seconds) == (
        [[1_500_000 if seconds else 7, 3, 4, 0]],
        OK,
        0,
        0,
    )
    for name in "xyp":
        wrong = " ".join("1.5" if name == one else event[one] for one in order)
        assert decoded(wrong, order, seconds)[1] == BAD_NUMBER
