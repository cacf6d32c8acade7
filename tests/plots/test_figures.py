"""What charts show, read from their figures: pixels of matplotlib take long, and tell little."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgb
from matplotlib.ticker import MaxNLocator

from nvsdata import plots
from nvsdata.plots import drawing
from nvsdata.plots.axes import CURVES, LINES, new_figure, rgb


@pytest.fixture
def figures(monkeypatch):
    """The figures of charts, in the order in which they are made."""
    made = []

    def keep(figure):
        made.append(figure)
        return np.zeros((1, 1, 3), np.uint8)

    for module in ("charts", "classification"):
        monkeypatch.setattr(f"nvsdata.plots.{module}.rendered", keep)
    return made


def pixels(figure):
    """(width, height)."""
    return tuple((figure.get_size_inches() * figure.dpi).round().astype(int).tolist())


def legend(figure):
    (found,) = figure.legends
    # in a row
    assert len({round(text.get_window_extent().y0) for text in found.get_texts()}) == 1
    return {text.get_text() for text in found.get_texts()}


def bars(axes):
    """(left, bottom, width, height) of each."""
    return np.array([(bar.get_x(), bar.get_y(), bar.get_width(), bar.get_height()) for bar in axes.patches])


def segments(axes):
    (lines,) = (thing for thing in axes.collections if isinstance(thing, LineCollection))
    return np.array(lines.get_segments())


def texts(axes):
    return [(*text.get_position(), text.get_text()) for text in axes.texts]


def test_colors_of_opencv_are_those_of_matplotlib():
    assert rgb((255, 51, 0)) == (0, 0.2, 1)
    assert LINES[:3] == [rgb(drawing.OFF), rgb(drawing.ON), rgb(drawing.BOTH)]
    assert len({tuple(color) for color in LINES}) == 5
    assert pixels(new_figure((301, 200))) == (301, 200)


def test_charts_have_their_words_and_two_axes(figures):
    plots.curves([("a", [0.5, 0.5])], "title", "epoch")
    (axes,) = figures[0].axes
    assert (axes.get_title("left"), axes.get_title(), axes.get_xlabel()) == ("title", "", "epoch")
    assert axes.title.get_text() == ""
    assert [side for side, spine in axes.spines.items() if spine.get_visible()] == ["left", "bottom"]
    assert axes.get_axisbelow() is True
    assert axes.xaxis.get_gridlines()[0].get_color() == rgb(drawing.FAINT)


def test_a_picture_has_the_pixels_asked_for():
    assert plots.curves([("a", [0.5, 0.5])], "title", "epoch").shape == (420, 720, 3)
    assert plots.curves([("a", [0.5, 0.5])], "title", "epoch", (300, 200)).shape == (200, 300, 3)


def test_curves_are_values_by_their_number(figures):
    given = [("a", [0.1, 0.2, 0.4]), ("b", [0.5]), *((name, [0.3, 0.3]) for name in "cdef")]
    plots.curves(given, "", "")
    (axes,) = figures[0].axes
    assert [line.get_xdata().tolist() for line in axes.lines[:3]] == [[1, 2, 3], [1], [1, 2]]
    assert [list(line.get_ydata()) for line in axes.lines[:2]] == [[0.1, 0.2, 0.4], [0.5]]
    # a value alone would be no line
    assert [line.get_marker() for line in axes.lines[:3]] == ["None", "o", "None"]
    assert [line.get_color() for line in axes.lines] == [*CURVES, CURVES[0]]
    assert not {*CURVES} & {*LINES[:3]}
    assert axes.get_xlim() == (1, 3)
    assert axes.get_ylim() == (0, 1.02)
    locator = axes.xaxis.get_major_locator()
    assert isinstance(locator, MaxNLocator)
    assert {float(tick) % 1 for tick in locator.tick_values(1, 3)} == {0}
    assert legend(figures[0]) == set("abcdef")


def test_curves_between_given_ends(figures):
    plots.curves([("a", [1.0, 2.0, 1.5])], "", "", highest=2.0, ends=(10, 20))
    plots.curves([("a", [1.0])], "", "")
    (axes,), (single,) = (figure.axes for figure in figures)
    assert axes.lines[0].get_xdata().tolist() == [10, 15, 20]
    assert (axes.get_xlim(), axes.get_ylim()) == ((10, 20), (0, pytest.approx(2.04)))
    assert single.get_xlim() == (1, 2)


def test_reliability_shows_each_bin_at_its_place(figures):
    bins = np.array([1, 0, 3, 4]), np.array([0.2, np.nan, 0.6, 0.9]), np.array([0.0, np.nan, 2 / 3, 1.0]), 0.12345
    plots.reliability([("one window", bins)])
    above, below = figures[0].axes
    assert pixels(figures[0]) == (420, 520)
    assert above.get_title("left") == "one window: expected calibration error 0.123"
    assert (above.get_ylabel(), below.get_ylabel(), below.get_xlabel()) == ("accuracy", "fraction", "confidence")
    left, wide = np.array([0, 0.5, 0.75]), 0.23
    assert bars(above) == pytest.approx(np.stack((left, left * 0, left * 0 + wide, [0, 2 / 3, 1]), 1))
    assert bars(below) == pytest.approx(np.stack((left, left * 0, left * 0 + wide, [1 / 8, 3 / 8, 4 / 8]), 1))
    for (start, end), at, confidence in zip(segments(above), left, (0.2, 0.6, 0.9), strict=True):
        assert (*start, *end) == pytest.approx((at, confidence, at + wide, confidence))
    assert [to_rgb(bar.get_facecolor()) for bar in above.patches] == [LINES[0]] * 3
    assert to_rgb(above.collections[0].get_color()[0]) == LINES[1]
    (diagonal,) = above.lines
    assert np.array_equal(diagonal.get_xydata(), [(0, 0), (1, 1)])
    assert above.get_xlim() == above.get_ylim() == (0, 1)
    assert above.get_gridspec().get_height_ratios() == (4, 1)
    assert legend(figures[0]) == {"accuracy", "confidence"}


def test_reliability_of_nothing(figures):
    nothing = np.zeros(2, int), np.full(2, np.nan), np.full(2, np.nan), 0.0
    plots.reliability([("nothing", nothing)])
    assert [len(axes.patches) for axes in figures[0].axes] == [0, 0]


def shown(axes):
    return np.asarray(axes.images[0].get_array())


def test_a_confusion_is_shaded_by_the_root_of_shares(figures):
    """Blue (10, 60, 130) is right, red (160, 20, 20) wrong, white none."""
    plots.confusion(np.array([[9, 3, 0], [0, 4, 0], [0, 0, 0]]), ["a", "b", "c"], "title")
    axes, below = figures[0].axes
    white = (255, 255, 255)
    # 3/4: 255 - 245 * 0.866 = 42.8; a quarter has half of the color
    expected = [[(42, 86, 146), (207, 137, 137), white], [white, (10, 60, 130), white], [white] * 3]
    assert shown(axes).tolist() == [[list(color) for color in row] for row in expected]
    assert texts(axes) == [(0, 0, "9"), (1, 0, "3"), (1, 1, "4")]
    assert (axes.get_title("left"), axes.get_xlabel(), axes.get_ylabel()) == ("title", "predicted class", "true class")
    assert [label.get_text() for label in axes.get_xticklabels()] == ["a", "b", "c"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b", "c"]
    assert not any(line.get_visible() for line in axes.xaxis.get_gridlines())
    # the legend: right above wrong, of five shares
    assert [label.get_text() for label in below.get_xticklabels()] == ["1%", "5%", "20%", "50%", "100%"]
    assert below.get_yticks().tolist() == [0, 1]
    assert [label.get_text() for label in below.get_yticklabels()] == ["right", "wrong"]
    assert shown(below).shape == (2, 5, 3)
    assert shown(below)[:, -1].tolist() == [[10, 60, 130], [160, 20, 20]]
    assert shown(below)[0, 0].tolist() == [230, 235, 242]
    assert (np.diff(shown(below).astype(int), axis=1) < 0).all()


def test_numbers_are_light_on_dark_cells(figures):
    plots.confusion(np.array([[7, 3], [69, 31]]), ["a", "b"], "")
    colors = [text.get_color() for text in figures[0].axes[0].texts]
    assert colors == ["white", "0.25", "white", "white"]


def test_a_confusion_grows_with_its_classes_up_to_a_bound(figures):
    def size(count, name="x"):
        plots.confusion(np.eye(count, dtype=int), [name] * count, "")
        return pixels(figures[-1])

    assert size(1) == size(8) == (386, 466)
    assert size(9) == (426, 506)
    assert size(32) == (1346, 1426)
    assert size(33) == size(40) == (1366, 1446)
    # 6 pixels a letter, of at most 24
    assert size(8, "x" * 24) == size(8, "x" * 50) == (524, 604)
    assert size(8, "x" * 23) == (518, 598)


def test_a_confusion_of_many_classes_has_fewer_words(figures):
    def written(count):
        plots.confusion(np.eye(count, dtype=int), [str(n) for n in range(count)], "")
        axes = figures[-1].axes[0]
        return axes.get_xticks().tolist(), len(axes.texts)

    # cells of 26 pixels have room for a number, and names for 13
    assert written(50) == (list(range(50)), 50)
    assert written(51) == (list(range(51)), 0)
    assert written(160) == (list(range(0, 160, 2)), 0)


def test_long_names_end_in_dots(figures):
    letters = "abcdefghijklmnopqrstuvwxyz"
    plots.confusion(np.eye(2, dtype=int), [letters[:24], letters[:25]], "")
    names = [label.get_text() for label in figures[0].axes[0].get_xticklabels()]
    assert names == [letters[:24], letters[:22] + ".."]


def test_bars_of_classes_are_worst_first_by_the_first_kind(figures):
    counts = np.array([4, 0, 1234, 7])
    vote, window = np.array([0.75, np.nan, 0.5, 1.0]), np.array([0.3, np.nan, 0.6, 0.2])
    plots.class_bars(["a", "b", "c", "d"], counts, [("vote", vote), ("window", window)], "accuracy")
    (axes,) = figures[0].axes
    assert axes.get_title("left") == "accuracy"
    assert axes.get_xlabel() == "accuracy"
    assert [label.get_text() for label in axes.get_yticklabels()] == ["c", "a", "d"]
    assert axes.get_yticks().tolist() == [0, 1, 2]
    assert bars(axes) == pytest.approx(np.array([(0, n - 0.4, v, 0.8) for n, v in enumerate((0.5, 0.75, 1))]))
    strokes = [[(v, n - 0.45), (v, n + 0.45)] for n, v in enumerate((0.6, 0.3, 0.2))]
    assert segments(axes) == pytest.approx(np.array(strokes))
    assert texts(axes) == [(1.02, 0, "50.0% of 1234"), (1.02, 1, "75.0% of 4"), (1.02, 2, "100.0% of 7")]
    assert axes.get_xlim() == (0, 1)
    # from top to bottom, with as much room above as below
    assert axes.get_ylim() == pytest.approx((2.6, -0.6))
    assert axes.xaxis.get_major_formatter()(0.25, None) == "25%"
    assert [line.get_visible() for line in axes.yaxis.get_gridlines()] == [False] * 3
    assert any(line.get_visible() for line in axes.xaxis.get_gridlines())
    assert legend(figures[0]) == {"vote", "window"}


@pytest.mark.parametrize(
    ("count", "height", "title"),
    [
        (1, 132, ""),
        (40, 990, ""),
        (41, 643, ""),
        (120, 1670, ""),
        (121, 1670, ", the 120 worst of 121 classes"),
    ],
)
def test_as_many_bars_as_there_is_room_for(figures, count, height, title):
    share = np.linspace(1, 0, count)
    plots.class_bars([str(n) for n in range(count)], np.ones(count, int), [("x", share)], "of all")
    assert pixels(figures[0]) == (760, height)
    (axes,) = figures[0].axes
    assert axes.get_title("left") == "of all" + title
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        str(count - 1 - n) for n in range(min(count, 120))
    ]


def test_intervals_of_values_are_drawn_and_within_the_axis(figures):
    plots.points_chart([0.95, 0.97], "ab", "title", "x", [(0.85, 0.99), (0.9, 1.0)])
    (axes,) = figures[0].axes
    drawn = [lines.get_segments()[0].tolist() for lines in axes.collections]
    assert drawn == [[[0, 0.85], [0, 0.99]], [[1, 0.9], [1, 1.0]]]
    assert axes.get_ylim() == (0.8, 1)


def test_marked_values_have_their_names_and_an_axis_up_to_1(figures):
    def axes(values, names="abcdef"):
        plots.points_chart(values, names[: len(values)], "title", "number")
        (found,) = figures[-1].axes
        return found

    found = axes([0.97, 0.95])
    assert pixels(figures[0]) == (720, 420)
    assert found.get_ylim() == (0.9, 1)
    assert (found.get_title("left"), found.get_xlabel()) == ("title", "number")
    assert np.array_equal(found.lines[0].get_xydata(), [(0, 0.97), (1, 0.95)])
    assert [note.xy for note in found.texts] == [(0, 0.97), (1, 0.95)]
    # the numbers stand above their marks
    assert all(note.xyann[0] == 0 < note.xyann[1] for note in found.texts)
    assert found.get_xticks().tolist() == [0, 1]
    assert [label.get_text() for label in found.get_xticklabels()] == ["a", "b"]
    assert axes([0.59, 1.0]).get_ylim() == (0.5, 1)
    assert axes([0.6, 1.0, 0.99]).get_ylim() == (0.6, 1)
    assert axes([0.04]).get_ylim() == (0, 1)
    turned = [axes([0.5, 0.5], ["x" * n, "y"]).get_xticklabels()[0].get_rotation() for n in (8, 9)]
    assert turned == [0, 20]


POINTS = [(1.0, 0.5), (2.0, 0.9), (3.0, 0.7), (20.0, 0.99), (4.0, 0.999)]


def test_a_tradeoff_joins_its_front_and_names_it(figures):
    plots.tradeoff(POINTS, ["cheap", "good", "neither", "dear", "best"], "title", "cost", "gain")
    (axes,) = figures[0].axes
    assert (axes.get_title("left"), axes.get_xlabel(), axes.get_ylabel()) == ("title", "cost", "gain")
    (dots,) = (thing for thing in axes.collections if isinstance(thing, PathCollection))
    assert np.array_equal(dots.get_offsets(), POINTS)
    colors = [tuple(color[:3]) for color in dots.get_facecolor()]
    assert colors == [LINES[0], LINES[0], LINES[1], LINES[1], LINES[0]]
    assert np.array_equal(axes.lines[0].get_xydata(), [POINTS[0], POINTS[1], POINTS[4]])
    assert [(note.xy, note.get_text()) for note in axes.texts] == [
        (POINTS[0], "cheap"),
        (POINTS[1], "good"),
        (POINTS[4], "best"),
    ]
    assert axes.get_xscale() == "log"
    assert axes.xaxis.get_major_formatter()(20, None) == "20"


def test_gains_lie_by_the_logarithm_of_what_they_lack(figures):
    plots.tradeoff(POINTS, "abcde", "", "", "")
    (axes,) = figures[0].axes
    gains = np.array([0.0, 0.5, 0.9, 0.99, 0.999, 1.0])
    heights = axes.transData.transform(np.stack((np.ones(6), gains), 1))[:, 1]
    # half a thousandth counts as nothing lacking, or 1 would be infinitely far
    lack = -np.log10(1 + 0.0005 - gains)
    assert np.diff(heights) / np.ptp(heights) == pytest.approx(np.diff(lack) / np.ptp(lack))
    back = axes.transData.inverted().transform(np.stack((np.ones(6) * 300, heights), 1))[:, 1]
    assert back == pytest.approx(gains)
    # room below the least and above the highest
    ends = -np.log10(1 + 0.0005 - np.array(axes.get_ylim()))
    assert ends == pytest.approx([-np.log10(0.5005) - 0.08, -np.log10(0.0015) + 0.12])
    ticks = axes.get_yticks()
    assert (ticks[0], ticks[-1]) == (0, 1)
    assert (np.diff(ticks) > 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_names_cover_neither_each_other_nor_points(figures, seed):
    rng = np.random.default_rng(seed)
    gains = np.sort(rng.uniform(0.5, 0.99, 9))
    points = [(float(cost), float(gain)) for cost, gain in zip(np.sort(rng.uniform(1, 9, 9)), gains, strict=True)]
    plots.tradeoff(points, [f"network {n}" for n in range(9)], "", "", "")
    (axes,) = figures[0].axes
    figures[0].canvas.draw()
    boxes = [mpl.text.Text.get_window_extent(note) for note in axes.texts]
    assert len(boxes) == 9
    at = axes.transData.transform(points)
    for n, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:n])
        # points have a radius of 3 pixels
        assert not any(box.padded(2.9).contains(*place) for place in at)
        assert axes.bbox.x0 < box.x0 < box.x1 < axes.bbox.x1
        # beside its point, at most 130 points of 1/72 inch away along each axis
        far = np.maximum([box.x0 - at[n][0], box.y0 - at[n][1]], [at[n][0] - box.x1, at[n][1] - box.y1])
        assert (far < 130 * 100 / 72 + 1).all()


def test_a_name_alone_stands_close_to_its_point(figures):
    plots.tradeoff([(2.0, 0.9)], ["x"], "", "", "")
    (note,) = figures[0].axes[0].texts
    # on the upper left, by 8 points; the text ends there
    assert note.xyann == (-8, 8)
    assert note.get_horizontalalignment() == "right"
    assert not note.get_in_layout()
