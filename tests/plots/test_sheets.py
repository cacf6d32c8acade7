"""What is put together of pixels: words, pictures of events, and sheets of many of them."""

import numpy as np
import pytest

from nvsdata import Events, plots
from nvsdata.plots import charts, drawing, sheets
from nvsdata.plots.drawing import middle

INK = np.array(drawing.INK, np.uint8)


def ink(text, at, **how):
    """First and last column, and lowest row, of what is written on white."""
    picture = np.full((80, 300, 3), 255, np.uint8)
    drawing.put_text(picture, text, at, **how)
    rows, columns = np.nonzero((picture < 200).all(2))
    return int(columns.min()), int(columns.max()), int(rows.max())


@pytest.mark.parametrize("align", [0.0, 0.5, 1.0])
def test_words_stand_where_they_should(align):
    text = "IIIIIIII"
    width = drawing.text_width(text)
    first, last, low = ink(text, (150.4, 40.4), align=align)
    assert (first, last) == pytest.approx((150 - align * width, 150 + (1 - align) * width), abs=4)
    assert low == pytest.approx(40, abs=1)
    assert ink(text, (150.4, 40.4), align=align) == ink(text, (150, 40), align=align)


def test_words_have_a_size_and_a_color():
    picture = np.full((80, 300, 3), 255, np.uint8)
    drawing.put_text(picture, "III", (20, 40), size=2, color=(255, 0, 0))
    written = (picture != 255).any(2)
    assert (picture[written][:, 0] == 255).all()
    assert (picture[written][:, 1] == picture[written][:, 2]).all()
    assert drawing.text_width("III", 2) > 3 * drawing.text_width("III")
    assert (INK == 60).all()


