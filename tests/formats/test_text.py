import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import FormatError
from nvsdata.formats import text


def read(tmp_path, content, **options):
    (tmp_path / "a.txt").write_text(content)
    return nvsdata.read(tmp_path / "a.txt", **options)


@given(events(max_size=60), st.integers(1 - 2**62, 2**62 - 200_000))
def test_times_up_to_2_to_the_62_go_round(tmp_path, ev, first):
    late = nvsdata.Events(ev.t + first, ev.x, ev.y, ev.p, ev.sensor_size)
    nvsdata.write(late, tmp_path / "a.txt")
    assert nvsdata.read(tmp_path / "a.txt") == late


def test_x_y_t_p_without_header(tmp_path):
    ev = read(tmp_path, "3 4 100 1\n5 6 90 0\n")
    assert (ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), ev.p.tolist()) == ([90, 100], [5, 3], [6, 4], [0, 1])


def test_seconds_are_read_exactly(tmp_path):
    ev = read(tmp_path, "240 180\n1605537493.718345 154 100 0\n1605537494.308262 88 137 1\n")
    assert ev.t.tolist() == [1605537493718345, 1605537494308262]
    assert ev.sensor_size == (240, 180)
    assert read(tmp_path, "0.5 1 2 1\n").t.tolist() == [500_000]


def test_commas_tabs_comments_and_blank_lines(tmp_path):
    assert read(tmp_path, "# hello\n\n1,2,3,1\r\n4\t5\t6\t-1\r\n").p.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("text", "reason", "offset"),
    [
        ("1 2 3 1\n1 2 3\n", "four numbers", 8),
        ("1 2 3 1\n1 2 3 1 5\n", "four numbers", 8),
        ("1 2 3 1\n1 x 3 1\n", "not a number", 10),
        ("1 2 3 1\n1 2.5 3 1\n", "not a number", 12),
        ("1 2 3 1\n-1 2 3 1\n", "coordinates", 8),
        ("1 2 3 1\n1 2 3 7\n", "polarity", 8),
        ("1 2 3 1\n1 2 99999999999999999999 1\n", "not a number", 30),
    ],
)
def test_bad_lines_name_the_byte(tmp_path, text, reason, offset):
    with pytest.raises(FormatError, match=reason) as caught:
        read(tmp_path, text)
    assert abs(caught.value.offset - offset) <= 3


@pytest.mark.parametrize(
    ("head", "seems"),
    [
        ("1 2", True),
        ("  1 \t2  \r\n", True),
        ("1 2 3", False),
        ("1 2 3 1\nwhat", True),
        ("-1.5,2.,3\t.5\n", True),
        ("1 2 3 1 5\n", False),
        ("1\n2\n", False),
        ("1", False),
        ("x 2", False),
        ("1 2 3 y", False),
        ("# what\n\n  \n1 2 3 1\n", True),
        ("# 1 2 3 1\n", False),
        ("", False),
    ],
)
def test_a_first_line_of_two_or_four_numbers_seems_to_be_text(head, seems):
    assert text.looks_like(head.encode(), len(head)) is seems


def test_the_first_line_that_is_no_comment_tells_seconds(tmp_path):
    assert read(tmp_path, "# 1\n\n# 2\n0.5 1 2 1\n").t.tolist() == [500_000]
    assert read(tmp_path, "  -2.5 1 2 1\n\t0.5 1 2 1").t.tolist() == [-2_500_000, 500_000]


@pytest.mark.parametrize("times", [(5, 4), (5, 9, 9, 7, 8), (1, 2, 3, 4, 0)])
def test_an_event_out_of_order_is_numbered(tmp_path, times):
    first = next(i for i in range(1, len(times)) if times[i] < times[i - 1])
    with pytest.raises(FormatError, match=f"event {first} is earlier than the one before it"):
        read(tmp_path, OWN + "".join(f"1 2 {time} 1\n" for time in times))


