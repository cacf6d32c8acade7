"""Which part of a video is seen, and how frames of one shape come into another."""

from math import inf

import numpy as np
import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata import PIX2NVS
from nvsdata.cli import main
from nvsdata.emulation.convert import convert_videos
from nvsdata.video.frames import frames_of
from nvsdata.video.view import VideoView

WIDE = np.full((90, 160, 3), 200, np.uint8)


def shaped(frame, size, **how):
    return VideoView(**how).fit_frame(frame, size)


def test_a_wide_frame_in_a_narrow_size():
    padded = shaped(WIDE, (80, 60))
    assert padded.shape == (60, 80, 3)
    # 80x45 in the middle, black above and below
    rows = np.flatnonzero(padded[:, 40, 0])
    assert (rows[0], rows[-1]) == (7, 51)
    assert (padded[7:52] == 200).all()
    assert (padded[:7] == 0).all() and (padded[52:] == 0).all()  # noqa: PT018
    assert (shaped(WIDE, (80, 60), fit="crop") == 200).all()
    assert (shaped(WIDE, (80, 60), fit="stretch") == 200).all()
    assert VideoView().fit_frame(WIDE, (80, 60), 16)[0, 0].tolist() == [16, 16, 16]


def test_what_is_cropped_keeps_its_shape():
    """A circle stays a circle, but for stretching."""
    y, x = np.mgrid[:120, :240]
    disc = np.where((x - 120) ** 2 + (y - 60) ** 2 < 40**2, 255, 0).astype(np.uint8)
    for fit, round_ in (("pad", True), ("crop", True), ("stretch", False)):
        seen = shaped(disc, (100, 100), fit=fit) > 127
        wide, high = (np.ptp(np.flatnonzero(seen.any(axis))) + 1 for axis in (0, 1))
        assert bool(abs(wide - high) <= 2) == round_, fit
    # of the same shape there is nothing to choose
    assert len({shaped(disc, (120, 60), fit=fit).tobytes() for fit in ("pad", "crop", "stretch")}) == 1


def test_a_part_of_the_frame():
    frame = np.arange(48, dtype=np.uint8).reshape(6, 8)
    assert np.array_equal(shaped(frame, None, crop=(2, 1, 4, 3)), frame[1:4, 2:6])
    with pytest.raises(ValueError, match=r"crop \(5, 1, 4, 3\) isn't within a frame of 8x6"):
        shaped(frame, None, crop=(5, 1, 4, 3))


def test_a_part_of_the_time(tmp_path):
    video = write_video(tmp_path / "a.avi", fps=20)
    whole = list(frames_of(video))
    part = list(frames_of(video, view=VideoView(0.1, 0.35)))
    assert [frame.time for frame in part] == [0, 50_000, 100_000, 150_000, 200_000]
    assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(part, whole[2:7], strict=True))
    with pytest.raises(ValueError, match="the video has no frames from 9 s to inf s"):
        list(frames_of(video, view=VideoView(9)))


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"start": -1}, "start must be at least 0 and before stop"),
        ({"start": 2, "stop": 2}, "start must be at least 0 and before stop"),
        ({"crop": (0, 0, 0, 5)}, "crop must be"),
        ({"crop": (-1, 0, 5, 5)}, "crop must be"),
        ({"fit": "squash"}, "fit must be one of pad, crop, stretch, not 'squash'"),
    ],
)
def test_views_that_make_no_sense(how, message):
    with pytest.raises(ValueError, match=message):
        VideoView(**{"start": 0.0, "stop": inf} | how)


def test_videos_are_not_squashed_without_a_word(tmp_path):
    """By the command, frames of another shape are whole, with black beside them; the manifest says what was chosen."""
    frames = moving_square(8)
    height, width = frames[0].shape[:2]
    write_video(tmp_path / "in/a.avi", frames)
    size = (width, 2 * height)
    convert_videos(tmp_path / "in", tmp_path / "pad", size=size)
    y = nvsdata.read(tmp_path / "pad/a.h5").y
    assert height // 2 <= y.min() and y.max() < height + height // 2 + 1  # noqa: PT018
    words = ["convert-videos", str(tmp_path / "in"), "--out", str(tmp_path / "all"), "--size", f"{size[0]}x{size[1]}"]
    assert main([*words, "--fit", "stretch"]) == 0
    stretched = PIX2NVS().emulate(tmp_path / "in/a.avi", size=size)
    assert nvsdata.read(tmp_path / "all/a.h5") == stretched
    # a folder has one view
    with pytest.raises(ValueError, match="choose another folder"):
        convert_videos(tmp_path / "in", tmp_path / "all", size=size)
    with pytest.raises(SystemExit, match="2"):
        main([*words, "--start", "3", "--stop", "2"])


def test_a_part_of_a_video_is_emulated_as_if_it_were_all(tmp_path):
    frames = moving_square(12)
    write_video(tmp_path / "in/a.avi", frames, fps=20)
    convert_videos(tmp_path / "in", tmp_path / "out", view=VideoView(0.2, 0.4, (4, 4, 20, 16)))
    events = nvsdata.read(tmp_path / "out/a.h5")
    assert events.sensor_size == (20, 16)
    assert (events.start, events.end) == (0, 150_000)
    expected = PIX2NVS().emulate(
        list(frames_of(tmp_path / "in/a.avi", color=False, view=VideoView(0.2, 0.4, (4, 4, 20, 16))))
    )
    assert events == expected
