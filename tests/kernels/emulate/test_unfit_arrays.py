"""Arrays and settings that don't fit, and arrays that are too short for what fires."""

import numpy as np
import pytest

from nvsdata.emulation import DVS, PIX2NVS
from nvsdata.emulation.dvs_state import DVSState
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.kernels.emulate.crossings import advance, advance_receptors
from nvsdata.kernels.emulate.pix2nvs import contrast, luminance, mark_tiles, step
from nvsdata.video.frames import VideoFrame

SHAPE = 20, 70
FRAME = np.zeros((SHAPE[0], 3 * SHAPE[1]), np.uint8)
KEYS = np.empty(9, np.uint64)


def emulator(**settings):
    return PIX2NVSState(PIX2NVS(**settings), VideoFrame(0, FRAME.reshape(*SHAPE, 3)))


def pixel_array(**settings):
    return DVSState(DVS(**settings), VideoFrame(0, FRAME.reshape(*SHAPE, 3)))


def parts(run):
    return run._rule, run._tiles, run._pixels


def shorter(array):
    return array[:-1].copy()


def test_what_fits_is_processed():
    run = emulator()
    for frame in (FRAME, FRAME[:0]):
        assert step(frame, FRAME, 299, *parts(run), 1, 0, KEYS)[1] == 0
    receptors = pixel_array(cutoff=10)
    given = FRAME, FRAME, 299, np.empty((0, 0))
    assert advance_receptors(*given, receptors._sensor, receptors._array, 0, 1, KEYS)[1] == 0


@pytest.mark.parametrize("name", ["dirty", "affected", "active", "still", "behind"])
def test_tiles_must_fit_pixels(name):
    rule, tiles, pixels = parts(emulator(mode="CE"))
    tiles = tiles._replace(**{name: shorter(getattr(tiles, name))})
    with pytest.raises(ValueError, match="pixels"):
        step(FRAME, FRAME, 299, rule, tiles, pixels, 1, 0, KEYS)
    with pytest.raises(ValueError, match="pixels"):
        mark_tiles(FRAME, FRAME, rule, tiles, pixels)


@pytest.mark.parametrize("name", ["plane", "level", "reference", "difference"])
def test_pixels_must_fit_each_other(name):
    rule, tiles, pixels = parts(emulator())
    pixels = pixels._replace(**{name: np.ascontiguousarray(getattr(pixels, name)[:, 1:])})
    with pytest.raises(ValueError, match="pixels"):
        step(FRAME, FRAME, 299, rule, tiles, pixels, 1, 0, KEYS)


@pytest.mark.parametrize(
    "change",
    [
        {"method": 3},
        {"method": -1},
        {"side": 0},
        {"side": -8},
        {"threshold": 0.0},
        {"threshold": -1.0},
        {"threshold": np.nan},
        {"most": 0},
        {"timing": 3},
        {"timing": -1},
        {"sensitivity": np.ones((SHAPE[0], SHAPE[1] - 1), np.float32)},
        {"table": np.zeros(256, np.float32)},
    ],
)
def test_rules_out_of_range_are_refused(change):
    rule, tiles, pixels = parts(emulator())
    with pytest.raises(ValueError, match=r"range|method|pixels|blocks|table"):
        step(FRAME, FRAME, 299, rule._replace(**change), tiles, pixels, 1, 0, KEYS)


@pytest.mark.parametrize(("weight", "span"), [(-1, 1), (414, 1), (299, 0), (299, -5), (299, 2**31)])
def test_weights_and_spans_out_of_range_are_refused(weight, span):
    with pytest.raises(ValueError, match=r"weights|range"):
        step(FRAME, FRAME, weight, *parts(emulator()), span, 0, KEYS)


@pytest.mark.parametrize("rows", [0, 4, 12])
def test_bands_must_consist_of_whole_tiles(rows):
    rule, tiles, pixels = parts(emulator())
    with pytest.raises(ValueError, match="whole tiles"):
        step(FRAME, FRAME, 299, rule, tiles, pixels._replace(difference=pixels.difference[:rows]), 1, 0, KEYS)


def test_bands_are_for_pixels_that_do_not_look_at_others():
    rule, tiles, pixels = parts(emulator(difference="average"))
    with pytest.raises(ValueError, match="whole tiles"):
        step(FRAME, FRAME, 299, rule, tiles, pixels._replace(difference=pixels.difference[:16]), 1, 0, KEYS)


@pytest.mark.parametrize("frame", [FRAME[1:], FRAME[:, 3:], FRAME[:, :140], FRAME[:, :71], np.zeros((20, 0), np.uint8)])
def test_frames_must_fit_pixels(frame):
    rule, tiles, pixels = parts(emulator())
    for given in ((frame, FRAME), (FRAME, frame), (frame, frame)):
        with pytest.raises(ValueError, match=r"frames|bytes?"):
            step(*given, 299, rule, tiles, pixels, 1, 0, KEYS)
    with pytest.raises(ValueError, match=r"frames|bytes?"):
        luminance(frame, 299, rule, tiles.dirty, pixels.plane)