def test_a_window_of_a_long_file_parses_only_its_part(tmp_path, monkeypatch):
    n = 60_000
    ev = nvsdata.Events(np.arange(n) * 10, np.arange(n) % 34, np.arange(n) % 30, np.arange(n) % 2, (34, 34))
    nvsdata.write(ev, tmp_path / "a.txt")
    parsed = []
    original = text.TextRecording._parse

    def counted(self, start, stop):
        parsed.append(stop - start)
        return original(self, start, stop)

    monkeypatch.setattr(text.TextRecording, "_parse", counted)
    for start in (0, 123_456, 599_000, 599_990, 700_000):
        parsed.clear()
        assert nvsdata.read(tmp_path / "a.txt", start, start + 1_000) == ev.window(start, start + 1_000)
        assert sum(parsed) < 60_000 < (tmp_path / "a.txt").stat().st_size


@pytest.mark.parametrize("size", ["0 5", "5 0", "99999 5", f"{'9' * 5_000} 5"])
@pytest.mark.parametrize("header", ["{}\n", "# nvsdata events: x y t p, sorted, sensor {}\n"])
def test_sizes_in_headers_are_checked(tmp_path, header, size):
    size = size if "#" not in header else size.replace(" ", "x")
    for strict in (True, False):
        with pytest.raises(FormatError, match=r"a\.txt: byte 0: "):
            read(tmp_path, header.format(size) + "1 2 3 1\n", strict=strict)
    assert len(read(tmp_path, "# nvsdata events: x y t p, sorted, sensor 5x5\n1 2 3 1\n")) == 1


@pytest.mark.parametrize("time", [2**62, -(2**62), 2**63 - 1, -(2**63), 2**63, 2**64 - 1])
def test_times_from_2_to_the_62_are_refused(tmp_path, time):
    with pytest.raises(FormatError, match=r"byte \d+: (a time at or beyond 2\^62 µs|not a number)"):
        read(tmp_path, f"1 2 3 1\n1 2 {time} 1\n")
    assert read(tmp_path, f"1 2 3 1\n1 2 {time} 1\n", strict=False).t.tolist() == [3]


OWN = "# nvsdata events: x y t p, sorted, sensor 34x34\n"
LINES = [f"{i % 34} {i % 30} {1_000 + 10 * i} {i % 2}" for i in range(6_000)]


def damaged(kind, at):
    lines = list(LINES)
    if kind == "comments":
        lines[at:at] = ["# " + "a" * 40_000, "", "# b"]
    elif kind == "swapped":
        lines[at : at + 500] = lines[at : at + 500][::-1]
    elif kind == "no event":
        lines[at] = "1 2 three 1"
    else:
        lines[at] = f"1 2 {kind} 1"
    return lines


@pytest.mark.parametrize("kind", ["comments", "swapped", "no event", 0, 45_678, 2**40, 2**62])
@pytest.mark.parametrize("at", [0, 1, 2_900, 2_999, 3_000, 5_500])
def test_damaged_files_of_ours_never_give_wrong_windows(tmp_path, kind, at):
    (tmp_path / "a.txt").write_text(OWN + "\n".join(damaged(kind, at)) + "\n")
    windows = [(a, a + 3_000) for a in range(0, 64_000, 2_900)]
    repaired = nvsdata.open(tmp_path / "a.txt", strict=False)
    whole = nvsdata.open(tmp_path / "a.txt", strict=False).read()
    assert [repaired.read(*window) for window in windows] == [whole.window(*window) for window in windows]
    if kind == "comments" or (kind == 0 and at == 0):
        assert repaired.repairs == {}
        strict = nvsdata.open(tmp_path / "a.txt")
        assert [strict.read(*window) for window in windows] == [whole.window(*window) for window in windows]
    else:
        assert repaired.repairs
        with pytest.raises(FormatError, match=r"earlier than the one before it|not a number|beyond 2\^62"):
            nvsdata.open(tmp_path / "a.txt").read()


def test_a_file_that_is_cut_or_replaced_after_it_was_opened_is_refused(tmp_path):
    (tmp_path / "a.txt").write_text(OWN + "\n".join(LINES) + "\n")
    opened, read_before = nvsdata.open(tmp_path / "a.txt"), nvsdata.open(tmp_path / "a.txt")
    whole, window = read_before.read(), read_before.read(2_000, 3_000)
    os.truncate(tmp_path / "a.txt", 70_000)
    for recording in (opened, read_before):
        for what in ((), (55_000, 56_000)):
            with pytest.raises(FormatError, match="truncated: it had"):
                recording.read(*what)
    assert (len(whole), window) == (6_000, whole.window(2_000, 3_000))
    (tmp_path / "a.txt").write_text(OWN + "\n".join(LINES).replace("1", "2") + "\n")
    with pytest.raises(FormatError, match="changed after it was opened"):
        opened.read()


