"""Every transform on sensors of 346x260 and 1280x720: the last corner is treated like a sensor of its own size."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from graphs import same
from shapes import moving_square
from wide import LARGE, corners

from nvsdata import CameraModel, Events, Graph
from nvsdata import transforms as T

SIDE = 34  # of the last corner, which a small sensor stands for
SMALL = corners((SIDE, SIDE))
LAST = torch.tensor([SIDE - 1.0, SIDE - 1.0])
sizes = pytest.mark.parametrize("size", LARGE, ids=lambda size: "{}x{}".format(*size))

# what doesn't depend on where on the sensor something happens
ANYWHERE = [
    T.Window(0, 4_000),
    T.RandomWindow(4_000),
    T.RandomWindows(3, 2_000),
    T.NonUniformSample(8),
    T.DropEvents(0.3),
    T.RadiusGraph(),
    T.KNNGraph(2),
    T.MergePixels(("mean",)),
    T.NodeFeatures(T.RadiusGraph(), [T.Age(), T.Patch(3), T.PatchMean(5)]),
    T.Compose([T.NonUniformSample(4), T.RadiusGraph(), T.RandomTranslate(5)]),
    T.Compose([T.RandomWindows(2, 2_000), T.Each(T.KNNGraph())]),
    T.BackgroundActivity(500),
    T.ERGO12(),
    T.EventImage(),
    T.FilterCascade(3),
    T.FourChannels(),
    T.HotPixels(300),
    T.LeakyFrame(),
    T.MergePolarities(),
    T.BagOfEvents(3),
    T.MixedDensityStack(3),
    T.StackedHistogram(3),
    T.RandomApply(T.SelectPolarity(), 1.0),
    T.RandomChoice([T.SelectPolarity(0)]),
    T.RandomPolarityFlip(1.0),
    T.RandomRun(20),
    T.RandomTimeFlip(1.0),
    T.RandomTimeScale(),
    T.RefractoryPeriod(500),
    T.FirstOfBoxes(side=2),
    T.RateLimit(10, 2),
    T.RelativeTime(),
    T.SelectPolarity(),
    T.DropByTime(),
    T.TAF(),
    T.TimeJitter(),
    T.TimeSurface(every=1_000),
    T.ToFrames(3),
    T.VoxelGrid(3),
    T.ToFrames(fps=200, values="sum"),
    T.Compose([T.RadiusGraph(), T.Graph2Grid()]),
    T.Compose([T.ToFrames(fps=400, values="sum"), T.RandomTemporalCrop(2)]),
    T.Compose([T.ToFrames(fps=400, values="sum"), T.SlidingClips(2)]),
]
# what does
ELSEWHERE = (T.Crop, T.Downsample, T.DropByArea, T.EventSurfaces, T.HATS, T.SpatialJitter, T.TORE, T.UniformNoise)
ELSEWHERE = (*ELSEWHERE, T.Corners, T.DART, T.GroupTokens, T.PlaneFlow, T.Points)
ELSEWHERE = (*ELSEWHERE, T.RandomAffine, T.RandomFlip, T.RandomRotate, T.RandomScale, T.Undistort)
IMAGES = (T.CenterCrop, T.FourCrops, T.MedianDenoise, T.MotionCrop, T.Normalize, T.RandomCrop)
IMAGES = (*IMAGES, T.RandomFlip, T.Resize)
FEATURES = (T.Age, T.Patch, T.PatchMean, T.TimeBins)
WITHIN = (
    T.Center,
    T.Each,
    T.Graph2Grid,
    T.NodeFeatures,
    T.RandomTemporalCrop,
    T.RandomTranslate,
    T.SlidingClips,
    T.WithBoxes,
)


def in_last_corner(size):
    x, y = SMALL.x + size[0] - SIDE, SMALL.y + size[1] - SIDE
    return Events(SMALL.t, x, y, SMALL.p, size)


def corner_of(found, size):
    """What was found in the last corner, as if that were the sensor; nothing may be anywhere else."""
    if isinstance(found, list):
        return [corner_of(part, size) for part in found]
    if isinstance(found, Events):
        x, y = found.x - (size[0] - SIDE), found.y - (size[1] - SIDE)
        return Events(found.t, x, y, found.p, (SIDE, SIDE), start=found.start, end=found.stated_end)
    if isinstance(found, Graph):
        shift = torch.tensor([size[0] - SIDE, size[1] - SIDE])
        # a node lies at whole pixels, or where a shift of float32 led it
        return replace(found, pos=found.pos - shift, sensor_size=(SIDE, SIDE))
    assert found.shape[-2:] == (size[1], size[0])
    corner = found[..., -SIDE:, -SIDE:]
    assert torch.equal(found.abs().sum(dtype=torch.float64), corner.abs().sum(dtype=torch.float64))
    return corner


def agree(a, b):
    if isinstance(a, list):
        assert len(a) == len(b)
        return all(map(agree, a, b))
    if isinstance(a, Graph):
        torch.testing.assert_close(a.pos, b.pos, rtol=0, atol=1e-3)
        torch.testing.assert_close(a.edge_attr, b.edge_attr, rtol=0, atol=1e-3)
        return same(replace(a, pos=b.pos, edge_attr=b.edge_attr), b)
    return torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b


@sizes
@pytest.mark.parametrize("transform", ANYWHERE, ids=repr)
def test_the_last_corner_is_like_a_small_sensor(transform, size):
    torch.manual_seed(0)
    expected = transform(SMALL)
    torch.manual_seed(0)
    assert agree(corner_of(transform(in_last_corner(size)), size), expected)


@sizes
@pytest.mark.parametrize("axis", [0, 1])
def test_flips(size, axis):
    ev = corners(size)
    columns = [column.astype(int) for column in ev.columns]
    columns[1 + axis] = size[axis] - 1 - columns[1 + axis]
    assert T.RandomFlip(axis, p=1)(ev) == Events(*columns, size)
    graph = T.RadiusGraph()(ev)
    assert torch.equal(T.RandomFlip(axis, p=1)(graph).pos[:, axis], size[axis] - 1 - graph.pos[:, axis])


@sizes
def test_turns_and_scales_are_about_the_center(size):
    ev = corners(size)
    assert T.RandomAffine((1.0, 1.0), 0)(ev) == ev
    center = torch.tensor([(side - 1) / 2 for side in size])
    graph = T.RadiusGraph()(ev)
    torch.testing.assert_close(T.RandomScale(0.5, 0.5)(graph).pos, (graph.pos - center) / 2 + center)
    turned = T.RandomRotate(10)(graph)
    torch.testing.assert_close((turned.pos - center).norm(dim=1), (graph.pos - center).norm(dim=1), rtol=0, atol=1e-3)
    torch.testing.assert_close(T.affine(graph, degrees=180).pos, 2 * center - graph.pos, rtol=0, atol=1e-3)
    # by half a turn every event goes to the opposite pixel
    half = T.affine(ev, degrees=180)
    assert np.array_equal(half.x, size[0] - 1 - ev.x)
    assert np.array_equal(half.y, size[1] - 1 - ev.y)


@sizes
def test_points(size):
    ev = corners(size)
    points = T.Points(len(ev))(ev).double().numpy()
    assert np.rint(points[:, 0] * (size[0] - 1)).tolist() == ev.x.tolist()
    assert np.rint(points[:, 1] * (size[1] - 1)).tolist() == ev.y.tolist()


@sizes
def test_surfaces_around_events(size):
    ev = in_last_corner(size)
    assert T.EventSurfaces(3)(ev).equal(T.EventSurfaces(3)(SMALL))
    assert T.DART()(ev).equal(T.DART()(SMALL))
    assert T.PlaneFlow(8, 10**6, 5_000)(ev).equal(T.PlaneFlow(8, 10**6, 5_000)(SMALL))
    assert T.PlaneFlow(8, 10**6, 5_000)(SMALL)[:, 2].any()
    # cells begin at even pixels on all three sensors
    cells = T.HATS(2)(ev).unflatten(0, (size[1] // 2, size[0] // 2))
    corner = cells[-SIDE // 2 :, -SIDE // 2 :]
    assert corner.flatten(0, 1).equal(T.HATS(2)(SMALL))
    assert cells.count_nonzero() == corner.count_nonzero() > 0


@sizes
def test_corner_events(size):
    square = moving_square((200.0, 150.0), 8.0, 0.6, (12.0, 10.0), size=(SIDE, SIDE))
    offset = np.array(size) - SIDE
    ev = Events(square.t, square.x + offset[0], square.y + offset[1], square.p, size)
    found, expected = T.Corners()(ev), T.Corners()(square)
    # the small sensor has borders at the left and above
    found = found[(found.x >= offset[0] + 4) & (found.y >= offset[1] + 4)]
    assert corner_of(found, size) == expected
    assert len(expected) > 20


@sizes
def test_tokens(size):
    # patches begin at even pixels on all three sensors
    found = T.GroupTokens(4, 2)(in_last_corner(size))
    corner = found[:, -SIDE // 2 :, -SIDE // 2 :]
    assert corner.equal(T.GroupTokens(4, 2)(SMALL))
    assert found.count_nonzero() == corner.count_nonzero() > 0


@sizes
def test_ages(size):
    # where nothing was, ages are the longest
    found = T.TORE(2)(in_last_corner(size))
    assert found[:, -SIDE:, -SIDE:].equal(T.TORE(2)(SMALL))
    assert (found != found.max()).sum() == (T.TORE(2)(SMALL) != found.max()).sum()


@sizes
def test_places_on_the_sensor(size):
    ev, offset = in_last_corner(size), (size[0] - SIDE, size[1] - SIDE)
    assert T.Crop(*offset, SIDE, SIDE)(ev) == SMALL
    halved = T.Downsample(2)(ev)
    assert halved.sensor_size == (size[0] // 2, size[1] // 2)
    assert np.array_equal(halved.x - offset[0] // 2, SMALL.x // 2)
    assert np.array_equal(halved.y - offset[1] // 2, SMALL.y // 2)
    shifted = T.Undistort(CameraModel(size, (200.0, 200.0, 0.0, 0.0), new_intrinsics=(200.0, 200.0, -9.0, -7.0)))(ev)
    assert np.array_equal(shifted.x, ev.x - 9)
    assert np.array_equal(shifted.y, ev.y - 7)
    torch.manual_seed(0)
    spread = T.UniformNoise(5_000)(ev)
    assert (spread.x.max(), spread.y.max()) >= (size[0] - 9, size[1] - 9)
    shaken = T.SpatialJitter(3)(ev)
    assert abs(shaken.x.mean() - ev.x.mean()) < 4
    assert shaken.x.max() == size[0] - 1
    # a rectangle of all but a strip at two sides leaves some of the last corner, mostly
    left = {len(T.DropByArea(0.97)(ev)) for _ in range(100)}
    assert min(left) < len(ev)
    assert len(left) > 5


@sizes
def test_images(size):
    width, height = size
    image = T.EventImage()(in_last_corner(size))
    corner = image[:, -SIDE:, -SIDE:]
    assert torch.equal(T.MotionCrop(SIDE)(image), corner)
    four = T.FourCrops(SIDE)(image)
    assert torch.equal(four[0], corner)
    assert torch.equal(four[1], corner.flip(-1))
    assert four[2:].count_nonzero() == 0
    assert torch.equal(T.RandomFlip(0, 1)(image)[:, -SIDE:, :SIDE], corner.flip(-1))
    small = T.EventImage()(SMALL)
    assert torch.equal(T.MedianDenoise()(image)[:, -SIDE:, -SIDE:], T.MedianDenoise()(small))
    ramp = torch.arange(float(width)) + 10_000 * torch.arange(float(height))[:, None]
    place = T.CenterCrop(200)(ramp)[0, 0]
    assert place == (width - 200) // 2 + 10_000 * ((height - 200) // 2)
    corners_of_crops = torch.stack([T.RandomCrop(200)(ramp)[0, 0] for _ in range(300)])
    x, y = corners_of_crops % 10_000, corners_of_crops // 10_000
    for places, room in ((x, width - 200), (y, height - 200)):
        assert places.min() < 0.05 * room
        assert 0.95 * room < places.max() <= room
    resized = T.Resize(130)(ramp)
    assert resized.shape == (130, round(width * 130 / height))
    assert resized.mean().item() == pytest.approx(ramp.mean().item(), rel=1e-3)
    normal = T.Normalize()(image)
    assert normal.mean().abs() < 1e-4
    assert normal[0, 0, 0] == normal.min() < 0


def test_every_transform_was_there():
    exported = {thing for name in T.__all__ if isinstance(thing := getattr(T, name), type)}
    assert exported == {*map(type, ANYWHERE), *ELSEWHERE, *IMAGES, *FEATURES, *WITHIN}
