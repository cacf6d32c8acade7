import subprocess
import sys
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import torch
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.plots import show
from nvsdata.plots.axes import LINES

mpl.use("Agg")
N = np.arange(200)
EVENTS = Events(10**15 + N * 2_000, N % 8, N // 40, N < 150, (8, 6))


@pytest.fixture
def axes():
    return Figure().add_subplot()


def test_a_frame_is_the_picture_of_the_events(axes):
    assert nvsdata.plot(EVENTS, ax=axes) is axes
    shown = axes.images[0].get_array()
    # 30 ms at the midpoint, or all events of a shorter time
    middle = EVENTS.window(10**15 + 184_000, 10**15 + 214_000)
    assert np.array_equal(shown, nvsdata.plots.event_image(middle)[..., ::-1])
    short = nvsdata.plot(EVENTS[:14], ax=Figure().add_subplot())
    assert np.array_equal(short.images[0].get_array(), nvsdata.plots.event_image(EVENTS[:14])[..., ::-1])
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["ON", "OFF", "both"]
    assert [to_rgb(patch.get_facecolor()) for patch in axes.get_legend().get_patches()] == LINES[:3][1::-1] + LINES[2:3]
    # the origin is top left
    assert axes.get_ylim()[0] > axes.get_ylim()[1]


def test_the_rate_counts_events_per_second_by_polarity(axes):
    nvsdata.plot(EVENTS, "rate", axes)
    totals = {}
    for stairs in axes.patches:
        values, edges, _ = stairs.get_data()
        totals[stairs.get_label()] = (values * np.diff(edges) / 1e3).sum()
    assert totals == {"ON": pytest.approx(150), "OFF": pytest.approx(50)}


def test_polarity_is_summed(axes):
    nvsdata.plot(EVENTS, "polarity", axes)
    summed = np.zeros((6, 8))
    np.add.at(summed, (EVENTS.y, EVENTS.x), 2.0 * EVENTS.p - 1)
    assert np.array_equal(axes.images[0].get_array(), summed)


def test_a_histogram_has_every_pixel_with_events(axes):
    nvsdata.plot(EVENTS, "histogram", axes)
    assert sum(bar.get_height() for bar in axes.patches) == 40
    assert "17% of the pixels have no events" in axes.get_title("left") + axes.get_title()


def test_a_cloud_has_all_events_or_some_of_very_many():
    space = Figure().add_subplot(projection="3d")
    nvsdata.plot(EVENTS, "cloud", space)
    t, x, y = space.collections[0]._offsets3d
    assert np.array_equal(np.sort(t), np.arange(0, 400, 2))
    assert len(x) == len(y) == 200
    many = Events(np.arange(200_000), np.zeros(200_000, int), np.zeros(200_000, int), np.zeros(200_000, int), (1, 1))
    space = Figure().add_subplot(projection="3d")
    nvsdata.plot(many, "cloud", space)
    assert len(space.collections[0]._offsets3d[0]) == 50_000


def nodes_of(axes):
    (found,) = (thing for thing in axes.collections if isinstance(thing, PathCollection))
    return found


def test_a_graph_has_its_nodes_and_edges(axes):
    graph = T.RadiusGraph(beta=0.0)(EVENTS)
    assert graph.num_edges
    nvsdata.plot(graph, ax=axes)
    lines = [thing for thing in axes.collections if isinstance(thing, LineCollection)]
    assert len(lines[0].get_segments()) == graph.num_edges
    assert len(nodes_of(axes).get_offsets()) == graph.num_nodes


@pytest.mark.parametrize("shape", [(6, 8), (1, 6, 8), (5, 6, 8), (2, 3, 6, 8)])
def test_images_of_a_tensor_lie_side_by_side(axes, shape):
    tensor = torch.arange(float(np.prod(shape))).view(shape)
    nvsdata.plot(tensor, ax=axes)
    sheet = np.ma.filled(axes.images[0].get_array().astype(float), np.nan)
    assert np.isfinite(sheet).sum() == tensor.numel()
    assert sorted(sheet[np.isfinite(sheet)]) == tensor.flatten().tolist()
    assert np.array_equal(sheet[:6, :8], tensor.reshape(-1, 6, 8)[0])


@pytest.mark.parametrize("kind", ["frame", "cloud", "rate", "polarity", "histogram"])
def test_no_events_and_a_single_one_are_drawn(kind):
    for ev in (Events.empty((8, 6)), EVENTS[:1]):
        ax = nvsdata.plot(ev, kind)
        ax.figure.canvas.draw()
        mpl.pyplot.close(ax.figure)


def test_a_notebook_shows_a_png():
    for ev in (EVENTS, Events.empty((8, 6))):
        assert ev._repr_png_().startswith(b"\x89PNG")


def test_what_cannot_be_drawn():
    with pytest.raises(ValueError, match="kind must be one of 'frame', 'cloud', 'rate', 'polarity', 'histogram'"):
        nvsdata.plot(EVENTS, "movie")
    with pytest.raises(ValueError, match="kind is for events, not for Tensor"):
        nvsdata.plot(torch.zeros(2, 2), "frame")
    with pytest.raises(TypeError, match="a graph or a tensor of at least two axes"):
        nvsdata.plot(torch.zeros(3))


def title(axes):
    return axes.get_title("left")


def test_pixels_fill_the_axes(axes):
    nvsdata.plot(EVENTS, ax=axes)
    assert title(axes) == "15 events, 184 to 214 ms"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (px)", "y (px)")
    assert (axes.get_xlim(), axes.get_ylim()) == ((-0.5, 7.5), (5.5, -0.5))
    assert axes.get_aspect() == 1
    assert not any(line.get_visible() for line in axes.xaxis.get_gridlines())


def test_colors_of_polarity_are_as_strong_both_ways(axes):
    nvsdata.plot(EVENTS, "polarity", axes)
    (image,) = axes.images
    # each pixel has five events
    assert image.get_clim() == (-5, 5)
    assert image.get_cmap().name == "RdBu_r"
    assert image.colorbar.ax.get_ylabel() == "ON minus OFF events per pixel"
    assert title(axes) == "200 events, 398.0 ms"
    none = Figure().add_subplot()
    nvsdata.plot(Events.empty((8, 6)), "polarity", none)
    assert none.images[0].get_clim() == (-1, 1)


def test_the_rate_is_of_200_parts_of_the_whole(axes):
    # two events per ms of the first second, ON; then 0.5 per ms
    t = np.concatenate((np.arange(0, 1_000_000, 500), np.arange(1_000_000, 2_000_001, 2_000)))
    nvsdata.plot(Events(10**15 + t, t * 0, t * 0, t < 1_000_000, (8, 6)), "rate", axes)
    on, off = (stairs.get_data() for stairs in axes.patches)
    assert np.array_equal(on.edges, np.arange(0, 2_001, 10))
    assert np.allclose(on.values, [2_000] * 100 + [0] * 100)
    # the last part has the very last event, too
    assert np.allclose(off.values, [0] * 100 + [500] * 99 + [600])
    colors = [stairs.get_edgecolor()[:3] for stairs in axes.patches]
    assert colors == [show.ON, show.OFF]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time (ms)", "events/s")
    assert axes.get_ylim()[0] == 0
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["ON", "OFF"]


def test_a_histogram_tells_pixels_of_few_events_from_those_of_many(axes):
    numbers = [1] * 5 + [2] * 3 + [3] * 2 + [100]
    pixel = np.repeat(np.arange(11), numbers)
    t = np.arange(len(pixel))
    nvsdata.plot(Events(t, pixel % 4, pixel // 4, t * 0, (4, 5)), "histogram", axes)
    bars = {bar.get_x(): bar.get_height() for bar in axes.patches if bar.get_height()}
    assert list(bars.values()) == [5, 3, 2, 1]
    assert list(bars)[:3] == [1, 2, 3]
    last = axes.patches[-1]
    assert last.get_x() + last.get_width() == 101
    assert title(axes) == "117 events, 0.1 ms; 45% of the pixels have no events"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("events per pixel", "number of pixels")
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")


def test_a_cloud_has_the_axes_of_its_events():
    space = Figure().add_subplot(projection="3d")
    nvsdata.plot(EVENTS, "cloud", space)
    t, x, y = space.collections[0]._offsets3d
    order = np.argsort(t)
    assert np.array_equal(np.stack((t, x, y))[:, order], np.stack((N * 2.0, EVENTS.x, EVENTS.y)))
    colors = space.collections[0].get_facecolor()[:, :3]
    assert {tuple(color) for color in colors} == {show.ON, show.OFF}
    assert sum(tuple(color) == show.ON for color in colors) == 150
    assert (space.get_xlabel(), space.get_ylabel(), space.get_zlabel()) == ("time (ms)", "x (px)", "y (px)")
    assert (space.get_ylim(), space.get_zlim()) == ((-0.5, 7.5), (5.5, -0.5))
    # pixels are square
    long, wide, tall = space._box_aspect
    assert (long / wide, tall / wide) == pytest.approx((1.6, 6 / 8))
    assert title(space) == "200 events, 398.0 ms"


def test_some_of_very_many_events_are_spread_over_all(monkeypatch):
    monkeypatch.setattr(show, "MOST_POINTS", 5)
    for count, kept in ((5, [0, 1, 2, 3, 4]), (6, [0, 1, 2, 3, 5]), (9, [0, 2, 4, 6, 8])):
        space = Figure().add_subplot(projection="3d")
        nvsdata.plot(EVENTS[:count], "cloud", space)
        assert np.array_equal(np.sort(space.collections[0]._offsets3d[0]), np.multiply(kept, 2.0))


def test_nodes_of_a_graph_have_their_places_and_polarities(axes):
    events = Events([0, 10, 20], [1, 2, 7], [0, 1, 5], [1, 0, 1], (8, 6))
    graph = T.RadiusGraph(radius=3.0)(events)
    nvsdata.plot(graph, ax=axes)
    (edges,) = (thing for thing in axes.collections if isinstance(thing, LineCollection))
    ends = {tuple(map(tuple, segment.astype(int).tolist())) for segment in edges.get_segments()}
    assert ends == {((1, 0), (2, 1)), ((2, 1), (1, 0))}
    nodes = nodes_of(axes)
    assert nodes.get_offsets().tolist() == [[1, 0], [2, 1], [7, 5]]
    assert [tuple(color[:3]) for color in nodes.get_facecolor()] == [show.ON, show.OFF, show.ON]
    # short edges would be hidden by the nodes
    assert edges.get_zorder() > nodes.get_zorder()
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["ON", "OFF"]
    assert title(axes) == "3 nodes, 2 edges"
    assert (axes.get_xlim(), axes.get_ylim()) == ((-0.5, 7.5), (5.5, -0.5))
    # without a sensor, up to the last node
    other = Figure().add_subplot()
    nvsdata.plot(replace(T.RadiusGraph()(events[:2]), sensor_size=None), ax=other)
    assert (other.get_xlim(), other.get_ylim()) == ((-0.5, 2.5), (1.5, -0.5))


@pytest.mark.parametrize(
    ("shape", "columns"),
    [
        ((12, 6, 8), 4),
        ((1, 6, 8), 1),
        ((2, 6, 8), 2),
        ((7, 6, 8), 3),
        ((24, 6, 8), 5),
        ((2, 3, 9, 1), 6),
        ((3, 1, 90), 1),
    ],
)
def test_a_sheet_of_images_is_half_as_wide_again_as_high(axes, shape, columns):
    tensor = torch.rand(shape)
    nvsdata.plot(tensor, ax=axes)
    height, width = shape[-2:]
    images = tensor.reshape(-1, height, width).numpy()
    rows = -(-len(images) // columns)
    sheet = np.ma.filled(axes.images[0].get_array().astype(float), np.nan)
    assert sheet.shape == (rows * (height + 1) - 1, columns * (width + 1) - 1)
    for n, image in enumerate(images):
        top, left = n // columns * (height + 1), n % columns * (width + 1)
        assert np.array_equal(sheet[top : top + height, left : left + width], image.astype(float))
    assert title(axes) == str(list(shape))
    assert not axes.axison


def test_colors_of_a_tensor_are_of_its_range(axes):
    def drawn(values):
        where = Figure().add_subplot()
        nvsdata.plot(torch.tensor(values), ax=where)
        (image,) = where.images
        return image.get_cmap().name, *image.get_clim()

    assert drawn([[1.0, 2.0], [3.0, 4.0]]) == ("viridis", 1, 4)
    assert drawn([[0.0, 2.0]]) == ("viridis", 0, 2)
    assert drawn([[-1.0, 3.0]]) == ("RdBu_r", -3, 3)
    assert drawn([[-4.0, 3.0]]) == ("RdBu_r", -4, 4)
    assert nvsdata.plot(torch.zeros(0, 3, 3), ax=axes) is axes


def test_a_hot_pixel_does_not_set_the_colors(axes):
    values = torch.cat((torch.zeros(1_000), torch.ones(999), torch.tensor([500.0]))).view(40, 50)
    nvsdata.plot(values, ax=axes, label="events per pixel")
    (image,) = axes.images
    assert image.get_clim() == (0, 1)
    assert image.colorbar.extend == "max"
    assert image.colorbar.ax.get_ylabel() == "events per pixel"


def test_images_of_a_tensor_have_titles(axes):
    tensor = torch.arange(240.0).view(2, 10, 12)
    nvsdata.plot(tensor, ax=axes, titles=["ON", "OFF"])
    assert [(text.get_text(), text.get_position()) for text in axes.texts] == [("ON", (0, -0.5)), ("OFF", (13, -0.5))]
    below = nvsdata.plot(tensor.view(2, 3, 40), ax=Figure().add_subplot(), titles=["a", "b"])
    # in the gap above its image
    assert below.texts[1].get_position() == (0, 3.5)
    with pytest.raises(ValueError, match="one title for each of 2 images, not 1"):
        nvsdata.plot(tensor, titles=["ON"])
    with pytest.raises(ValueError, match="one title for each of 0 images, not 1"):
        nvsdata.plot(EVENTS, titles=["ON"])


def test_what_is_missing_has_no_color(axes):
    nvsdata.plot(torch.tensor([[1.0, float("nan")], [3.0, 4.0]]), ax=axes)
    assert axes.images[0].get_clim() == (1, 4)
    assert np.ma.getmaskarray(axes.images[0].get_array()).tolist() == [[False, True], [False, False]]
    nvsdata.plot(torch.full((2, 2), float("nan")), ax=Figure().add_subplot()).figure.canvas.draw()


def test_a_notebook_shows_30_ms_at_the_midpoint(monkeypatch):
    made = []
    monkeypatch.setattr(show, "rendered", lambda figure: made.append(figure) or np.zeros((1, 1, 3), np.uint8))
    EVENTS._repr_png_()
    frame, rate = made[0].axes
    assert title(frame) == "15 events, 184 to 214 ms"
    assert np.array_equal(
        frame.images[0].get_array(),
        nvsdata.plots.event_image(EVENTS.window(10**15 + 184_000, 10**15 + 214_000))[..., ::-1],
    )
    assert title(rate) == "200 events, 398.0 ms"
    assert tuple(made[0].get_size_inches() * made[0].dpi) == (900, 330)


def test_events_in_a_notebook_are_drawn_however_they_were_imported():
    code = (
        "import sys; from nvsdata.data.events import Events; events = Events([0, 9], [0, 1], [0, 1], [0, 1])\n"
        "assert not any(name.startswith('nvsdata.plots') for name in sys.modules)\n"
        "assert events._repr_png_().startswith(b'\\x89PNG')"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