@pytest.mark.parametrize("strict", [True, False])
def test_pieces_of_a_long_file_are_counted_together(tmp_path, monkeypatch, strict):
    lines = list(LINES)
    for at in (5, 3_000, 5_000):
        lines[at] = "no event" if at != 3_000 else "40 2 31000 1"
    (tmp_path / "a.txt").write_text(OWN + "\n".join(LINES if strict else lines))
    whole = nvsdata.open(tmp_path / "a.txt", strict=strict)
    expected = whole.read()
    monkeypatch.setattr(text, "PIECE", 1_000)
    parts = nvsdata.open(tmp_path / "a.txt", strict=strict)
    assert parts.read() == expected
    assert len(expected) == (6_000 if strict else 5_997)
    counted = {"lines that aren't events, dropped": 2, "events outside the sensor, dropped": 1}
    assert parts.repairs == whole.repairs == ({} if strict else counted)


ALIGNED = [f"{i % 10} 0 {i:012d} 1" for i in range(3_000)]  # lines of 19 bytes, their ends included


@pytest.mark.parametrize("chunk", [1, 18, 19, 20, 500, 1 << 14])
@pytest.mark.parametrize("ending", ["\n", ""])
def test_windows_whatever_is_bisected(tmp_path, monkeypatch, chunk, ending):
    monkeypatch.setattr(text, "CHUNK", chunk)
    monkeypatch.setattr(text, "LINE", 24)
    (tmp_path / "a.txt").write_text(OWN + "\n".join(ALIGNED) + ending)
    recording = nvsdata.open(tmp_path / "a.txt")
    whole = nvsdata.open(tmp_path / "a.txt").read()
    assert whole.t.tolist() == [*range(3_000)]
    for start, stop in (
        (0, 1),
        (0, 0),
        (-9, 2),
        (5, 6),
        (1_499, 1_502),
        (2_998, 2_999),
        (2_999, 3_000),
        (3_000, 3_005),
    ):
        assert recording.read(start, stop) == whole.window(start, stop)
    assert recording.read(2_990) == whole.window(2_990)
    assert recording.read(None, 4) == whole.window(None, 4)


def test_the_line_from_any_byte(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "LINE", 3)
    content = OWN.encode() + b"1 2 3 1\n\n4 5 600000000000000 1\n7 8 9"
    (tmp_path / "a.txt").write_bytes(content)
    recording = nvsdata.open(tmp_path / "a.txt")
    starts = [0] + [at + 1 for at, byte in enumerate(content) if byte == 10]
    for at in range(1, len(content) + 3):
        begin = next((start for start in starts if start >= at), len(content))
        line = content[begin:].splitlines(keepends=True)[0] if begin < len(content) else b""
        assert recording._line_from(at) == (begin, line)


def test_many_lines_are_written_and_read_in_pieces(tmp_path, monkeypatch):
    count = (1 << 16) + 3
    ev = nvsdata.Events(np.arange(count), np.arange(count) % 34, np.arange(count) % 30, np.arange(count) % 2, (34, 34))
    nvsdata.write(ev, tmp_path / "a.txt")
    lines = (tmp_path / "a.txt").read_bytes().splitlines()
    assert len(lines) == 2 + count
    assert [lines[2], lines[-1]] == [
        b"0 0 0 0",
        f"{(count - 1) % 34} {(count - 1) % 30} {count - 1} {(count - 1) % 2}".encode(),
    ]
    monkeypatch.setattr(text, "PIECE", 100_000)
    assert nvsdata.read(tmp_path / "a.txt") == ev


def test_bad_lines_of_a_later_piece_name_the_byte(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "PIECE", 40)
    content = "1 2 3 1\n" * 20
    with pytest.raises(FormatError, match="a line must have four numbers") as caught:
        read(tmp_path, content + "1 2 3\n" + content)
    assert len(content) <= caught.value.offset <= len(content) + 6


