"""What is drawn of classifiers: everything is there, within the picture, and nothing fails at odd sizes."""

import numpy as np
import pytest

from nvsdata import metrics, plots
from nvsdata.plots import drawing


def is_picture(picture):
    return picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3


@pytest.mark.parametrize("count", [1, 2, 10, 101, 300])
def test_confusion_shades_right_and_wrong(count):
    counts = np.diag(np.full(count, 3))
    counts[0, -1] += 1
    picture = plots.confusion(counts, [f"class {i}" for i in range(count)], "title")
    assert is_picture(picture)
    assert max(picture.shape) < 2000
    blue, red = picture[..., 0].astype(int) - picture[..., 2], picture[..., 2].astype(int) - picture[..., 0]
    assert (blue > 100).sum() > count
    # the legend alone has some
    none = plots.confusion(np.diag(np.full(count, 3)), [f"class {i}" for i in range(count)], "title")
    reds = (none[..., 2].astype(int) - none[..., 0] > 5).sum()
    assert ((red > 5).sum() > reds) == (count > 1)


def test_counts_are_written_into_their_cells():
    # other numbers of the same shares: only what is written differs, along the diagonal
    ones, tens = (plots.confusion(np.diag([4, 5, 6]) * scale, "abc", "title") for scale in (1, 10))
    rows, columns = np.nonzero((ones != tens).any(2))
    assert np.corrcoef(rows, columns)[0, 1] > 0.95
    for places in (rows, columns):
        assert 180 < np.ptp(places) < 250


def test_a_class_without_recordings_is_no_error():
    assert is_picture(plots.confusion(np.array([[0, 0], [1, 2]]), ["a", "b"], "title"))
    share = np.array([np.nan, 0.5])
    assert is_picture(plots.class_bars(["a", "b"], np.array([0, 2]), [("x", share), ("y", share)], "title"))


def test_bars_are_as_long_as_accuracies_and_worst_first():
    share = np.array([0.75, 0.25, 0.5])
    picture = plots.class_bars(["a", "b", "c"], np.array([4, 4, 4]), [("x", share)], "title")
    bar = (picture == drawing.OFF).all(2)[:-60]
    lengths = bar.sum(1)
    kept = [int(row) for row in lengths[np.r_[True, np.diff(lengths) != 0]] if row > 100]
    assert np.divide(kept, kept[2] / 0.75) == pytest.approx([0.25, 0.5, 0.75], abs=0.01)
    # the longest reaches three quarters of the way to 100%, where the figures begin a little later
    columns = np.nonzero(bar.any(0))[0]
    assert columns[-1] - columns[0] > 0.5 * picture.shape[1]


def test_no_more_than_120_bars():
    share = np.linspace(0, 1, 500)
    picture = plots.class_bars([str(i) for i in range(500)], np.ones(500, int), [("x", share)], "title")
    assert picture.shape[0] < 1800


def test_reliability_has_a_panel_for_each():
    bins = metrics.calibration([0.1, 0.6, 0.9, 0.9], [0, 1, 1, 0])
    one, two = plots.reliability([("a", bins)]), plots.reliability([("a", bins), ("b", bins)])
    assert two.shape[1] == 2 * one.shape[1]
    assert ((one == drawing.OFF).all(2).sum()) > 1000


def test_bars_of_confidence_stand_in_their_bins():
    def bars(confidence):
        bins = metrics.calibration([confidence] * 4, [1, 1, 1, 1], 10)
        columns = np.nonzero((plots.reliability([("a", bins)])[:380] == drawing.OFF).all(2).sum(0) > 150)[0]
        return columns.min(), columns.max()

    (first, _), (_, last) = bars(0.001), bars(0.999)
    wide = (last - first) / 10
    for n in range(10):
        left, right = bars(0.05 + 0.1 * n)
        assert (left - first) / wide == pytest.approx(n, abs=0.15)
        assert (right - left) / wide == pytest.approx(0.92, abs=0.1)


@pytest.mark.parametrize("values", [[0.5], [0.0, 1.0], [1.0, 1.0, 1.0], [0.3] * 40])
def test_marked_values_lie_within(values):
    picture = plots.points_chart(values, [str(i) for i in range(len(values))], "title", "x")
    rows, columns = np.nonzero((picture == drawing.OFF).all(2))
    assert len(rows) > 20
    assert 25 < rows.min() < rows.max() < 390
    assert 40 < columns.min() < columns.max() < 715


@pytest.mark.parametrize(("count", "written"), [(1, 1), (12, 12), (13, 7), (40, 10)])
def test_of_many_marked_values_some_are_written_from_the_first_on(count, written, monkeypatch):
    seen = []
    monkeypatch.setattr("matplotlib.axes.Axes.annotate", lambda axes, text, at, *more, **how: seen.append((text, at)))
    values = [0.5 + n / 100 for n in range(count)]
    plots.points_chart(values, [str(n) for n in range(count)], "title", "x")
    step = -(-count // 12)
    assert len(seen) == written
    assert seen == [(f"{values[n]:.3f}", (n, values[n])) for n in range(0, count, step)]


def test_a_captioned_sheet_shows_images_of_all_sizes_whole():
    tiles = [(np.full((h, w, 3), 7, np.uint8), ("true: a", "predicted: " + "long" * 20)) for h, w in SIZES]
    sheet = plots.captioned_sheet(tiles, columns=3, side=100)
    # each keeps its proportions
    wanted = sum((100 // max(h, w) or 100 / max(h, w)) ** 2 * h * w for h, w in SIZES)
    assert (sheet == 7).all(2).sum() == pytest.approx(wanted, rel=0.02)


SIZES = ((34, 34), (180, 240), (100, 50), (720, 1280))


def test_long_words_are_cut():
    assert drawing.shortened("short", 200) == "short"
    cut = drawing.shortened("a name that goes on and on", 60)
    assert cut.endswith("..")
    assert drawing.text_width(cut) <= 60
