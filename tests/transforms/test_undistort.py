"""Removal of lens distortion against OpenCV, and the rule by which events move to whole pixels against a slow loop."""

import os
import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from graphs import same
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import events

from nvsdata import CameraModel, Events, FormatError, models
from nvsdata import transforms as T
from nvsdata.data.events import Columns
from nvsdata.data.samples import Frame
from nvsdata.kernels.represent.moves import move_events, move_table

SIZE = WIDTH, HEIGHT = 34, 30
MATRIX = np.array([[28.0, 0, 16], [0, 27, 15.5], [0, 0, 1]])
BARREL = CameraModel(SIZE, (28.0, 27.0, 16.0, 15.5), (-0.3, 0.08, 1e-3, -2e-3))
TURN = cv2.Rodrigues(np.array([0.02, -0.03, 0.05]))[0]
CAMERAS = {
    "barrel": BARREL,
    "pincushion": replace(BARREL, distortion=(0.3, 0.1, 0.0, 0.0, 0.0)),
    "fisheye": replace(BARREL, distortion=(0.05, 0.01, -0.01, 0.0), distortion_model="equidistant"),
    "rectified": replace(BARREL, rectification=TURN, new_intrinsics=(25.0, 25.0, 16.0, 15.0)),
    "three times as large": replace(BARREL, new_intrinsics=(90.0, 90.0, 16.0, 15.0)),
    "a third": replace(BARREL, new_intrinsics=(9.0, 9.0, 16.0, 15.0)),
    "folded": replace(BARREL, distortion=(-0.9, 0.0, 0.0, 0.0)),
}
each = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
PLAIN = CameraModel(SIZE, (28.0, 27.0, 16.0, 15.5))


def uniform_field(repeats, size=SIZE):
    """`repeats` events at each pixel, at different times."""
    y, x = (np.tile(grid.ravel(), repeats) for grid in np.mgrid[: size[1], : size[0]])
    return Events(np.arange(x.size), x, y, np.arange(x.size) % 2, size)


def slow_targets(camera, x, y):
    """The pixels to which events of pixel (x, y) may go."""
    own = []
    for row in range(HEIGHT):
        for column in range(WIDTH):
            u, v = (float(one[0]) for one in camera.distorted([column], [row]))
            if (round(u), round(v)) == (x, y) if np.isfinite(u + v) else False:
                back = np.array(camera.undistorted([u], [v]))[:, 0]
                if np.abs(back - (column, row)).max() < 0.5:
                    own.append((column, row))
    if own:
        return own
    u, v = (float(one[0]) for one in camera.undistorted([x], [y]))
    if np.isfinite(u + v) and 0 <= round(u) < WIDTH and 0 <= round(v) < HEIGHT:
        return [(round(u), round(v))]
    return []


