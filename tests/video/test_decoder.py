from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from clips import moving_square
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.common.errors import FormatError
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.state import brightness
from nvsdata.video import decoder
from nvsdata.video.decoder import (
    ERRORS_ONLY,
    FULL,
    STUDIO,
    _opened,
    _same_contrast,
    decode_video,
    levels_of,
    logging,
    quiet,
    rgb_luminance,
    stretch_levels,
)
from nvsdata.video.frames import VideoFrame, frames_of


def clip(path, code, frames):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 25, frames[0].shape[1::-1], frames[0].ndim == 3)
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.ascontiguousarray(frame))
    writer.release()
    return path


@pytest.mark.parametrize(
    ("code", "ending", "levels"), [("MJPG", "avi", FULL), ("mp4v", "mp4", STUDIO), ("XVID", "avi", STUDIO)]
)
def test_a_file_gives_its_luma_and_what_its_values_mean(tmp_path, capfd, code, ending, levels):
    path = clip(tmp_path / f"a.{ending}", code, moving_square())
    gray, color = list(frames_of(path, color=False)), list(frames_of(path))
    assert [frame.time for frame in gray] == [frame.time for frame in color]
    assert len(gray) == 12
    for a, b in zip(gray, color, strict=True):
        assert a.pixels.ndim == 2
        assert a.levels == levels
        assert abs(brightness(a) - brightness(b)).max() < 3.5
    assert capfd.readouterr().err == ""


def test_colors_where_they_are_asked_for_or_there_is_no_luma(tmp_path):
    path = clip(tmp_path / "a.avi", "MJPG", moving_square())
    assert next(frames_of(path)).pixels.ndim == 3
    assert next(iter(PIX2NVS(hue=True).stream(path))).sensor_size == moving_square()[0].shape[1::-1]
    lossless = clip(tmp_path / "b.mkv", "FFV1", moving_square())  # blue, green, red
    found = list(frames_of(lossless, color=False))
    assert all((frame.pixels == drawn).all() for frame, drawn in zip(found, moving_square(), strict=True))


def test_in_doubt_colors_are_read_and_no_frame_is_lost(tmp_path):
    # of middle gray nobody can tell
    frames = [np.full((48, 64, 3), 113, np.uint8), *moving_square()]
    found = list(frames_of(clip(tmp_path / "a.avi", "MJPG", frames), color=False))
    assert [frame.pixels.shape for frame in found] == [(48, 64, 3)] * len(frames)
    assert [frame.time for frame in found] == [40_000 * n for n in range(len(frames))]


@given(seed=st.integers(0, 2**32 - 1), levels=st.sampled_from((FULL, STUDIO)), contrast=st.integers(0, 200))
def test_levels_are_told_by_a_picture_that_is_off_a_little(seed, levels, contrast):
    rng = np.random.default_rng(seed)
    ground = rng.integers(0, 256 - contrast)
    values = cv2.resize(rng.random((5, 7)).astype(np.float32), (64, 48)) * contrast + ground
    black, white = levels
    luma = np.clip(np.rint(values * (white - black) / 255 + black), 0, 255).astype(np.uint8)
    colors = np.repeat(np.clip(stretch_levels(luma, levels) - 1.4, 0, 255)[..., None], 3, 2).astype(np.uint8)
    # where there is next to no contrast it may stay in doubt, but is never wrong
    assert levels_of(luma, colors) in ((levels,) if contrast >= 60 else (levels, None))


def test_what_is_no_luma_of_the_picture(tmp_path):
    rng = np.random.default_rng(0)
    colors = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    luma = (colors @ np.array([0.114, 0.587, 0.299])).round().astype(np.uint8)
    assert levels_of(luma, colors) == FULL
    assert levels_of(None, colors) is None
    assert levels_of(luma[:, ::-1], colors) is None
    assert levels_of(luma[:24], colors) is None
    assert levels_of(luma.astype(np.uint16), colors) is None
    assert levels_of(colors, colors) is None


def test_warnings_are_as_they_were_after_a_stream_and_after_leaving_one(tmp_path):
    path = clip(tmp_path / "a.avi", "MJPG", moving_square())
    before = logging.getLogLevel()
    one, two = decode_video(path, False), decode_video(path, False)
    next(one), next(two)
    assert logging.getLogLevel() == ERRORS_ONLY
    one.close()
    assert logging.getLogLevel() == ERRORS_ONLY
    two.close()
    assert logging.getLogLevel() == before
    assert len(list(decode_video(path, False))) == 12
    assert logging.getLogLevel() == before


@pytest.mark.parametrize("settings", [PIX2NVS(), PIX2NVS(t_log=85), PIX2NVS(mode="LICE"), PIX2NVS(inhibition=2)])
def test_luma_is_seen_as_the_brightness_that_it_stands_for(settings):
    rng = np.random.default_rng(1)
    luma = [rng.integers(0, 256, (40, 72), dtype=np.uint8) for _ in range(4)]
    stored = [VideoFrame(40_000 * n, pixels, levels=STUDIO) for n, pixels in enumerate(luma)]
    meant = [VideoFrame(frame.time, brightness(frame)) for frame in stored]
    events = settings.emulate(stored)
    assert len(events) > 1000
    assert events == settings.emulate(meant)
    assert brightness(stored[0]).min() == 0
    assert brightness(stored[0]).max() == 255