def test_times_that_fall_near_a_window_are_told(tmp_path):
    content = OWN + "".join(f"1 2 {time} 1\n" for time in (0, 1, 2, 3, 5, 4, 6, 7))
    for start, stop in ((1, 3), (4, 6), (6, 8)):
        with pytest.raises(FormatError, match="event 5 is earlier than the one before it"):
            read(tmp_path, content, start=start, stop=stop)


@pytest.mark.parametrize("strict", [True, False])
def test_a_header_without_events(tmp_path, strict):
    (tmp_path / "a.txt").write_text(OWN)
    recording = nvsdata.open(tmp_path / "a.txt", strict=strict)
    assert (len(recording.read()), len(recording.read(0, 9)), recording.span) == (0, 0, (0, 0))
    assert recording.repairs == {}


def lines_of(ev, order, separator=","):
    """The events as lines of numbers."""
    columns = {"t": ev.t.tolist(), "x": ev.x.tolist(), "y": ev.y.tolist(), "p": ev.p.tolist()}
    return "".join(
        separator.join(map(str, line)) + "\n" for line in zip(*(columns[name] for name in order), strict=True)
    )


@pytest.mark.parametrize("order", ["xytp", "txyp", "xypt"])
@pytest.mark.parametrize("separator", [" ", ",", ";", "\t"])
@pytest.mark.parametrize("first", [0, 3_000_000])
def test_orders_without_a_header(tmp_path, ev, order, separator, first):
    ev = nvsdata.Events(ev.t + first, ev.x, ev.y, ev.p, ev.sensor_size)
    assert len(ev) > 64
    assert read(tmp_path, lines_of(ev, order, separator), sensor_size=ev.sensor_size) == ev
    # some damaged lines, and some events out of order
    lines = lines_of(ev, order, separator).splitlines()
    lines[3], lines[20], lines[30], lines[31] = "nothing", "-1,-1,-1,-1", lines[31], lines[30]
    found = read(tmp_path, "\n".join(lines), sensor_size=ev.sensor_size, strict=False)
    kept = [n for n in range(len(ev)) if n not in (3, 20)]
    assert found == nvsdata.Events(ev.t[kept], ev.x[kept], ev.y[kept], ev.p[kept], ev.sensor_size)


def test_a_file_that_is_not_sorted_is_x_y_t_p_if_it_can_be(tmp_path, ev):
    mixed = np.random.default_rng(0).permutation(len(ev))
    shuffled = ev.to_structured()[mixed]
    lines = "".join(f"{e['x']} {e['y']} {e['t']} {e['p']}\n" for e in shuffled)
    assert read(tmp_path, lines, sensor_size=ev.sensor_size).t.tolist() == ev.t.tolist()
    lines = "".join(f"{e['x']},{e['y']},{e['p']},{e['t'] + 2}\n" for e in shuffled)
    assert read(tmp_path, lines, sensor_size=ev.sensor_size).t.tolist() == (ev.t + 2).tolist()


@pytest.mark.parametrize(
    ("header", "order", "seconds"),
    [
        ("x,y,polarity,timestamp", "xypt", False),
        ("timestamp,x,y,polarity", "txyp", False),
        ("t x y p", "txyp", False),
        ('"Time","Y","X","Pol"', "tyxp", False),
        ("timestamp_us;x;y;p", "txyp", False),
        ("ts[us],p,y,x", "tpyx", False),
        ("x\ty\tp\tt_s", "xypt", True),
        ("event_timestamp,x,y,polarity", "txyp", True),
        ("\ufeffx,y,p,t", "xypt", False),
    ],
)
def test_names_of_columns(tmp_path, header, order, seconds):
    event = {"t": "1.500001" if seconds else "1500001", "x": "3", "y": "4", "p": "1"}
    line = ",".join(event[name] for name in order)
    content = f"# a comment\n% another\n{header}\n{line}\n{line}\n"
    content = content.replace("# a comment\n% another\n", "") if header.startswith("\ufeff") else content
    found = read(tmp_path, content)
    columns = [column.tolist() for column in found.columns]
    assert columns == [[1_500_001] * 2, [3, 3], [4, 4], [1, 1]]
    assert text.looks_like(content.encode(), len(content))


