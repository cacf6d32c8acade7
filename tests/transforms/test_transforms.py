from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.data.recording import Recording
from nvsdata.transforms.events.sampling import BETA, LITERAL_BETA


def sweep(n=500, offset=0):
    t = np.arange(n) * 200
    return Events(t + offset, (t // 300) % 34, (t // 700) % 34, t // 200 % 2, (34, 34))


ALL = [
    T.Window(0, 30_000),
    T.RandomWindow(30_000),
    T.NonUniformSample(8),
    T.DropEvents(0.3),
    T.RandomAffine(scale=(0.85, 1.1), degrees=15, shift=2, shear=0.3, stretch=0.2),
    T.RadiusGraph(radius=3, alpha=1, beta=LITERAL_BETA, max_degree=32, pseudo="signed-time", reach_t=5_000),
    T.NodeFeatures(T.Compose([T.MergePixels(("first", "mean")), T.KNNGraph()]), [T.Age(), T.Patch(3), T.PatchMean(7)]),
    T.MergePixels(times=("last",)),
    T.RandomScale(),
    T.RandomFlip(0),
    T.RandomRotate(),
    T.RandomTranslate(),
    T.RandomWindows(count=8, duration=33_333),
    T.Each(T.KNNGraph(k=2, reach=5, pseudo="abs", reach_t=9_000)),
    T.Graph2Grid(cluster=(8, 6)),
    T.ToFrames(fps=25, values="sum", factor=8),
    T.RandomTemporalCrop(160),
    T.SlidingClips(3),
    T.MotionCrop(24),
    T.FourCrops(24),
    T.MedianDenoise(),
]


@pytest.mark.parametrize("transform", [*ALL, T.Compose(ALL)], ids=lambda t: type(t).__name__)
def test_the_repr_builds_the_same_transform(transform):
    names = {name: getattr(T, name) for name in T.__all__}
    assert eval(repr(transform), names) == transform


def test_settings_cannot_be_changed():
    with pytest.raises(AttributeError):
        T.RadiusGraph().radius = 4


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: T.Window(5, 3), "ends before"),
        (lambda: T.RandomWindow(0), "duration must be positive, not 0"),
        (lambda: T.RandomWindow(5, (0.5, 0.5)), "within must be"),
        (lambda: T.NonUniformSample(0), "k must be a whole number of at least 1, not 0"),
        (lambda: T.NonUniformSample(0.5), "k must be a whole number of at least 1, not 0.5"),
        (lambda: T.NonUniformSample(k=8, beta=-1), "beta must not be negative"),
        (lambda: T.DropEvents(1.5), "between 0 and 1"),
        (lambda: T.RadiusGraph(radius=float("nan")), "radius must be positive"),
        (lambda: T.RadiusGraph(max_degree=0), "max_degree must be a whole number of at least 1, not 0"),
        (lambda: T.RadiusGraph(max_degree=1.5), "max_degree must be a whole number of at least 1, not 1.5"),
        (
            lambda: T.RadiusGraph(pseudo="polar"),
            "pseudo must be one of .*, not 'polar'",
        ),
        (lambda: T.RadiusGraph(reach_t=0), "reach_t must be positive, not 0"),
        (lambda: T.MergePixels(("middle",)), r"times must be of \('first', 'last', 'mean'\), not 'middle'"),
        (lambda: T.Patch(4), "size must be odd and at most 17, not 4"),
        (lambda: T.PatchMean(19), "size must be odd and at most 17, not 19"),
        (lambda: T.RandomFlip(2), "axis must be 0 or 1"),
        (lambda: T.RandomScale(1.0, 0.5), "at least low"),
        (lambda: T.RandomRotate(-1), "degrees must not be negative"),
        (lambda: T.RandomAffine(scale=(1.1, 0.9)), "at least low"),
        (lambda: T.RandomAffine(shear=-0.1), "shear"),
        (lambda: T.RandomAffine(stretch=1), "stretch must be at least 0 and less than 1, not 1"),
    ],
)
def test_bad_settings_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_compose_refuses_what_cannot_be_called():
    with pytest.raises(TypeError, match="callable"):
        T.Compose([3])


def test_the_pipeline_of_the_thesis_makes_a_graph():
    pipeline = T.Compose(
        [T.RandomWindow(30_000), T.NonUniformSample(8), T.RadiusGraph(3), T.RandomScale(), T.RandomFlip(0)]
    )
    graph = pipeline(sweep())
    assert 150 / 8 <= graph.num_nodes < 150
    assert graph.edge_attr.shape == (graph.num_edges, 2)


