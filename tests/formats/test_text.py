import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import FormatError


def read(tmp_path, text, **options):
    (tmp_path / "a.txt").write_text(text)
    return nvsdata.read(tmp_path / "a.txt", **options)


@given(events(max_size=60), st.integers(-(2**62), 2**62 - 200_000))
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


def test_a_window_of_a_long_file_parses_only_its_part(tmp_path, monkeypatch):
    from nvsdata.formats import text

    n = 60_000
    ev = nvsdata.Events(np.arange(n) * 10, np.arange(n) % 34, np.arange(n) % 30, np.arange(n) % 2, (34, 34))
    nvsdata.write(ev, tmp_path / "a.txt")
    parsed = []
    original = text.Recording._parse

    def counted(self, start, stop):
        parsed.append(stop - start)
        return original(self, start, stop)

    monkeypatch.setattr(text.Recording, "_parse", counted)
    for start in (0, 123_456, 599_000, 599_990, 700_000):
        parsed.clear()
        assert nvsdata.read(tmp_path / "a.txt", start, start + 1_000) == ev.window(start, start + 1_000)
        assert sum(parsed) < 60_000 < (tmp_path / "a.txt").stat().st_size