def test_metavisions_csv(tmp_path, ev):
    """As metavision_file_to_csv writes it."""
    width, height = ev.sensor_size
    content = f"%geometry:{width},{height}\n{lines_of(ev, 'xypt')}"
    (tmp_path / "a.csv").write_text(content)
    recording = nvsdata.open(tmp_path / "a.csv")
    assert not recording.size_is_guessed
    assert recording.read() == ev
    (tmp_path / "a.csv").write_text(content.replace(f"{width},{height}", f"{width};{height}", 1))
    assert nvsdata.open(tmp_path / "a.csv").size_is_guessed


@pytest.mark.parametrize(
    "header", ["x,y,t", "x,y,t,t", "x,y,t,q", "x,y,t,p,label", "frame,x,y,p", "t_ms,x,y,p", "Timestamp (us),x,y,p"]
)
@pytest.mark.parametrize("strict", [True, False])
def test_other_names_are_refused(tmp_path, header, strict):
    content = f"{header}\n1,2,3,1\n"
    assert not text.looks_like(content.encode(), len(content))
    with pytest.raises(FormatError, match="a line of names must have x, y, t and p"):
        read(tmp_path, content, strict=strict)


def random_events(n=300, first=0, gap=50, size=(640, 480), seed=1):
    rng = np.random.default_rng(seed)
    t = first + np.cumsum(rng.integers(0, gap, n))
    return t, rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n)


def pixel_by_pixel(n, last, side=34):
    """Events in the order of x, y and t, whose times are possible coordinates."""
    rng = np.random.default_rng(2)
    x, y, t = np.sort(rng.integers(0, side, n)), rng.integers(0, side, n), rng.integers(0, last, n)
    at = np.lexsort((t, y, x))
    return t[at], x[at], y[at], rng.integers(0, 2, n)


def rows_of_frames(frames=30, each=100, side=128):
    """Events of frames at 1 kHz, row by row."""
    rng = np.random.default_rng(3)
    place = np.concatenate([np.sort(rng.choice(side * side, each, False)) for _ in range(frames)])
    return np.repeat(np.arange(frames) * 1_000, each), place % side, place // side, rng.integers(0, 2, place.size)


T, X, Y, P = random_events()
LATER = T + 5_000_000
SHUFFLED = np.random.default_rng(4).permutation(T.size)
ONE = np.ones(300, int)
SLIGHTLY = np.array([*range(50), 51, 50, *range(52, 300)])
# what is read rightly without names: order, and columns t, x, y, p
UNNAMED = {
    "x y t p": ("xytp", (T, X, Y, P)),
    "x y t p, mixed": ("xytp", (T[SHUFFLED], X[SHUFFLED], Y[SHUFFLED], P[SHUFFLED])),
    "x y t p, pixel by pixel": ("xytp", pixel_by_pixel(2_000, 30_000)),
    "x y t p, an event per pixel": ("xytp", pixel_by_pixel(1_156, 20_000)),
    "x y t p, of a pixel, two swapped": ("xytp", (T[SLIGHTLY], 7 * ONE, 9 * ONE, P[SLIGHTLY])),
    "x y t p, ON only, at 0 and 1 µs": ("xytp", (P, X, Y, ONE)),
    "x y t p, by frames": ("xytp", rows_of_frames()),
    "x y t p, rising x": ("xytp", (T, np.sort(X), Y, P)),
    "x y t p, few": ("xytp", (T[:5], X[:5], Y[:5], P[:5])),
    "t x y p": ("txyp", (T, X, Y, P)),
    "t x y p, 16": ("txyp", (T[:16], X[:16], Y[:16], P[:16])),
    "t x y p, rising x": ("txyp", (T, np.sort(X), Y, P)),
    "t x y p, later": ("txyp", (LATER, X, Y, P)),
    "t x y p, later, one": ("txyp", (LATER[:1], X[:1], Y[:1], P[:1])),
    "t x y p, later, mixed": ("txyp", (LATER[SHUFFLED], X[SHUFFLED], Y[SHUFFLED], P[SHUFFLED])),
    "t x y p, later, rising y": ("txyp", (LATER, X, np.sort(Y), P)),
    "x y p t": ("xypt", (T + 2, X, Y, P)),
    "x y p t, one": ("xypt", (LATER[:1], X[:1], Y[:1], P[:1])),
    "x y p t, mixed": ("xypt", (T[SHUFFLED] + 2, X[SHUFFLED], Y[SHUFFLED], P[SHUFFLED])),
    "x y p t, 70 at once": ("xypt", (np.r_[0 * T[:70], T[70:]], X, Y, np.r_[ONE[:70], P[70:]])),
    "x y p t, by frames": ("xypt", rows_of_frames()),
}