def test_gray_frames_need_a_table():
    rule, tiles, pixels = parts(emulator())
    with pytest.raises(ValueError, match="table is too short"):
        luminance(FRAME[:, : SHAPE[1]], 299, rule._replace(table=np.zeros(255, np.float32)), tiles.dirty, pixels.plane)


def test_contrast_is_of_doubles_of_one_shape():
    plane, tiles = np.zeros(SHAPE), np.ones((3, 2), bool)
    with pytest.raises(ValueError, match="shape"):
        contrast(plane, tiles, True, 0, 1, np.zeros((SHAPE[0], SHAPE[1] + 1)))
    with pytest.raises(ValueError, match="tiles"):
        contrast(plane, tiles[1:], True, 0, 1, plane.copy())
    with pytest.raises(TypeError):
        contrast(plane.astype(np.float32), tiles, True, 0, 1, plane.copy())


@pytest.mark.parametrize("process", [advance, advance_receptors])
@pytest.mark.parametrize(
    ("before", "now", "sensor", "array"),
    [
        (-1, 1, {}, {}),
        (1, 1, {}, {}),
        (2, 1, {}, {}),
        (0, 2**31, {}, {}),
        (2**62 - 1, 2**62, {}, {}),
        (0, 1, {"thresholds": np.ones(3)}, {}),
        (0, 1, {"thresholds": np.zeros(2)}, {}),
        (0, 1, {"thresholds": np.array([1, np.nan])}, {}),
        (0, 1, {"each": np.ones((2, SHAPE[0], SHAPE[1] - 1))}, {}),
        (0, 1, {"each": np.ones((1, *SHAPE))}, {}),
        (0, 1, {"leak": -1.0}, {}),
        (0, 1, {"dark": -1}, {}),
        (0, 1, {"dark": 2**31}, {}),
        (0, 1, {"table": np.zeros(255)}, {}),
        (0, 1, {}, {"memory": np.zeros((SHAPE[0], SHAPE[1] - 1))}),
        (0, 1, {}, {"dirty": np.zeros((2, 2), bool)}),
        (0, 1, {}, {"wake": np.zeros((3, 1), np.int64)}),
    ],
)
def test_sensors_out_of_range_are_refused(process, before, now, sensor, array):
    run = pixel_array(cutoff=10)
    with pytest.raises(ValueError, match=r"range|rise|pixels|tiles|table"):
        process(
            *(FRAME, FRAME, 299, np.empty((0, 0))),
            *(run._sensor._replace(**sensor), run._array._replace(**array)),
            *(before, now, KEYS),
        )


@pytest.mark.parametrize("process", [advance, advance_receptors])
@pytest.mark.parametrize("threshold", [0.0, -1.0])
def test_thresholds_of_pixels_are_above_0(process, threshold):
    run = pixel_array(cutoff=10)
    array = run._array._replace(level=np.full(SHAPE, 9.0), dirty=np.ones((3, 2), bool))
    sensor = run._sensor._replace(each=np.full((2, *SHAPE), threshold))
    with pytest.raises(ValueError, match="thresholds must be above 0"):
        process(FRAME, FRAME ^ 255, 299, np.empty((0, 0)), sensor, array, 4, 6, KEYS)


@pytest.mark.parametrize(
    "array",
    [
        {"reached": np.zeros((SHAPE[0], 1))},
        {"speed": np.zeros((1, SHAPE[1]))},
        {"since": np.zeros((3, 1), np.int64)},
        {"since": np.full((3, 2), 5)},
        {"since": np.full((3, 2), -(2**63))},
    ],
)
def test_receptors_out_of_range_are_refused(array):
    run = pixel_array(cutoff=10)
    given = FRAME, FRAME, 299, np.empty((0, 0))
    with pytest.raises(ValueError, match=r"pixels|future"):
        advance_receptors(*given, run._sensor, run._array._replace(**array), 4, 6, KEYS)


def test_light_that_is_not_finite_ends():
    run = pixel_array(cutoff=10, leak=0.1)
    for k, light in enumerate((np.inf, np.nan, 0.0, -np.inf, 1.0)):
        given = 299, np.full(SHAPE, light), run._sensor, run._array
        advance_receptors(FRAME, FRAME ^ 1, *given, 2 * k, 2 * k + 1, KEYS)
        advance_receptors(FRAME, FRAME, *given, 2 * k + 1, 2 * k + 2, KEYS)


@pytest.mark.parametrize("room", [0, 1, 100])
@pytest.mark.parametrize("make", [emulator, pixel_array, lambda: pixel_array(cutoff=1_000)])
def test_keys_without_room_are_returned_in_a_longer_array(make, room):
    frames = [FRAME.reshape(*SHAPE, 3), np.full((*SHAPE, 3), 200, np.uint8), FRAME.reshape(*SHAPE, 3)]
    found = []
    for size in (50_000, room):
        run = make()
        for _ in range(len(run._keys)):
            run._keys.rotate()
            run._keys[0] = np.empty(size, np.uint64)
        found.append([run.step(VideoFrame(40_000 * k, frame)).keys.copy() for k, frame in enumerate(frames[1:], 1)])
    assert all(a.size > 3 * room and (a == b).all() for a, b in zip(*found, strict=True))