@each
def test_events_go_to_pixels_whose_center_is_in_their_own_or_to_the_nearest(camera):
    for x, y in ((0, 0), (16, 15), (33, 29), (3, 20), (30, 8), (10, 1)):
        n = 60
        found = T.Undistort(camera)(Events(np.arange(n) * 7, [x] * n, [y] * n, [0, 1] * (n // 2), SIZE))
        allowed = slow_targets(camera, x, y)
        assert len(found) == (n if allowed else 0)
        assert set(zip(found.x.tolist(), found.y.tolist(), strict=True)) == set(allowed)


@each
def test_a_uniform_field_leaves_no_pixel_empty_that_the_camera_saw(camera):
    field = uniform_field(200)
    found = T.Undistort(camera)(field)
    counts = np.zeros((HEIGHT, WIDTH), int)
    np.add.at(counts, (found.y, found.x), 1)
    y, x = (grid.ravel() for grid in np.mgrid[:HEIGHT, :WIDTH])
    u, v = camera.distorted(x, y)
    with np.errstate(invalid="ignore"):
        covered = (u > -0.49) & (u < WIDTH - 0.51) & (v > -0.49) & (v < HEIGHT - 0.51)
    covered &= np.abs(np.stack(camera.undistorted(u, v)) - (x, y)).max(0) < 0.4
    assert covered.sum() > 50
    assert (counts.ravel()[covered] > 0).all()
    # rounding of each event's position leaves holes in what is stretched
    if camera is CAMERAS["three times as large"]:
        u, v = np.rint(camera.undistorted(field.x, field.y))
        inside = (u >= 0) & (u < WIDTH) & (v >= 0) & (v < HEIGHT)
        assert len(set(zip(u[inside], v[inside], strict=True))) < covered.sum() / 4


@each
def test_events_are_near_the_positions_of_opencv(camera):
    """Half a pixel of the original image, or of the new one, away."""
    field = uniform_field(3)
    at = np.arange(len(field))
    moved = T.Undistort(camera)(Events(at, field.x, field.y, field.p, SIZE))
    u, v = camera.undistorted(field.x[moved.t], field.y[moved.t])
    seen_x, seen_y = camera.distorted(moved.x, moved.y)
    in_new = np.maximum(np.abs(moved.x - u), np.abs(moved.y - v)) <= 0.5
    in_old = np.maximum(np.abs(seen_x - field.x[moved.t]), np.abs(seen_y - field.y[moved.t])) <= 0.5001
    assert (in_new | in_old).all()


@each
@given(ev=events(width=WIDTH, height=HEIGHT), cut=st.integers(0, 200_000))
@settings(max_examples=30)
def test_no_event_is_duplicated_or_changed_otherwise(camera, ev, cut):
    transform = T.Undistort(camera)
    numbered = Events(np.arange(len(ev)), ev.x, ev.y, ev.p, SIZE)
    found = transform(numbered)
    assert (np.diff(found.t) > 0).all()
    assert (found.p == ev.p[found.t]).all()
    if len(found):
        Events(*found.columns, SIZE)
    # dropped are the events of pixels without any target
    lost = np.setdiff1d(numbered.t, found.t)
    assert not len(transform(numbered[lost]))
    # a window of the result is the result of the window
    whole, window = transform(ev), transform(ev.window(cut, cut + 50_000))
    assert whole.window(cut, cut + 50_000) == window


@given(events(width=WIDTH, height=HEIGHT))
def test_without_distortion_nothing_changes(ev):
    transform = T.Undistort(PLAIN)
    found = transform(ev)
    assert found == ev
    assert (found.start, found.stated_end) == (ev.start, ev.stated_end)
    none = T.Undistort(replace(PLAIN, distortion=(0.0,) * 14, rectification=np.eye(3)))
    assert none(ev) == ev


def test_targets_of_one_pixel_get_about_as_many_events_each():
    n = 9_000
    found = T.Undistort(CAMERAS["three times as large"])(
        Events(np.arange(n) * 1_000, [16] * n, [15] * n, [1] * n, SIZE)
    )
    _, counts = np.unique(np.stack((found.x, found.y)), axis=1, return_counts=True)
    assert len(counts) in range(6, 17)
    assert counts.min() > 0.8 * n / len(counts)
    assert counts.max() < 1.2 * n / len(counts)


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int16, torch.float32, torch.float64], ids=str)
def test_images_are_those_of_opencv(dtype):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    smooth = 100 + 60 * np.sin(x / 5) * np.cos(y / 4)
    images = torch.from_numpy(np.stack((smooth, 255 - smooth))).to(dtype)
    found = T.Undistort(BARREL)(images[None])
    assert found.shape == (1, 2, HEIGHT, WIDTH)
    assert found.dtype == dtype
    for image, one in zip(images, found[0], strict=True):
        expected = cv2.undistort(image.numpy(), MATRIX, np.array(BARREL.distortion))
        # cv2.undistort rounds positions to 1/32 of a pixel
        assert np.abs(one.numpy().astype(float) - expected).max() < 2
    fisheye = CAMERAS["fisheye"]
    expected = cv2.fisheye.undistortImage(images[0].numpy(), MATRIX, np.array(fisheye.distortion), Knew=MATRIX)
    if dtype == torch.uint8:
        assert np.abs(T.Undistort(fisheye)(images[0]).numpy().astype(float) - expected).max() < 2


def test_images_of_other_types_are_refused():
    for dtype in (torch.int64, torch.bool):
        with pytest.raises(TypeError, match="sample must be images of uint8, int16, float32 or float64"):
            T.Undistort(BARREL)(torch.zeros(3, HEIGHT, WIDTH, dtype=dtype))
    assert T.Undistort(BARREL)(torch.zeros(0, HEIGHT, WIDTH)).shape == (0, HEIGHT, WIDTH)


def test_frames_of_the_camera():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pixels = (30_000 + 20_000 * np.sin(x / 5) * np.cos(y / 4)).astype(np.uint16)
    found = T.Undistort(BARREL)(Frame(1, 2, 3, 4, 0, 0, pixels))
    assert (found.start, found.exposure_start, found.exposure_end, found.end, found.x, found.y) == (1, 2, 3, 4, 0, 0)
    assert found.pixels.dtype == np.uint16
    expected = cv2.undistort(pixels, MATRIX, np.array(BARREL.distortion)).astype(float)
    # cv2.undistort rounds positions to 1/32 of a pixel; the steepest slope is 4,000 per pixel
    assert np.abs(found.pixels - expected).max() < 4_000 / 16
    # part of the sensor
    part = T.Undistort(BARREL)(Frame(1, 2, 3, 4, 5, 6, pixels[6:20, 5:30]))
    inner = (slice(10, 16), slice(10, 25))
    assert (part.pixels[inner] == found.pixels[inner]).all()
    assert (part.pixels[:3] == 0).all()
    with pytest.raises(ValueError, match=r"34x30 pixels, but the frame has 34x30 pixels from \(1, 0\) on"):
        T.Undistort(BARREL)(Frame(1, 2, 3, 4, 1, 0, pixels))


@each
def test_images_of_events_and_events_of_images_agree(camera):
    """A blob of events has the center of the blob in the image."""
    y, x = np.mgrid[12:17, 13:20]
    blob = Events(np.arange(35), x.ravel(), y.ravel(), [1] * 35, SIZE)
    many = Events(np.arange(3500), np.tile(blob.x, 100), np.tile(blob.y, 100), [1] * 3500, SIZE)
    found = T.Undistort(camera)(many)
    image = torch.zeros(HEIGHT, WIDTH)
    image[12:17, 13:20] = 1
    moved = T.Undistort(camera)(image).numpy()
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    center = (moved * columns).sum() / moved.sum(), (moved * rows).sum() / moved.sum()
    assert np.abs(np.array(center) - (found.x.mean(), found.y.mean())).max() < 0.6


def test_nodes_of_graphs_have_positions_between_pixels():
    ev = uniform_field(1).window(200, 700)
    graph = T.RadiusGraph(3.0)(ev)
    found = T.Undistort(CAMERAS["rectified"])(graph)
    expected = np.stack(CAMERAS["rectified"].undistorted(*graph.pos.numpy().T), 1)
    np.testing.assert_allclose(found.pos.numpy(), expected, atol=1e-4)
    assert same(found, graph.moved(found.pos))
    assert same(T.Undistort(CAMERAS["rectified"])([graph])[0], found)
    with pytest.raises(ValueError, match="nodes have no position without distortion: undistort the events instead"):
        T.Undistort(CAMERAS["folded"])(T.RadiusGraph(3.0)(uniform_field(1)))


@pytest.mark.parametrize("name", [name for name in CAMERAS if name != "folded"])
def test_a_box_contains_the_events_that_it_contained(name):
    camera = CAMERAS[name]
    y, x = (grid.ravel() for grid in np.mgrid[4:26, 5:29])
    inner = Events(np.arange(x.size), x, y, x % 2, SIZE)
    moved, target = T.WithBoxes(T.Undistort(camera))(inner, {"boxes": torch.tensor([[5.0, 4.0, 29.0, 26.0]])})
    ((left, top, right, bottom),) = target["boxes"].tolist()
    assert left - 0.5 <= moved.x.min() + 0.5
    assert moved.x.max() + 0.5 <= right + 0.5
    assert top - 0.5 <= moved.y.min() + 0.5
    assert moved.y.max() + 0.5 <= bottom + 0.5


def test_a_box_where_the_model_has_no_solution_is_dropped():
    boxes = {"boxes": torch.tensor([[0.0, 0.0, 2.0, 2.0], [12.0, 10.0, 20.0, 20.0]])}
    _, target = T.WithBoxes(T.Undistort(CAMERAS["folded"]))(uniform_field(1), boxes)
    assert len(target["boxes"]) == 1
    assert target["boxes"][0, 0] < 12


def test_a_box_bulges_with_its_sides():
    """The sides of a box in a barrel image bend, so its corners alone aren't enough."""
    camera = CAMERAS["pincushion"]
    _, target = T.WithBoxes(T.Undistort(camera))(uniform_field(1), {"boxes": torch.tensor([[2.0, 2.0, 32.0, 28.0]])})
    left = target["boxes"][0, 0].item()
    assert left + 0.3 < camera.undistorted([1.5], [1.5])[0][0] + 0.5
    assert left == pytest.approx(camera.undistorted([1.5], [14.5])[0][0] + 0.5, abs=0.1)


def test_a_sample_of_another_size_is_refused():
    message = "the calibration has a sensor_size of 34x30 pixels, but the sample has 40x30"
    other = Events([0], [39], [29], [1], (40, 30))
    for sample in (other, torch.zeros(30, 40), T.RadiusGraph()(other), [other]):
        with pytest.raises(ValueError, match=message):
            T.Undistort(BARREL)(sample)


def test_a_file_is_read_when_the_transform_is_made(tmp_path):
    path = tmp_path / "chain.yaml"
    path.write_text(
        "cam0: {camera_model: pinhole, intrinsics: [28, 27, 16, 15.5], distortion_model: radtan,"
        " distortion_coeffs: [-0.3, 0.08, 1e-3, -2e-3], resolution: [34, 30]}\n"
    )
    transform = T.from_repr(f"Compose([Undistort({os.fspath(path)!r}), Window(0, 500)])")
    assert transform.transforms[0] == T.Undistort(BARREL) == T.Undistort(path, name="cam0")
    path.unlink()
    # the transform no longer needs the file
    assert T.from_repr(repr(transform)) == pickle.loads(pickle.dumps(transform)) == transform
    ev = uniform_field(1)
    assert transform(ev) == T.Window(0, 500)(T.Undistort(BARREL)(ev))
    assert replace(transform.transforms[0]) == T.Undistort(BARREL)


def test_names_of_cameras(tmp_path):
    path = tmp_path / "chain.yaml"
    one = "{camera_model: pinhole, intrinsics: [28, 27, 16, 15.5], distortion_model: none, resolution: [34, 30]}"
    path.write_text(f"cam0: {one}\ncam1: {one}\n")
    with pytest.raises(FormatError, match="choose one by its name, of cam0, cam1"):
        T.Undistort(path)
    assert T.Undistort(path, "cam1").camera == PLAIN
    with pytest.raises(TypeError, match="camera must be a CameraModel or the path of a calibration file, not 3"):
        T.Undistort(3)
    with pytest.raises(ValueError, match="name chooses a camera of a file"):
        T.Undistort(PLAIN, "cam1")


def test_a_saved_network_contains_the_camera(tmp_path):
    transform = T.Compose([T.Undistort(CAMERAS["rectified"]), T.RadiusGraph()])
    network = models.RGCNN(3, sensor_size=SIZE, channels=(4,), clusters=((2, 2),), hidden=4)
    models.save(network, tmp_path / "net.safetensors", classes=["a", "b", "c"], transform=transform)
    assert models.load(tmp_path / "net.safetensors").transform == transform


class Fields(torch.utils.data.Dataset):
    transform = T.Undistort(BARREL)

    def __len__(self):
        return 2

    def __getitem__(self, index):
        return self.transform(uniform_field(index + 1)).torch()


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_workers_of_a_data_loader(context):
    loader = torch.utils.data.DataLoader(Fields(), batch_size=None, num_workers=1, multiprocessing_context=context)
    for found, expected in zip(loader, map(Fields().__getitem__, range(2)), strict=True):
        assert all(torch.equal(found[name], expected[name]) for name in "txyp")


@pytest.mark.parametrize("lists", [[], [0, 1, 1], [3, 1, 1], [2**32 - 1, 1, 1]], ids=str)
def test_the_kernel_refuses_lists_that_reach_beyond_the_end(lists):
    table = np.full((1, 5), 2 << 30, np.uint32)
    ev = Events([0], [1], [0], [1], (5, 1))
    with pytest.raises(IndexError, match="a table reaches beyond its targets"):
        move_events(*ev.columns, table, np.array(lists, np.uint32), Columns.empty(2))
    with pytest.raises(ValueError, match="shapes"):
        move_events(*ev.columns, table, np.array([2, 1, 1], np.uint32), Columns.empty(1))


@given(st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), max_size=40))
def test_events_of_a_pixel_get_all_its_targets(pairs):
    pixels, targets = np.array(pairs, np.int64).reshape(-1, 2).T
    table, lists = move_table(pixels, targets, (3, 4))
    ev = uniform_field(300, (4, 3))
    out = Columns.empty(len(ev) + 1)
    found = out.first(move_events(*Events(np.arange(len(ev)), *ev.columns[1:], (4, 3)).columns, table, lists, out))
    origin = ev.y[found.t] * 4 + ev.x[found.t]
    assert set(zip(origin.tolist(), (found.y * 4 + found.x).tolist(), strict=True)) == set(pairs)
    assert set(origin) == {pixel for pixel, _ in pairs}