@pytest.mark.parametrize("name", UNNAMED)
@pytest.mark.parametrize("separator", [" ", ";"])
def test_lines_without_names(tmp_path, name, separator):
    order, columns = UNNAMED[name]
    found = read(tmp_path, as_lines(columns, order, separator), sensor_size=(640, 480))
    assert rows(found.columns) == rows(columns)


@pytest.mark.parametrize("order", ["xytp", "txyp", "xypt"])
@pytest.mark.parametrize("first", [0, 1_600_000_000_000_000])
def test_times_with_decimals_are_seconds(tmp_path, order, first):
    t = np.arange(0, 60, 2) + first
    seconds = [f"{value // 10**6}.{value % 10**6:06}" for value in t.tolist()]
    columns = t, X[: t.size], Y[: t.size], P[: t.size]
    shown = [seconds, *columns[1:]]
    assert rows(read(tmp_path, as_lines(shown, order)).columns) == rows(columns)
    # a whole first time says nothing
    shown[0] = ["0", *seconds[1:]] if not first else seconds
    assert rows(read(tmp_path, as_lines(shown, order)).columns) == rows(columns)
    # named by a comment, as NumPy writes it
    assert rows(read(tmp_path, f"# {' '.join(order)}\n{as_lines(shown, order)}").columns) == rows(columns)


@pytest.mark.parametrize("order", ["xytp", "xypt", "txyp"])
@pytest.mark.parametrize("named", [True, False])
def test_decimals_that_are_zero_say_nothing(tmp_path, order, named):
    """As pandas writes columns of floats."""
    if order == "txyp" and not named:
        return  # without names, a decimal point in the first number stands for seconds
    columns = LATER, X, Y, P
    shown = [[f"{value}.0" for value in LATER], X, Y, P]
    header = ",".join(order) + "\n" if named else ""
    assert rows(read(tmp_path, header + as_lines(shown, order)).columns) == rows(columns)


def as_lines(columns, order, separator=","):
    fields = dict(zip("txyp", (list(map(str, column)) for column in columns), strict=True))
    lines = zip(*(fields[name] for name in order), strict=True)
    return "".join(separator.join(line) + separator.strip() + "\n" for line in lines)


def rows(columns):
    """Events in the order of time, and of lines."""
    return sorted(zip(*(np.asarray(column).tolist() for column in columns), strict=True), key=lambda event: event[0])


@pytest.mark.parametrize("line", ["0.001 3", "0.001 3 x 1", "0.001 3 4 1 5"])
def test_a_damaged_first_line_changes_nothing(tmp_path, line):
    content = f"{line}\n0.001 3 4 1\n0.002 5 6 0\n"
    assert read(tmp_path, content, strict=False).t.tolist() == [1_000, 2_000]
    content = "nothing\n" + as_lines((LATER, X, Y, P), "xypt")
    assert len(read(tmp_path, content, strict=False)) == 300


def test_a_line_that_the_head_cuts_says_nothing(tmp_path):
    for cut in range(12):
        comment = "#" + "a" * (65_534 - 6 - cut) + "\n"
        content = comment + "".join(f"{100 + i} 20 {i} 1\n" for i in range(500))
        assert read(tmp_path, content).t.tolist() == list(range(500))


def test_long_words_are_no_names(tmp_path):
    with pytest.raises(FormatError, match="not a number"):
        read(tmp_path, "_" * 60_000)


def test_the_guess_is_named_in_errors(tmp_path):
    with pytest.raises(FormatError, match=r"taken as t x y p; a first line such as t,x,y,p names them"):
        read(tmp_path, as_lines((LATER, X, Y, P), "txyp") + "1 2 3\n")
    with pytest.raises(FormatError, match=r"four numbers$"):
        read(tmp_path, "x,y,p,t\n1,2,3\n")
