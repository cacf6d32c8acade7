"""Frames between frames: how many, where, and how close to the truth of a known motion."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from nvsdata.emulation import DVS
from nvsdata.video.frames import VideoFrame
from nvsdata.video.upsample import CHANGE, DARK, MOST, upsample_frames

GAP = 10_000  # µs
TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (160, 240)).astype(np.uint8), (0, 0), 3)
TEXTURE = cv2.normalize(TEXTURE, None, 0, 255, cv2.NORM_MINMAX)


def patch(x, background=90):
    """A textured square whose left edge is at column `x`, which may be a fraction."""
    picture = np.full((120, 200), background, np.float32)
    moved = cv2.warpAffine(TEXTURE, np.float32([[1, 0, x], [0, 1, 0]]), (200, 120), flags=cv2.INTER_LINEAR)
    inside = cv2.warpAffine(np.ones((50, 50), np.float32), np.float32([[1, 0, x], [0, 1, 30]]), (200, 120))
    return np.rint(picture * (1 - inside) + moved * inside).astype(np.uint8)


def between(a, b, how, gap=GAP):
    return list(upsample_frames(iter([VideoFrame(0, a), VideoFrame(gap, b)]), how))


@pytest.mark.parametrize("how", ["none", 1])
def test_nothing_is_added_unless_asked_for(how):
    frames = [VideoFrame(n * GAP, patch(n)) for n in range(3)]
    assert all(a is b for a, b in zip(upsample_frames(iter(frames), how), frames, strict=True))


@pytest.mark.parametrize("how", ["linear", "flow", 5])
def test_nothing_is_added_where_nothing_changes(how):
    assert len(between(patch(3), patch(3).copy(), how)) == 2


def test_a_number_of_steps_along_a_line():
    a, b = patch(3), patch(3)
    b[40:60, 20:90] = 255 - b[40:60, 20:90]
    found = between(a, b, 4)
    assert [frame.time for frame in found] == [0, 2_500, 5_000, 7_500, 10_000]
    assert [frame.whole for frame in found] == [True, False, False, False, True]
    for k, frame in enumerate(found):
        expected = a + (b.astype(float) - a) * k / 4
        assert np.abs(frame.pixels - expected).max() <= 0.5
        assert frame.pixels.dtype == np.uint8


def test_as_many_steps_as_the_largest_change_of_brightness_needs():
    a = np.full((40, 90), 100, np.uint8)
    b = a.copy()
    b[5, 7] = 10
    steps = int(np.ceil(np.log(103 / 13) / CHANGE))
    assert DARK == 3
    assert len(between(a, b, "linear")) == 1 + steps
    assert len(between(b, a, "linear")) == 1 + steps
    b[5, 7] = 90
    assert len(between(a, b, "linear")) == 2


def test_colors_and_floats_stay_what_they_are():
    a = np.random.default_rng(0).integers(0, 256, (40, 70, 3)).astype(np.uint8)
    found = between(a, 255 - a, 3)
    np.testing.assert_allclose(found[1].pixels, a + (255.0 - 2.0 * a) / 3, atol=0.5)
    found = between(a[..., 0] / 1.0, 255.0 - a[..., 0], 2)
    assert found[1].pixels.dtype == np.float64
    np.testing.assert_allclose(found[1].pixels, 127.5, atol=1e-4)


@pytest.mark.parametrize("by", [2, 6, 12])
def test_what_moves_is_found_on_its_way(by):
    found = between(patch(60), patch(60 + by), "flow")
    steps = len(found) - 1
    assert by - 1 <= steps <= 2 * by + 4
    line, flow = [], []
    for k in range(1, steps):
        truth = patch(60 + by * k / steps).astype(float)
        mixed = patch(60) + (patch(60 + by).astype(float) - patch(60)) * k / steps
        inside = slice(35, 75), slice(60 + by + 4, 106)
        line.append(np.abs(mixed - truth)[inside].mean())
        flow.append(np.abs(found[k].pixels - truth)[inside].mean())
    assert np.mean(flow) < 0.4 * np.mean(line) + 0.6
    # far from it nothing is touched
    assert all((frame.pixels[:, 180:] == 90).all() for frame in found)


def test_pictures_of_one_color_have_no_flow():
    dark, bright = np.full((30, 40), 20, np.uint8), np.full((30, 40), 200, np.uint8)
    found = between(dark, bright, "flow")
    assert len(found) == 2


def test_small_pictures_and_short_gaps():
    a, b = np.zeros((6, 5), np.uint8), np.arange(30, dtype=np.uint8).reshape(6, 5) * 8
    assert len(between(a, b, "flow")) >= 2
    times = [frame.time for frame in between(a, b, 50, gap=7)]
    assert times == list(range(8))
    assert len(between(a, b, 1_000)) == 1_001
    black, white = np.zeros((40, 70), np.uint8), np.full((40, 70), 255, np.uint8)
    # ln(258 / 3) / 0.5
    assert len(between(black, white, "linear")) == 10


def test_steps_are_by_brightness_whatever_the_bytes_of_black_and_white():
    a, b = np.full((8, 8), 16, np.uint8), np.full((8, 8), 33, np.uint8)
    studio = list(
        upsample_frames(iter([VideoFrame(0, a, levels=(16, 235)), VideoFrame(GAP, b, levels=(16, 235))]), "linear")
    )
    full = between(np.full((8, 8), 0, np.uint8), np.full((8, 8), 20, np.uint8), "linear")
    assert len(studio) == len(full) == 1 + 5


def test_flow_adds_no_more_frames_than_the_most():
    assert MOST == 64
    rng = np.random.default_rng(0)
    a, b = (cv2.GaussianBlur(rng.integers(0, 256, (90, 400)).astype(np.uint8), (0, 0), 2) for _ in range(2))
    assert 2 < len(between(a, b, "flow")) <= MOST + 1


def test_threads_do_not_disturb_each_other():
    pairs = [(patch(60), patch(60 + by)) for by in (2, 5, 9, 12)] * 3
    expected = [between(*pair, "flow") for pair in pairs]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda pair: between(*pair, "flow"), pairs))
    for one, other in zip(found, expected, strict=True):
        assert [frame.pixels.tobytes() for frame in one] == [frame.pixels.tobytes() for frame in other]


def test_two_things_that_move_apart_are_both_found():
    a, b = np.full((120, 400), 50, np.uint8), np.full((120, 400), 50, np.uint8)
    a[20:40, 10:30], b[20:40, 14:34] = 200, 200
    a[80:100, 350:370], b[80:100, 346:366] = 10, 10
    middle = between(a, b, 2)[1].pixels
    assert middle[30, 11] == middle[30, 32] == 125
    assert middle[90, 348] == middle[90, 368] == 30


def test_an_emulator_gives_a_piece_per_frame_of_the_video():
    frames = [patch(50 + 5 * n) for n in range(6)]
    plain = list(DVS().stream(frames, 100))
    pieces = list(DVS(upsample="flow").stream(frames, 100))
    assert [(piece.start, piece.end) for piece in pieces] == [(piece.start, piece.end) for piece in plain]
    assert all(len(piece) > 100 for piece in pieces[1:])
    for piece in pieces:
        assert (np.diff(piece.t) >= 0).all()
    assert len(DVS(upsample=3).emulate([frames[0]] * 9)) == 0