def test_frames_of_other_levels_are_not_of_one_video():
    pixels = np.zeros((48, 64), np.uint8)
    with pytest.raises(ValueError, match="is 64x48 gray uint8, earlier ones were 64x48 gray uint8 from 16 to 235"):
        PIX2NVS().emulate([VideoFrame(0, pixels, levels=STUDIO), VideoFrame(40_000, pixels)])


@pytest.mark.parametrize(
    ("slope", "same"),
    [(1.0, True), (1.059, True), (0.941, True), (1.061, False), (0.939, False), (1.16, False), (0.84, False)],
)
def test_contrast_tells_levels_apart(slope, same):
    known = 128 + np.random.default_rng(0).normal(0, 6, 500)
    assert _same_contrast(128 + (known - known.mean()) / slope, known) == same


def test_without_contrast_nothing_is_told_apart():
    flat = np.full(500, 128.0)
    assert not _same_contrast(flat, flat)


@pytest.mark.parametrize(("contrast", "enough"), [(5.0, True), (4.99, False)])
def test_how_much_contrast_is_needed(contrast, enough):
    gray = np.array([128 - contrast, 128 + contrast] * 50)
    assert _same_contrast(gray, gray) == enough


def test_what_luma_means():
    luma = np.array([0, 16, 17, 89, 235, 255], np.uint8)
    assert stretch_levels(luma, FULL).tolist() == [0, 16, 17, 89, 235, 255]
    # as the standards for video say: 219 steps from black to white
    assert stretch_levels(luma, STUDIO) == pytest.approx([0, 0, 255 / 219, 85, 255, 255])
    assert stretch_levels(np.array([50], np.uint8), (40, 60)).tolist() == [127.5]
    assert rgb_luminance(*np.diag([1_000, 1_000, 1_000])).tolist() == [299, 587, 114]


@pytest.mark.parametrize(
    ("off", "wrong", "sure"), [(0, 0, True), (3, 0, True), (4, 0, False), (0, 10, True), (0, 11, False)]
)
def test_how_far_colors_may_be_off(off, wrong, sure):
    """By three levels, and one pixel in a hundred by more."""
    luma = np.random.default_rng(0).integers(10, 240, (25, 40), dtype=np.uint8)
    colors = np.repeat(luma[..., None] + np.uint8(off), 3, 2)
    colors[0, :wrong] = luma[0, :wrong, None] + np.uint8(15)
    assert levels_of(luma, colors) == (FULL if sure else None)


def test_of_large_pictures_some_pixels_are_enough():
    luma = np.random.default_rng(0).integers(0, 256, (300, 400), dtype=np.uint8)
    colors = np.repeat(luma[..., None], 3, 2)
    colors[1::2] = 0
    assert levels_of(luma, colors) == FULL
    # of smaller ones all
    assert levels_of(luma[:255], colors[:255]) is None


@pytest.mark.parametrize(
    ("sizes", "alone", "options"),
    [
        ([(1_024, 1_024)], False, [1]),
        ([(1_024, 1_025), (1_024, 1_025)], False, [1, None]),
        ([(1_025, 1_024), (1_025, 1_024)], False, [1, None]),
        ([(4_000, 3_000)], True, [1]),
        ([None, (64, 48)], True, [1, None]),
        ([None, None], False, [1, None]),
    ],
)
def test_small_frames_are_decoded_in_one_thread(monkeypatch, tmp_path, sizes, alone, options):
    asked = []

    def opened(path, backend, given):
        size = sizes[len(asked)]
        asked.append(given)
        known = {cv2.CAP_PROP_FRAME_WIDTH: (size or (0, 0))[0], cv2.CAP_PROP_FRAME_HEIGHT: (size or (0, 0))[1]}
        return SimpleNamespace(isOpened=lambda: size is not None, get=known.get)

    monkeypatch.setattr(decoder, "in_one_thread", lambda: alone)
    monkeypatch.setattr(cv2, "VideoCapture", opened)
    if sizes[-1] is None:
        with pytest.raises(FormatError, match="contains no video that OpenCV can decode"):
            _opened(tmp_path)
    else:
        assert _opened(tmp_path)[1] == asked[-1]
    assert asked == [[] if count is None else [cv2.CAP_PROP_N_THREADS, count] for count in options]


@pytest.mark.parametrize("level", [4, 1])
def test_warnings_are_silenced_until_the_last_stream_ends(level):
    before = logging.setLogLevel(level)
    try:
        with quiet():
            with quiet():
                assert logging.getLogLevel() == ERRORS_ONLY == 2
            assert logging.getLogLevel() == 2
        assert logging.getLogLevel() == level
    finally:
        logging.setLogLevel(before)