@pytest.mark.parametrize("size", [0.4, 0.45, 1.0])
def test_no_more_is_cut_than_must_be(size):
    text = "a name that goes on and on"
    width = drawing.text_width(text, size)
    assert drawing.shortened(text, width, size) == text
    for room in (width - 1, width // 2, 30):
        kept = drawing.shortened(text, room, size).removesuffix("..")
        assert kept == text[: len(kept)]
        assert drawing.text_width(kept + "..", size) <= room < drawing.text_width(text[: len(kept) + 1] + "..", size)
    assert drawing.shortened(text, 0, size) == ".."
    assert drawing.shortened("", 0, size) == ""


def test_words_and_their_widths_are_of_one_size_by_default():
    text = "a name that goes on"
    assert drawing.text_width(text) == drawing.text_width(text, 0.45)
    assert drawing.shortened(text, drawing.text_width(text, 0.45)) == text
    assert drawing.shortened(text, drawing.text_width(text, 0.45) - 1) != text
    assert ink(text, (0, 40))[1] == pytest.approx(drawing.text_width(text), abs=3)


@pytest.mark.parametrize("duration", [100, 101, 1])
def test_the_middle_is_as_far_from_either_end(duration):
    t = np.arange(10, 1_011)
    events = Events(t, *[t * 0] * 3, (1, 1))
    found = middle(events, duration).t
    assert len(found) == duration
    assert abs((found[0] - 10) - (1_010 - found[-1])) <= 1
    assert np.array_equal(middle(events, 5_000).t, t)


def image(value, height=10, width=14):
    return np.full((height, width, 3), value, np.uint8)


def boxes(sheet, values):
    """(top, left, bottom, right) of each image of one value."""
    found = []
    for value in values:
        rows, columns = np.nonzero((sheet == value).all(2))
        found.append(tuple(map(int, (rows.min(), columns.min(), rows.max() + 1, columns.max() + 1))))
    return found


def test_images_of_a_contact_sheet_lie_at_even_distances():
    sheet = plots.contact_sheet([("a", [image(1), image(2), image(3)]), ("b", [image(4)])])
    assert sheet.shape == (8 + 2 * 18, 90 + 3 * 22, 3)
    assert boxes(sheet, (1, 2, 3, 4)) == [(8, 90, 18, 104), (8, 112, 18, 126), (8, 134, 18, 148), (26, 90, 36, 104)]
    other = plots.contact_sheet([("", [image(1)] * 2)], gap=3, margin=5)
    assert other.shape == (16, 39, 3)
    assert boxes(other, [1]) == [(3, 5, 13, 36)]
    # names on the left, in the middle of their rows
    tall = plots.contact_sheet([("I", [image(1, 60)]), ("I", [image(2, 60)])])
    rows = np.nonzero((tall[:, :90] < 200).any((1, 2)))[0]
    upper, lower = rows[rows < 72], rows[rows >= 72]
    assert (upper.min() + upper.max()) / 2 == pytest.approx(38, abs=2)
    assert np.array_equal(lower, upper + 68)
    assert (tall[0, 0] == 240).all()


def test_images_of_a_captioned_sheet_lie_in_squares():
    """Scaled up by whole numbers or down, in the middle of white squares 12 pixels apart, lines of text below."""
    tiles = [(image(1), ["a"]), (image(2, 20, 30), []), (image(3, 100, 50), ["a", "b"]), (image(4, 41, 20), [])]
    sheet = plots.captioned_sheet(tiles, columns=3, side=40)
    # two lines of 16 pixels
    tall, wide = 40 + 2 * 16 + 12 + 4, 52
    assert sheet.shape == (12 + 2 * tall, 12 + 3 * wide, 3)
    assert boxes(sheet, (1, 2, 3, 4)) == [
        (12 + 10, 12 + 6, 12 + 30, 12 + 34),  # 10 x 14, twice: 20 x 28
        (12 + 10, 12 + wide + 5, 12 + 30, 12 + wide + 35),
        (12, 12 + 2 * wide + 10, 52, 12 + 2 * wide + 30),
        (12 + tall, 12 + 10, 52 + tall, 12 + 30),  # 20 * 40 / 41 is 19.5
    ]
    white = (sheet[12:52, 12:52] == 255).all(2)
    assert white.sum() == 40 * 40 - 20 * 28
    assert (sheet[:12] == 240).all()
    assert (sheet[:, :12] == 240).all()
    one = plots.captioned_sheet([(image(1, 88, 88), ["a"])])
    assert one.shape == (12 + 176 + 16 + 12 + 4, 12 + 188, 3)
    assert boxes(one, [1]) == [(12, 12, 188, 188)]
    narrow = plots.captioned_sheet([(image(1), ["a"])] * 9, side=14, gap=1)
    assert narrow.shape == (1 + 2 * (14 + 16 + 1 + 4), 1 + 8 * 15, 3)


def test_thin_images_keep_a_pixel():
    for shape in ((1, 900), (900, 1)):
        sheet = plots.captioned_sheet([(image(1, *shape), [])], side=40)
        assert (sheet == 1).all(2).sum() == 40


def test_the_second_line_of_a_caption_is_red():
    sheet = plots.captioned_sheet([(image(1), ["III", "III", "III"])], side=40).astype(int)
    # letters end at their base lines, 16 pixels apart
    for n, color in enumerate((drawing.INK, drawing.ON, drawing.INK), 1):
        line = sheet[52 + 16 * n - 12 : 52 + 16 * n + 2, :52]
        dark = line[np.unravel_index(line.sum(2).argmin(), line.shape[:2])]
        assert abs(dark - color).max() < 60
        written = np.nonzero((line.min(2) < 200).any(1))[0]
        assert written.max() in (11, 12)
        assert np.nonzero((line.min(2) < 200).any(0))[0].min() in (12, 13, 14)


def test_words_of_a_caption_stay_below_their_image():
    sheet = plots.captioned_sheet([(image(1), ["W" * 50]), (image(1), [""])], side=60)
    columns = np.nonzero((sheet[72:] < 200).any((0, 2)))[0]
    assert 12 <= columns.min() < columns.max() < 12 + 60


def sampled(start, count, size=(34, 34)):
    """An event each ms."""
    t = start + np.arange(count) * 1_000
    return Events(t, *[t * 0] * 3, size)


@pytest.mark.parametrize(("width", "zoom"), [(34, 4), (80, 2), (81, 1), (160, 1), (640, 1)])
def test_recordings_side_by_side_show_the_same_moments(monkeypatch, width, zoom):
    seen = []
    monkeypatch.setattr(sheets, "event_image", lambda events, by: seen.append((events, by)))
    monkeypatch.setattr(sheets, "contact_sheet", lambda rows, margin: [(name, len(row)) for name, row in rows])
    a, b = sampled(5_000_000, 1_000, (width, 30)), sampled(70_000, 900, (width, 30))
    assert sheets.side_by_side(a, b, 50, 20_000) == [("A", 6), ("B", 6)]
    assert {by for _, by in seen} == {zoom}
    # six windows of 20 ms, from the first to that which ends with the last event
    starts = np.linspace(0, 999_000 - 20_000, 6).astype(int)
    for n, at in enumerate(starts.tolist()):
        (first, _), (second, _) = seen[n], seen[6 + n]
        for found, events, begin in ((first, a, 5_000_000 + at), (second, b, 50_000 + at)):
            expected = events.t[(events.t >= begin) & (events.t < begin + 20_000)]
            assert np.array_equal(found.t, expected)
    # of b, moved by 20 ms, nothing yet
    assert len(seen[6][0]) == 0
    seen.clear()
    sheets.side_by_side(a, b, 0.5)
    assert [len(events) for events, _ in seen] == [1_000] * 6 + [900] * 6


def test_recordings_side_by_side_are_a_picture():
    picture = sheets.side_by_side(sampled(0, 100), sampled(0, 100), 30)
    # sensors of 136 pixels, 8 apart, and 24 for the names
    assert picture.shape == (8 + 2 * 144, 24 + 6 * 144, 3)


def test_a_curve_of_scores_has_the_best_so_far(monkeypatch):
    seen = {}
    monkeypatch.setattr(charts, "curves", lambda lines, *_, highest: seen.update(lines, highest=highest))
    charts.score_curve(np.array([3.0, np.inf, 1.0, 2.0]))
    assert seen == {"each trial": [3, 3, 1, 2], "best so far": [3, 3, 1, 1], "highest": 3}