@pytest.mark.parametrize("offset", [0, 1_600_000_000_000_000])
def test_windows_count_from_the_first_event(offset):
    ev = sweep(offset=offset)
    assert T.Window(1_000, 2_000)(ev).t.tolist() == [offset + t for t in (1000, 1200, 1400, 1600, 1800)]
    assert len(T.Window(10**9, 10**9 + 5)(ev)) == 0


@given(events(max_size=80), st.integers(1, 50_000))
def test_random_windows_lie_inside_and_are_no_longer_than_asked(ev, duration):
    cut = T.RandomWindow(duration)(ev)
    assert cut.duration < duration
    if len(ev):
        assert cut.start >= ev.t[0]
        assert cut.start + duration <= ev.t[-1] + 1 or cut == ev
        assert cut == ev.window(cut.start, cut.start + duration)


def test_shares_of_random_windows_tile_the_places():
    ev = sweep(50)
    places = ev.t[-1] + 1 - 9_790 + 1
    seen = [{T.RandomWindow(9_790, within=(k / 3, (k + 1) / 3))(ev).start for _ in range(99)} for k in range(3)]
    assert sorted(s for starts in seen for s in starts) == list(range(places))


def test_random_windows_reach_both_ends():
    ev = sweep(50)
    starts = {T.RandomWindow(9_790)(ev).start for _ in range(200)}
    assert starts == set(range(ev.t[-1] + 1 - 9_790 + 1))


def test_a_window_reads_only_itself_from_a_recording():
    asked = []

    class Spy(Recording):
        format = "spy"
        sensor_size = (34, 34)
        span = (1_000, 200_000)

        def read(self, start=None, stop=None):
            asked.append((start, stop))
            return Events.empty((34, 34), start)

    T.Window(5, 10)(Spy())
    T.RandomWindow(30_000)(Spy())
    assert asked[0] == (1_005, 1_010)
    assert asked[1][1] - asked[1][0] == 30_000
    assert 1_000 <= asked[1][0] <= 170_001


