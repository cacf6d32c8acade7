"""Recordings of videos know the times of the frames, and which events lie between them."""

import h5py
import numpy as np
import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata import PIX2NVS, FormatError
from nvsdata.data.pieces import cut_pieces
from nvsdata.data.samples import Frame, Piece
from nvsdata.emulation import DVS
from nvsdata.emulation.convert import convert_videos
from nvsdata.emulation.protocol import describe_settings


@pytest.fixture(params=[PIX2NVS(threshold=0.3), DVS(upsample=3)])
def converted(tmp_path, request):
    video = write_video(tmp_path / "in/a.avi", moving_square(12), fps=20)
    convert_videos(video, tmp_path / "out", request.param)
    return request.param, video, nvsdata.open(tmp_path / "out/a.h5")


def test_the_file_knows_frames_and_settings(converted):
    emulator, video, recording = converted
    assert recording.frame_times.tolist() == [50_000 * n for n in range(12)]
    assert recording.about["emulator"] == describe_settings(emulator)
    # the events are those of the emulator, and the last frame is the recording's end
    assert recording.read() == emulator.emulate(video)
    assert recording.end == 550_000


def test_events_between_frames_are_those_that_the_emulator_gave(converted):
    emulator, video, recording = converted
    pieces = list(emulator.stream(video))
    for n in range(1, 12):
        between = recording.between_frames(n - 1)
        assert np.array_equal(between.t, pieces[n].t)
        assert np.array_equal(between.x, pieces[n].x)
    assert sum(len(recording.between_frames(n)) for n in range(11)) == len(recording.read()) > 0
    assert len(recording.between_frames(0, 11)) == len(recording.read())
    assert len(recording.between_frames(3, 3)) == 0
    for first, last in ((-1, 2), (5, 12), (11, None)):
        with pytest.raises(IndexError, match="the recording has 12"):
            recording.between_frames(first, last)
    with pytest.raises(ValueError, match="frame 2 comes before frame 5"):
        recording.between_frames(5, 2)


def test_what_is_cut_or_written_again_keeps_them(converted, tmp_path):
    _, _, recording = converted
    nvsdata.write(recording, tmp_path / "b.h5")
    assert nvsdata.open(tmp_path / "b.h5").about["emulator"] == recording.about["emulator"]
    assert np.array_equal(nvsdata.open(tmp_path / "b.h5").frame_times, recording.frame_times)
    nvsdata.write(cut_pieces(recording, 100_000, 300_000, every=50_000), tmp_path / "c.h5")
    part = nvsdata.open(tmp_path / "c.h5")
    assert part.frame_times.tolist() == [50_000 * n - 100_000 for n in range(12)]
    assert len(part.between_frames(2, 5)) == len(recording.between_frames(2, 5))


def test_a_cameras_own_frames_have_times_too(tmp_path):
    pixels = np.zeros((5, 5), np.uint16)
    frames = [Frame(t, t, t + 1_000, t + 1_000, 0, 0, pixels) for t in (10_000, 20_000)]
    events = nvsdata.Events([5_000, 10_500, 12_000, 20_500, 20_501], [1] * 5, [1] * 5, [1] * 5, (5, 5))
    nvsdata.write(iter([Piece.of_camera(events, frames)]), tmp_path / "a.h5")
    recording = nvsdata.open(tmp_path / "a.h5")
    assert recording.frame_times.tolist() == [10_500, 20_500]
    assert recording.between_frames(0).t.tolist() == [12_000, 20_500]
    nvsdata.write(events, tmp_path / "a.dat")
    with pytest.raises(FormatError, match="frames aren't read"):
        nvsdata.open(tmp_path / "a.dat").between_frames(0)


def test_times_that_are_none_are_told(converted):
    *_, recording = converted
    with h5py.File(recording.path, "r+") as file:
        del file["frame_times"]
        file["frame_times"] = [[0.5]]
    with pytest.raises(FormatError, match=r"/frame_times is float64 \[1, 1\], not times"):
        recording.frame_times  # noqa: B018


@pytest.mark.parametrize("emulator", [PIX2NVS(threshold=0.3), PIX2NVS(hue=True), DVS(), DVS(upsample=3)], ids=repr)
def test_a_whole_video_takes_times_as_a_stream_does(emulator):
    frames = list(moving_square(6))
    times = [7_000, 9_000, 40_000, 41_000, 90_000, 10**9]
    events = emulator.emulate(frames, times=iter(times))
    pieces = list(emulator.stream(frames, times=times))
    assert events == nvsdata.data.events.concatenate_events(pieces)
    assert (events.start, events.end) == (7_000, 10**9)
    assert len(events)
    assert emulator.emulate(frames, times=[20_000 * n for n in range(6)]) == emulator.emulate(frames, fps=50)
    small = emulator.emulate(frames, times=times, size=(9, 7))
    assert small.sensor_size == (9, 7)
    for wrong, said in (
        ({"times": times, "fps": 5}, "fps or times, not both"),
        ({"times": times[:3]}, "frame 3 has no time"),
        ({"times": times[::-1]}, "times must rise"),
    ):
        with pytest.raises(ValueError, match=said):
            emulator.emulate(frames, **wrong)
