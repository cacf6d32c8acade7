"""Boxes that move along with events and images."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from test_deterministic import EVENTS, EXAMPLES

import nvsdata
from nvsdata import CameraModel, Events
from nvsdata import transforms as T
from nvsdata.data.boxes import Boxes

WIDTH, HEIGHT = 60, 40
BOX = (20, 12, 33, 25)  # left, top, right and bottom edge
# what moves a sample, and whether its box stays as tight as it was
MOVING = [
    (T.RandomFlip(0, 1.0), True),
    (T.RandomFlip(1, 1.0), True),
    (T.RandomScale(0.5, 0.9), True),
    (T.RandomScale(1.1, 1.3), True),
    (T.RandomRotate(40), False),
    (T.Center(), True),
    (T.RandomTranslate(10), True),
    (T.RandomAffine(), False),
    (T.RandomAffine((0.7, 0.9), 30, 5.0, 0.3, 0.2), False),
    (T.Crop(10, 5, 40, 30), True),
    (T.Crop(25, 15, 12, 20), True),
    (T.CenterCrop(30), True),
    (T.RandomCrop(30), True),
    (T.RandomCrop(20, (1.5,)), True),
    (T.Undistort(CameraModel((WIDTH, HEIGHT), (50.0, 50.0, 30.0, 20.0), (-0.2, 0.05, 0.0, 0.0))), False),
    (T.Resize(20), True),
    (T.Resize(77), True),
    (T.Downsample(3), True),
    (T.Compose([T.RandomFlip(0, 1.0), T.Compose([T.RandomTranslate(8), T.CenterCrop(36)])]), True),
    (T.RandomApply(T.RandomFlip(0, 1.0), 1.0), True),
    (T.RandomChoice([T.RandomFlip(0, 1.0), T.RandomFlip(1, 1.0)]), True),
]
STAYING = [
    T.BackgroundActivity(),
    T.Compose([]),
    T.Corners(),
    T.DropByArea(),
    T.DropByTime(),
    T.DropEvents(),
    T.HotPixels(),
    T.MergePolarities(),
    T.NonUniformSample(),
    T.RandomApply(T.RandomFlip(0, 1.0), 0.0),
    T.RandomFlip(0, 0.0),
    T.RandomPolarityFlip(),
    T.RandomRun(5),
    T.RandomTimeFlip(),
    T.RandomTimeScale(),
    T.RandomWindow(50),
    T.RefractoryPeriod(50),
    T.FirstOfBoxes(),
    T.RateLimit(10),
    T.RelativeTime(),
    T.SelectPolarity(),
    T.SpatialJitter(),
    T.TimeJitter(),
    T.ToFrames(3),
    T.UniformNoise(),
    T.RandomWindows(3, 20),
    T.VoxelGrid(3),
    T.Window(0, 50),
]


def filled(box=BOX):
    """An event at each pixel of a box."""
    left, top, right, bottom = box
    y, x = (axis.ravel() for axis in np.mgrid[top:bottom, left:right])
    return Events(np.arange(x.size), x, y, x % 2, (WIDTH, HEIGHT))


def target(*boxes):
    return {"boxes": torch.tensor(boxes, dtype=torch.float32).reshape(-1, 4)}


@pytest.mark.parametrize(("transform", "tight"), MOVING, ids=str)
@pytest.mark.parametrize("seed", range(5))
def test_a_box_holds_the_events_that_it_held(transform, tight, seed):
    torch.manual_seed(seed)
    sample, found = T.WithBoxes(transform)(filled(), target(BOX))
    torch.manual_seed(seed)
    assert sample == transform(filled())
    ((left, top, right, bottom),) = found["boxes"].tolist()
    # events lie at pixels' centers, and are rounded to the nearest
    x, y = sample.x + 0.5, sample.y + 0.5
    assert left - 0.5 <= x.min()
    assert x.max() <= right + 0.5
    assert top - 0.5 <= y.min()
    assert y.max() <= bottom + 0.5
    assert 0 <= left < right <= sample.sensor_size[0]
    assert 0 <= top < bottom <= sample.sensor_size[1]
    if tight:
        # half a pixel by rounding, half from the center to the edge, and what lies between scaled pixels
        slack = 0.6 + max(1, sample.sensor_size[0] / WIDTH)
        assert x.min() - left < slack
        assert right - x.max() < slack
        assert y.min() - top < slack
        assert bottom - y.max() < slack


def test_where_boxes_come_to_lie():
    def moved(transform, *boxes):
        return T.WithBoxes(transform)(filled(), target(*(boxes or (BOX,))))[1]["boxes"].tolist()

    assert moved(T.RandomFlip(0, 1.0)) == [[60 - 33, 12, 60 - 20, 25]]
    assert moved(T.RandomFlip(1, 1.0)) == [[20, 40 - 25, 33, 40 - 12]]
    assert moved(T.Crop(10, 5, 40, 30)) == [[10, 7, 23, 20]]
    assert moved(T.Crop(25, 15, 4, 20)) == [[0, 0, 4, 10]]
    assert moved(T.CenterCrop(30)) == [[5, 7, 18, 20]]
    assert moved(T.Resize(20)) == [[10, 6, 16.5, 12.5]]
    assert moved(T.Downsample(4), (4, 8, 40, 38)) == [[1, 2, 10, 9.5]]
    assert moved(T.RandomScale(0.5, 0.5)) == [[25, 16, 31.5, 22.5]]
    assert moved(T.RandomScale(2, 2)) == [[10, 4, 36, 30]]
    assert moved(T.RandomScale(4, 4)) == [[0, 0, 42, 40]]
    assert moved(T.RandomAffine((1.0, 1.0), 0.0)) == [list(BOX)]
    assert moved(T.RandomRotate(0)) == [list(BOX)]


@given(angle=st.floats(-180, 180), seed=st.integers(0, 100))
def test_a_turned_box_is_the_smallest_upright_one(angle, seed):
    boxes = Boxes.of(torch.tensor([[20.0, 12.0, 33.0, 25.0]]), (60, 40))
    (found,) = T.affine(boxes, degrees=angle).edges.tolist()
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    corners = [(x - 30, y - 20) for x in (20, 33) for y in (12, 25)]
    x, y = [c * x - s * y + 30 for x, y in corners], [s * x + c * y + 20 for x, y in corners]
    wanted = max(min(x), 0), max(min(y), 0), min(max(x), 60), min(max(y), 40)
    assert np.allclose(found, wanted, atol=1e-4)


@pytest.mark.parametrize("transform", STAYING, ids=str)
def test_what_moves_nothing_leaves_boxes_alone(transform):
    torch.manual_seed(1)
    _, found = T.WithBoxes(transform)(filled(), target(BOX))
    assert found["boxes"].tolist() == [list(BOX)]


def test_every_transform_of_events_is_tried():
    tried = {type(transform) for transform in (*(one for one, _ in MOVING), *STAYING)}
    missing = set()
    for transform, sample in EXAMPLES:
        if sample is EVENTS and type(transform) not in tried:
            result = transform(sample)
            if isinstance(result, Events) or (isinstance(result, list) and isinstance(result[0], Events)):
                missing.add(type(transform).__name__)
    assert not missing


def test_boxes_that_leave_take_their_entries_along():
    boxes = target((0, 0, 5, 5), (30, 20, 40, 30), (50, 30, 60, 40))
    given = {
        **boxes,
        "labels": torch.tensor([7, 8, 9]),
        "crowd": torch.zeros(3, 2),
        "image_id": 3,
        "all": torch.ones(2),
    }
    _, found = T.WithBoxes(T.Crop(20, 10, 40, 30))(filled(), given)
    assert found["boxes"].tolist() == [[10, 10, 20, 20], [30, 20, 40, 30]]
    assert found["labels"].tolist() == [8, 9]
    assert found["crowd"].shape == (2, 2)
    assert (found["image_id"], found["all"].tolist()) == (3, [1, 1])
    assert given["labels"].tolist() == [7, 8, 9]
    _, found = T.WithBoxes(T.Compose([T.Crop(20, 10, 40, 30), T.Crop(30, 20, 10, 10)]))(filled(), given)
    assert (found["boxes"].tolist(), found["labels"].tolist()) == ([[0, 0, 10, 10]], [9])
    _, found = T.WithBoxes(T.Crop(5, 5, 5, 5))(filled(), given)
    assert (found["boxes"].shape, found["labels"].shape) == ((0, 4), (0,))


def test_no_boxes_stay_none():
    _, found = T.WithBoxes(T.RandomFlip(0, 1.0))(filled(), target())
    assert (found["boxes"].shape, found["boxes"].dtype) == ((0, 4), torch.float32)


@pytest.mark.parametrize("boxes", [[[1, 2, 3]], [[5, 0, 4, 9]], [[0, 5, 9, 4]], [1, 2, 3, 4]])
def test_boxes_of_another_shape_are_refused(boxes):
    with pytest.raises(ValueError, match="boxes must be"):
        T.WithBoxes(T.RandomFlip())(filled(), {"boxes": torch.tensor(boxes)})


def test_a_target_without_boxes_is_refused():
    for bad in (3, {"labels": torch.tensor([1])}):
        with pytest.raises(TypeError, match="a target with boxes is needed"):
            T.WithBoxes(T.RandomFlip())(filled(), bad)
    with pytest.raises(TypeError, match="must be callable"):
        T.WithBoxes(3)


@pytest.mark.parametrize(
    ("transform", "wanted"),
    [
        (T.CenterCrop(30), [5, 7, 18, 20]),
        (T.Resize(20), [10, 6, 16.5, 12.5]),
        (T.RandomFlip(0, 1.0), [27, 12, 40, 25]),
        (T.RandomFlip(0, 0.0), [20, 12, 33, 25]),
        (T.RandomCrop(40), None),
    ],
    ids=str,
)
def test_images_move_them_too(transform, wanted):
    image = torch.zeros(2, HEIGHT, WIDTH)
    image[:, 12:25, 20:33] = 1
    for pipeline, sample in ((transform, image), (T.Compose([T.EventImage(), transform]), filled())):
        torch.manual_seed(4)
        cut, found = T.WithBoxes(pipeline)(sample, target(BOX))
        ((left, top, right, bottom),) = found["boxes"].tolist()
        if wanted is not None:
            assert [left, top, right, bottom] == wanted
        inside = cut[:, int(top) : int(np.ceil(bottom)), int(left) : int(np.ceil(right))]
        # scaled images are blurred
        assert inside.sum() > 0.95 * cut.sum() > 0


def test_a_list_moves_as_one_or_not_at_all():
    whole = T.Compose([T.RandomWindows(3, 20), T.RandomTranslate(5), T.Each(T.RandomFlip(0, 1.0))])
    parts, found = T.WithBoxes(whole)(filled(), target(BOX))
    assert len(parts) == 3
    ((left, _, right, _),) = found["boxes"].tolist()
    assert abs((left + right) / 2 - (60 - 26.5)) < 5
    with pytest.raises(ValueError, match=r"boxes can't follow RandomTranslate.* applied to each part"):
        T.WithBoxes(T.Compose([T.RandomWindows(3, 20), T.Each(T.RandomTranslate(5))]))(filled(), target(BOX))
    for apart in (T.FourCrops(20), T.MotionCrop(20)):
        with pytest.raises(ValueError, match="boxes can't follow"):
            T.WithBoxes(T.Compose([T.ToFrames(1), apart]))(filled(), target(BOX))
        # without boxes they go on as before
        T.Compose([T.ToFrames(1), apart])(filled())
    assert len(T.Each(T.RandomTranslate(5))([filled()] * 3)) == 3


def test_boxes_are_forgotten_after_an_error():
    def fails(sample):
        raise RuntimeError("no")

    with pytest.raises(RuntimeError):
        T.WithBoxes(fails)(filled(), target(BOX))
    T.FourCrops(20)(torch.zeros(1, 30, 30))


def test_only_the_window_is_decoded(tmp_path):
    t = np.arange(20_000) * 10
    nvsdata.write(Events(t, t % WIDTH, t % HEIGHT, t % 2, (WIDTH, HEIGHT)), tmp_path / "a.dat")
    recording = nvsdata.open(tmp_path / "a.dat")
    pipeline = T.WithBoxes(T.Compose([T.Window(1_000, 2_000), T.RandomFlip(0, 1.0), T.ToFrames(2)]))
    frames, found = pipeline(recording, target(BOX))
    assert frames.shape == (2, 2, HEIGHT, WIDTH)
    assert found["boxes"].tolist() == [[27, 12, 40, 25]]
    assert recording._whole is None
    assert not pipeline.deterministic
    assert T.WithBoxes(T.Window(0, 10)).deterministic


def test_coarser_frames_take_boxes_along_or_say_that_they_cannot():
    ((left, top, right, bottom),) = T.WithBoxes(
        T.Compose([T.ToFrames(fps=30, values="sum", factor=4), T.CenterCrop(8)])
    )(filled(), target(BOX))[1]["boxes"].tolist()
    # 15x10 pixels, of which the middle 8x8 are left
    assert [left, top, right, bottom] == [20 / 4 - 3, 12 / 4 - 1, 33 / 4 - 3, 25 / 4 - 1]
    pooled = T.Compose([T.ToFrames(1), torch.nn.AvgPool2d(2), T.RandomFlip(0, 1.0)])
    with pytest.raises(ValueError, match="boxes can't follow: the sample has 30x20 pixels, and the boxes are on 60x40"):
        T.WithBoxes(pooled)(filled(), target(BOX))
    pooled(filled())
    apart = T.Compose([T.RandomWindows(2, 20), T.Each(T.RandomChoice([T.Crop(0, 0, 50, 40), T.Crop(0, 0, 40, 40)]))])
    refused = 0
    for seed in range(10):
        torch.manual_seed(seed)
        try:
            T.WithBoxes(apart)(filled(), target(BOX))
        except ValueError as error:
            refused += "applied to each part" in str(error)
    assert 0 < refused < 10


@pytest.mark.parametrize(
    "transform", [T.Compose([]), T.RandomFlip(0, 0.0), T.RandomApply(T.RandomFlip(), 0.0)], ids=str
)
def test_boxes_are_cut_whether_or_not_anything_moves_them(transform):
    given = target((-10, -5, 20, 20), (50, 30, 70, 60), (5, 5, 5, 9), (70, 0, 80, 10))
    _, found = T.WithBoxes(transform)(filled(), {**given, "labels": [1, 2, 3, 4]})
    assert found["boxes"].tolist() == [[0, 0, 20, 20], [50, 30, 60, 40]]
    assert found["labels"] == [1, 2]


def test_entries_of_the_image_stay_and_those_of_boxes_go_in_any_container():
    given = {
        **target((0, 0, 5, 5), (30, 20, 40, 30)),
        "labels": [3, 4],
        "names": ("a", "b"),
        "area": np.array([25, 100]),
        "image_id": torch.tensor([7, 8]),
        "size": torch.tensor([180, 240]),
        "depth": np.arange(12).reshape(6, 2),
        "shades": torch.arange(5),
    }
    _, found = T.WithBoxes(T.Crop(20, 10, 40, 30))(filled(), given)
    assert (found["labels"], found["names"], found["area"].tolist()) == ([4], ("b",), [100])
    assert (found["image_id"].tolist(), found["size"].tolist()) == ([7, 8], [180, 240])
    assert (found["depth"].shape, found["shades"].tolist()) == ((6, 2), [0, 1, 2, 3, 4])
    for name in ("masks", "keypoints"):
        with pytest.raises(ValueError, match=f"only boxes follow a sample, not {name}"):
            T.WithBoxes(T.RandomFlip())(filled(), {**target(BOX), name: torch.zeros(1, 3)})


@pytest.mark.parametrize("make", [list, np.array, lambda box: torch.tensor(box).double()])
def test_boxes_come_in_any_form(make):
    _, found = T.WithBoxes(T.RandomFlip(0, 1.0))(filled(), {"boxes": make([list(BOX)])})
    assert found["boxes"].tolist() == [[27, 12, 40, 25]]
    assert found["boxes"].dtype == torch.float32


def test_a_list_as_sample_is_misplaced():
    with pytest.raises(TypeError, match="sample must be Events, a Recording or an image, not a list of Events"):
        T.WithBoxes(T.RandomFlip())([filled()], target(BOX))


def test_boxes_are_passed_openly():
    """Any thread can run a pipeline, and transforms of one's own say what they do to boxes."""
    from concurrent.futures import ThreadPoolExecutor

    flip = T.WithBoxes(T.Compose([T.RandomFlip(0, 1.0), T.ToFrames(1)]))
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(flip, filled(), target(BOX)).result()[1]["boxes"].tolist() == [[27, 12, 40, 25]]
    events, moved = T.RandomFlip(1, 1.0).with_boxes(filled(), Boxes.of([BOX], (WIDTH, HEIGHT)))
    assert moved.edges.tolist() == [[20, 15, 33, 28]]
    assert events == T.RandomFlip(1, 1.0)(filled())

    class Own:
        def __call__(self, sample):
            return T.RandomFlip(0, 1.0)(sample)

        def with_boxes(self, sample, boxes):
            return T.RandomFlip(0, 1.0).with_boxes(sample, boxes)

    whole = T.WithBoxes(T.Compose([T.RandomApply(Own(), 1.0), T.NodeFeatures(T.Compose([Own(), T.RadiusGraph()]), [])]))
    graph, found = whole(filled(), target(BOX))
    assert found["boxes"].tolist() == [list(BOX)]
    assert graph.num_nodes == len(filled())


def test_a_subclass_that_changes_the_call_alone_is_refused():
    class Twice(T.RandomFlip):
        def __call__(self, sample):
            return super().__call__(super().__call__(sample))

    with pytest.raises(TypeError, match="Twice overrides __call__, so it must override with_boxes, too"):
        T.WithBoxes(Twice())(filled(), target(BOX))