def slow_boxes(ev, k, wx, wt):
    """Boxes of the recursive median split, with sorting instead of selection."""
    done, todo = [], [list(range(len(ev)))] if len(ev) else []
    while todo:
        box = todo.pop()
        if len(box) <= k:
            done.append(box)
            continue
        t, x, y = (np.array([int(c[i]) for i in box]) for c in (ev.t, ev.x, ev.y))
        sides = (float(np.ptp(t)) * wt, float(np.ptp(x)) * wx, float(np.ptp(y)) * wx)
        key = (t, x, y)[int(np.argmax(sides))]
        order = [box[i] for i in np.lexsort((box, key))]
        todo += [order[: len(box) // 2], order[len(box) // 2 :]]
    return done


@given(events(max_size=300), st.integers(1, 20), st.sampled_from([None, 0.0, LITERAL_BETA, 1.0]))
def test_one_event_comes_from_each_box(ev, k, beta):
    _, first = np.unique(ev.to_structured(), return_index=True)
    ev = ev[np.sort(first)]
    sampled = T.NonUniformSample(k)(ev) if beta is None else T.NonUniformSample(k, beta=beta)(ev)
    pool = [tuple(int(c[i]) for c in sampled.columns) for i in range(len(sampled))]
    boxes = slow_boxes(ev, k, 1.0, np.sqrt(BETA if beta is None else beta))
    assert len(sampled) == len(boxes)
    for box in boxes:
        members = {tuple(int(c[i]) for c in ev.columns) for i in box}
        match = next(event for event in pool if event in members)
        pool.remove(match)


def test_boxes_of_a_wide_sensor():
    rng = np.random.default_rng(0)
    places = rng.choice(1280 * 720, 300, replace=False)
    ev = Events(np.sort(rng.integers(0, 3_000, 300)), places % 1280, places // 1280, rng.integers(0, 2, 300))
    for k in (1, 8):
        sampled = set(zip(*(c.tolist() for c in T.NonUniformSample(k)(ev).columns), strict=True))
        members = [{tuple(int(c[i]) for c in ev.columns) for i in box} for box in slow_boxes(ev, k, 1.0, np.sqrt(BETA))]
        assert len(sampled) == len(members)
        assert all(len(sampled & box) == 1 for box in members)


def test_sampling_is_even_within_a_box():
    ev = sweep(8)
    counts = np.zeros(8)
    for _ in range(4_000):
        counts[int(T.NonUniformSample(8)(ev).t[0]) // 200] += 1
    assert abs(counts / 4_000 - 1 / 8).max() < 0.03


def test_sampling_survives_times_far_apart():
    ev = Events(np.array([-(2**61), 0, 5, 2**61]), [1, 2, 3, 4], [1, 1, 1, 1], [0, 1, 0, 1])
    assert len(T.NonUniformSample(2)(ev)) == 2


def test_the_seed_decides():
    draws = []
    for seed in (1, 1, 2):
        torch.manual_seed(seed)
        draws.append(T.Compose([T.RandomWindow(30_000), T.NonUniformSample(4), T.DropEvents(0.3)])(sweep()))
    assert draws[0] == draws[1]
    assert draws[0] != draws[2]


def test_a_graph_moves_as_its_events_do():
    g, settings = graph(), (0.9, 20.0, 1.5, -2.0, 0.1, 1.1)
    moved, events = T.affine(g, *settings), T.affine(sweep(60), *settings)
    inside = (moved.pos.round() >= 0).all(1) & (moved.pos.round() <= torch.tensor([33.0, 33.0])).all(1)
    assert moved.pos[inside].round().tolist() == np.stack((events.x, events.y), 1).tolist()
    unknown = replace(g, sensor_size=None)
    assert torch.equal(T.affine(unknown, dx=1.5).pos, g.pos + torch.tensor([1.5, 0.0]))
    with pytest.raises(ValueError, match="the graph has no sensor_size, so its center isn't known"):
        T.affine(unknown, 0.5)


def test_nothing_is_dropped_at_a_probability_of_0():
    assert T.DropEvents(0.0)(sweep()) == sweep()


def graph(kind="signed"):
    return T.RadiusGraph(pseudo=kind)(sweep(60))


KINDS = ("abs", "signed", "signed-time")


@pytest.mark.parametrize("kind", KINDS)
def test_flip_mirrors_and_undoes_itself(kind):
    g = graph(kind)
    assert torch.equal(T.RandomFlip(0, 1.0)(g).pos[:, 0], 33 - g.pos[:, 0])
    assert torch.equal(T.RandomFlip(1, 1.0)(T.RandomFlip(1, 1.0)(g)).pos, g.pos)
    for axis in (0, 1):
        mirrored = g.edge_attr.clone()
        if kind != "abs":
            mirrored[:, axis] = 1 - mirrored[:, axis]
        assert torch.allclose(T.RandomFlip(axis, 1.0)(g).edge_attr, mirrored, atol=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
@given(ev=events(max_size=60))
def test_events_are_mirrored_as_graphs_are(axis, ev):
    join = T.RadiusGraph(max_degree=100)
    mirrored = T.RandomFlip(axis, p=1)(ev)
    assert torch.equal(join(mirrored).pos, T.RandomFlip(axis, 1.0)(join(ev)).pos)
    assert torch.equal(join(mirrored).edge_index, join(ev).edge_index)
    assert mirrored.sensor_size == ev.sensor_size
    assert T.RandomFlip(axis, 1.0)(mirrored) == ev
    assert T.RandomFlip(axis, p=0)(ev) == ev


@pytest.mark.parametrize("kind", KINDS)
def test_a_quarter_turn_swaps_the_axes(kind):
    g = graph(kind)
    turned = T.affine(g, degrees=90)
    assert torch.allclose(turned.pos[:, 0], 33 - g.pos[:, 1], atol=1e-4)
    across, along, *time = g.edge_attr.T
    expected = [along if kind == "abs" else 1 - along, across, *time]
    assert torch.allclose(turned.edge_attr, torch.stack(expected, 1), atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_scaling_scales_pseudo_coordinates_and_keeps_the_center(kind):
    g = graph(kind)
    small = T.affine(g, 0.5)
    middle = 0.0 if kind == "abs" else 0.5
    assert torch.allclose(small.edge_attr[:, :2] - middle, (g.edge_attr[:, :2] - middle) / 2)
    assert torch.equal(small.edge_attr[:, 2:], g.edge_attr[:, 2:])
    assert torch.allclose((small.pos - 16.5) * 2, g.pos - 16.5)
    assert T.affine(g, 5).edge_attr.max() == 1
    assert T.affine(g, 5).edge_attr.min() == 0


@pytest.mark.parametrize("kind", KINDS)
def test_shift_moves_nodes_and_nothing_else(kind):
    g = graph(kind)
    moved = T.affine(g, dx=1.5, dy=-2)
    assert torch.allclose(moved.pos, g.pos + torch.tensor([1.5, -2.0]))
    assert torch.allclose(moved.edge_attr, g.edge_attr)


@given(st.floats(0.5, 2), st.floats(-180, 180), st.floats(-5, 5), st.floats(-5, 5), st.floats(-1, 1), st.floats(0.5, 2))
def test_affine_maps_each_event_to_the_nearest_pixel_or_drops_it(factor, degrees, dx, dy, shear, stretch):
    ev = sweep(60)
    moved = T.affine(ev, factor, degrees, dx, dy, shear, stretch)
    c, s = factor * np.cos(np.radians(degrees)), factor * np.sin(np.radians(degrees))
    expected = []
    for t, x, y, p in zip(*(c.tolist() for c in ev.columns), strict=True):
        slanted, high = x - 16.5 + shear * (y - 16.5), stretch * (y - 16.5)
        u = np.rint(c * slanted - s * high + 16.5 + dx)
        v = np.rint(s * slanted + c * high + 16.5 + dy)
        if 0 <= u < 34 and 0 <= v < 34:
            expected.append((t, int(u), int(v), p))
    assert list(zip(*(c.tolist() for c in moved.columns), strict=True)) == expected


def test_transforms_take_recordings(tmp_path):
    nvsdata.write(sweep(), tmp_path / "a.h5")
    recording = nvsdata.open(tmp_path / "a.h5")
    assert T.RadiusGraph()(recording).num_nodes == 500
    assert len(T.NonUniformSample(1)(recording)) == 500
    assert T.affine(recording) == sweep()


def test_steps_in_the_wrong_order_are_named():
    ev = sweep()
    with pytest.raises(TypeError, match="sample must be Events or a Recording, not Graph: check the order") as caught:
        T.Compose([T.RadiusGraph(), T.RandomWindow(1_000)])(ev)
    assert caught.value.__notes__ == [
        "in step 2 of the pipeline, RandomWindow(duration=1000, within=(0.0, 1.0)), given Graph"
    ]
    with pytest.raises(TypeError, match="graphs must be a Graph or a list of them, not Events"):
        T.Graph2Grid()(ev)
    with pytest.raises(TypeError, match="them, not a list of Events"):
        T.Graph2Grid()([ev])
    of_events = (
        T.NonUniformSample(),
        T.RadiusGraph(),
        T.DropEvents(),
        T.RandomAffine(),
        T.ToFrames(fps=30, values="sum"),
        T.Points(),
    )
    of_events += (T.RandomScale(), T.RandomRotate(), T.RandomTranslate())
    for transform in of_events:
        with pytest.raises(TypeError, match=r"sample must be .*, not Tensor \[2, 3\]"):
            transform(torch.zeros(2, 3))
    with pytest.raises(TypeError, match="samples must be a list, such as RandomWindows returns, not Events"):
        T.Each(T.RadiusGraph())(ev)


@pytest.mark.parametrize("duration", [float("inf"), float("nan")])
def test_no_number_of_microseconds(duration):
    with pytest.raises(ValueError, match="counts whole µs"):
        T.RandomWindow(duration)


@pytest.mark.parametrize("make", [T.RandomWindow, lambda d: T.RandomWindows(8, d), lambda d: T.Window(0, d)])
def test_seconds_in_place_of_microseconds(make):
    with pytest.raises(ValueError, match=r"counts whole µs, not 0.03 \(0.03 s are 30000\)"):
        make(0.03)


def test_a_clock_that_is_off_makes_no_millions_of_frames():
    late = Events([2**40, 2**40 + 1_000], [1, 1], [1, 1], [0, 1], (4, 4))
    assert T.ToFrames(fps=30, values="sum")(late).shape == (1, 4, 4)
    with pytest.raises(ValueError, match="which are too many: check `Events"):
        T.ToFrames(fps=30, values="sum")(late.window(0, None))


def test_compose_takes_a_list():
    with pytest.raises(TypeError, match="takes a list of transforms, not Window"):
        T.Compose(T.Window(0, 5))
