import matplotlib as mpl
import numpy as np
import pytest
import torch
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T

mpl.use("Agg")
N = np.arange(200)
EVENTS = Events(10**15 + N * 2_000, N % 8, N // 40, N < 150, (8, 6))


@pytest.fixture
def axes():
    return Figure().add_subplot()


def test_a_frame_is_the_picture_of_the_events(axes):
    assert EVENTS.plot(ax=axes) is axes
    shown = axes.images[0].get_array()
    assert np.array_equal(shown, nvsdata.plots.event_image(EVENTS)[..., ::-1])
    # the origin is top left
    assert axes.get_ylim()[0] > axes.get_ylim()[1]


def test_the_rate_counts_events_per_second_by_polarity(axes):
    EVENTS.plot("rate", axes)
    totals = {}
    for stairs in axes.patches:
        values, edges, _ = stairs.get_data()
        totals[stairs.get_label()] = (values * np.diff(edges) / 1e3).sum()
    assert totals == {"ON": pytest.approx(150), "OFF": pytest.approx(50)}


def test_polarity_is_summed(axes):
    EVENTS.plot("polarity", axes)
    summed = np.zeros((6, 8))
    np.add.at(summed, (EVENTS.y, EVENTS.x), 2.0 * EVENTS.p - 1)
    assert np.array_equal(axes.images[0].get_array(), summed)


def test_a_histogram_has_every_pixel_with_events(axes):
    EVENTS.plot("histogram", axes)
    assert sum(bar.get_height() for bar in axes.patches) == 40
    assert "17% of the pixels have none" in axes.get_title("left") + axes.get_title()


def test_a_cloud_has_all_events_or_some_of_very_many():
    space = Figure().add_subplot(projection="3d")
    EVENTS.plot("cloud", space)
    t, x, y = space.collections[0]._offsets3d
    assert np.array_equal(np.sort(t), np.arange(0, 400, 2))
    assert len(x) == len(y) == 200
    many = Events(np.arange(200_000), np.zeros(200_000, int), np.zeros(200_000, int), np.zeros(200_000, int), (1, 1))
    space = Figure().add_subplot(projection="3d")
    many.plot("cloud", space)
    assert len(space.collections[0]._offsets3d[0]) == 50_000


def test_a_graph_has_its_nodes_and_edges(axes):
    graph = T.radius_graph(EVENTS, beta=0.0)
    assert graph.num_edges
    nvsdata.plot(graph, ax=axes)
    lines = [thing for thing in axes.collections if isinstance(thing, LineCollection)]
    assert len(lines[0].get_segments()) == graph.num_edges
    assert len(axes.collections[-1].get_offsets()) == graph.num_nodes


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
        ax = ev.plot(kind)
        ax.figure.canvas.draw()
        mpl.pyplot.close(ax.figure)


def test_a_notebook_shows_a_png():
    for ev in (EVENTS, Events.empty((8, 6))):
        assert ev._repr_png_().startswith(b"\x89PNG")


def test_what_cannot_be_drawn():
    with pytest.raises(ValueError, match="kind must be one of 'frame', 'cloud', 'rate', 'polarity', 'histogram'"):
        EVENTS.plot("movie")
    with pytest.raises(ValueError, match="kind is for events, not for Tensor"):
        nvsdata.plot(torch.zeros(2, 2), "frame")
    with pytest.raises(TypeError, match="a graph or a tensor of at least two axes"):
        nvsdata.plot(torch.zeros(3))
