"""Emulation by hand: settings at their bounds, times between frames, brightness, the readout, what is started."""

import math
from dataclasses import replace

import numpy as np
import pytest
from clips import write_video
from test_pix2nvs import clip, looks_everywhere

import nvsdata
from nvsdata import Events
from nvsdata.batch import local
from nvsdata.batch.folder import Video
from nvsdata.batch.manifest import sha256
from nvsdata.batch.scheduler import as_done
from nvsdata.common.processes import connected_process
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.convert import default_out, plan
from nvsdata.emulation.imperfections import Imperfections
from nvsdata.emulation.job import Job, convert
from nvsdata.emulation.pix2nvs_state import PIX2NVSState, _sensitivity, tone
from nvsdata.emulation.protocol import describe_settings
from nvsdata.emulation.state import brightness
from nvsdata.video.frames import VideoFrame

GRAY, LIGHT = np.full((6, 8), 100, np.uint8), np.full((6, 8), 200, np.uint8)


@pytest.mark.parametrize(
    ("name", "least", "below", "largest", "above"),
    [
        ("threshold", 1e-5, 0.99e-5, 100, math.inf),
        ("inhibition", 1, 0, 9, math.inf),
        ("max_events", 1, 0, 10**6, math.inf),
        ("gamma", 1e-9, 0, 9, math.inf),
        *((name, 0, -1e-9, 1e9, math.inf) for name in ("t_log", "noise_rate", "mismatch", "hot_rate", "bandwidth")),
        ("refractory", 0, -1, 10**9, math.inf),
        ("seed", 0, -1, 2**63 - 1, 2**63),
        ("alpha", 1e-9, 0, 1, 1.01),
        ("hot_pixels", 0, -0.01, 1, 1.01),
    ],
)
def test_a_setting_goes_to_its_bounds_and_no_further(name, least, below, largest, above):
    assert getattr(PIX2NVS(**{name: least}), name) == least
    assert getattr(PIX2NVS(**{name: largest}), name) == largest
    for bad in (below, above):
        with pytest.raises(ValueError, match=name):
            PIX2NVS(**{name: bad})


@pytest.mark.parametrize("t_log", [0, 0.5, 1, 1.001])
def test_a_linear_part_meets_a_logarithm_that_is_positive(t_log):
    PIX2NVS(t_log=t_log)
    if 0 < t_log <= 1:
        with pytest.raises(ValueError, match=f"continuous needs t_log above 1, .* not {t_log}"):
            PIX2NVS(continuous=True, t_log=t_log)
    else:
        PIX2NVS(continuous=True, t_log=t_log)


@pytest.mark.parametrize("span", [1, 2**21, 2**21 + 1, 2**31 - 1])
def test_times_between_the_frames_whatever_their_distance(span):
    """From 100 to 200 it's ln 2, which crosses 0.2 three times."""
    for start in (0, -(10**15)):
        events = list(PIX2NVS().stream([GRAY, LIGHT], times=[start, start + span]))[1]
        assert (events.start, events.end) == (start, start + span)
        for k, count in enumerate(np.split(events.t - start, 3), 1):
            np.testing.assert_allclose(count, k * 0.2 / math.log(2) * span, rtol=1e-6, atol=1)
        fixed = list(PIX2NVS(timestamps="fixed").stream([GRAY, LIGHT], times=[start, start + span]))[1]
        assert (fixed.t == start + span).all()


@pytest.mark.parametrize("span", [0, -1, 2**31])
def test_times_that_are_no_times_of_frames(span):
    message = f"the frame at {5 + span} µs follows the one at 5 µs: times must rise, by less than 35 min"
    with pytest.raises(ValueError, match=message):
        list(PIX2NVS().stream([VideoFrame(5, GRAY), VideoFrame(5 + span, LIGHT)]))


@pytest.mark.parametrize(
    ("frame", "kind"),
    [
        (VideoFrame(7, LIGHT[:, :7]), "7x6 gray uint8"),
        (VideoFrame(7, np.dstack([LIGHT] * 3)), "8x6 color uint8"),
        (VideoFrame(7, LIGHT.astype(float)), "8x6 gray float64"),
        (VideoFrame(7, LIGHT, levels=(16, 235)), "8x6 gray uint8 from 16 to 235"),
    ],
)
def test_all_frames_are_of_one_kind(frame, kind):
    with pytest.raises(ValueError, match=f"the frame at 7 µs is {kind}, earlier ones were 8x6 gray uint8$"):
        list(PIX2NVS().stream([VideoFrame(0, GRAY), frame]))


def test_a_frame_has_room_for_a_block_and_events_for_a_frame():
    small = GRAY[:3]
    assert len(PIX2NVS(inhibition=3).emulate([small, small + 100])) > 0
    with pytest.raises(ValueError, match="inhibition=4 is larger than the frame of 8x3"):
        PIX2NVS(inhibition=4).emulate([small])
    line = np.full((1, 32_768), 100, np.uint8)
    events = PIX2NVS().emulate([line[:, :-1], line[:, :-1] + 100])
    assert (events.sensor_size, int(events.x.max())) == ((32_767, 1), 32_766)
    for wide in (line, line.T):
        with pytest.raises(ValueError, match=r"frames of \d+x\d+ are larger than events can address"):
            PIX2NVS().emulate([wide])


def piece(times, places, before, now):
    """Events at places along a row of 8 pixels, or beyond, in the rows below."""
    x, y = np.array(places) % 8, np.array(places) // 8
    return Events(times, x, y, [0] * len(times), (8, 6), start=before, end=now), before, now


def passed(events):
    return list(zip(events.t.tolist(), (events.y * 8 + events.x).tolist(), strict=True))


def test_events_wait_for_a_readout_that_is_busy_with_earlier_frames():
    flaws = Imperfections(PIX2NVS(bandwidth=1_000), (8, 6))
    first = flaws.apply(*piece([100, 100, 100], [0, 9, 2], 100, 2_100))
    assert passed(first) == [(100, 0), (1_100, 9), (2_100, 2)]
    assert (first.start, first.end) == (100, 2_100)
    # busy until 3,100; the pixel is blind while its event waits
    second = flaws.apply(*piece([2_100, 3_099, 3_100, 4_000], [11, 11, 11, 0], 2_100, 4_100))
    assert passed(second) == [(3_100, 11), (4_100, 11), (5_100, 0)]
    assert (second.start, second.end) == (2_100, 5_100)
    # in time to come it's free again
    third = flaws.apply(*piece([9_000], [5], 4_100, 10_000))
    assert passed(third) == [(9_000, 5)]
    assert third.end == 10_000


def test_a_pixel_is_blind_from_frame_to_frame():
    flaws = Imperfections(PIX2NVS(refractory=500), (8, 6))
    assert passed(flaws.apply(*piece([10, 509, 510, 900], [9, 9, 9, 1], 0, 1_000))) == [(10, 9), (510, 9), (900, 1)]
    later = flaws.apply(*piece([1_009, 1_010, 1_399, 1_400, 1_401], [9, 9, 1, 1, 9], 1_000, 2_000))
    assert passed(later) == [(1_010, 9), (1_400, 1)]


def test_noise_is_at_all_pixels_and_moments_of_a_frame():
    found = Imperfections(PIX2NVS(noise_rate=1e7), (8, 6)).apply(*piece([], [], 50, 54))
    assert set(passed(found)) == {(t, place) for t in range(50, 54) for place in range(48)}
    hot = Imperfections(PIX2NVS(hot_pixels=1 / 48, hot_rate=1e6), (8, 6)).apply(*piece([], [], 0, 1_000))
    assert len(set(zip(hot.x.tolist(), hot.y.tolist(), strict=True))) == 1
    assert (hot.p == 1).all()
    assert Imperfections.of(PIX2NVS(mismatch=0.1), (8, 6)) is None


def test_a_line_of_the_manifest_says_what_was_made(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.avi", [np.dstack([frame] * 3) for frame in (GRAY, LIGHT, GRAY)], fps=10)
    moments = iter([100.0, 102.34567])
    monkeypatch.setattr("nvsdata.emulation.job.time.monotonic", lambda: next(moments))
    line = convert(Job(Video("a.avi", path, tmp_path / "out/a.h5"), PIX2NVS(), None, None))
    events = nvsdata.read(tmp_path / "out/a.h5")
    assert line.pop("sha256")
    assert line.pop("recording_sha256") == sha256(tmp_path / "out/a.h5")
    assert line == {
        "video": "a.avi",
        "status": "converted",
        "bytes": path.stat().st_size,
        "modified": path.stat().st_mtime_ns,
        "frames": 3,
        "events": len(events),
        "sensor_size": (8, 6),
        "duration": 200_000,
        "recording": (tmp_path / "out/a.h5").stat().st_size,
        "seconds": 2.346,
    }
    assert len(events) > 100


@pytest.mark.parametrize("red_first", [True, False])
def test_hue_and_luminance_of_colors_by_hand(red_first):
    colors = np.array([[[10, 30, 20], [0, 0, 7], [0, 0, 0], [255, 255, 255], [0, 200, 0]]], np.uint8)
    frame = VideoFrame(0, colors if red_first else colors[..., ::-1], red_first)
    assert brightness(frame, hue=True).tolist() == [[0.5, 7, 0, 0.5, 0]]
    np.testing.assert_allclose(brightness(frame), [[2.99 + 17.61 + 2.28, 7 * 0.114, 0, 255, 117.4]])


def test_brightness_of_gray_between_black_and_white():
    frame = VideoFrame(0, np.array([[0, 15, 16, 17, 235]], np.uint8), levels=(16, 235))
    assert brightness(frame, hue=True).tolist() == [[0, 0, 0, 0.5, 0.5]]
    np.testing.assert_allclose(brightness(frame)[0, 2:], [0, 255 / 219, 255], atol=0.51)
    plain = VideoFrame(0, frame.pixels)
    assert brightness(plain).tolist() == [[0, 15, 16, 17, 235]]
    assert brightness(plain, hue=True).tolist() == [[0, 0.5, 0.5, 0.5, 0.5]]


@pytest.mark.parametrize(
    ("settings", "tones"),
    [
        ({}, [0, math.log(0.5), 0, math.log(20), math.log(20.5), math.log(255)]),
        ({"t_log": 20}, [0, 0.5, 1, 20, math.log(20.5), math.log(255)]),
        (
            {"t_log": 20, "continuous": True},
            [*(q * math.log(20) / 20 for q in (0, 0.5, 1, 20)), math.log(20.5), math.log(255)],
        ),
        ({"mode": "CE", "gamma": 2}, [100 * q / 255 for q in (0, 0.5, 1, 20, 20.5, 255)]),
        ({"mode": "LICE", "gamma": 1}, [100 * math.sqrt(q / 255) for q in (0, 0.5, 1, 20, 20.5, 255)]),
    ],
)
def test_tones_by_hand(settings, tones):
    np.testing.assert_allclose(tone(PIX2NVS(**settings), np.array([0, 0.5, 1, 20, 20.5, 255])), tones, rtol=1e-12)


def test_thresholds_vary_as_they_say_and_none_is_below_a_tenth():
    own = 1 / _sensitivity(PIX2NVS(mismatch=0.1), (200, 300))
    assert own.shape == (200, 300)
    assert own.mean() == pytest.approx(1, abs=0.002)
    assert own.std() == pytest.approx(0.1, rel=0.02)
    assert (1 / _sensitivity(PIX2NVS(mismatch=2), (50, 50))).min() == pytest.approx(0.1)


@pytest.mark.parametrize("new", [True, False])
def test_tiles_of_sensitive_pixels_are_not_skipped(new):
    settings = PIX2NVS(mismatch=0.6, new=new, threshold=0.4)
    frames = [(frame // 4 + 150).astype(np.uint8) for frame in clip(3, (20, 136), 12, 0.002)]
    skipping = list(settings.stream(frames, fps=25))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PIX2NVSState, "_spikes", looks_everywhere)
        assert list(settings.stream(frames, fps=25)) == skipping
    assert sum(map(len, skipping)) > 0


def test_spikes_may_wait_while_19_frames_are_emulated():
    frames = [VideoFrame(n, (GRAY + n) if n % 2 else LIGHT - n) for n in range(20)]
    emulator, again = PIX2NVSState(PIX2NVS(), frames[0]), PIX2NVSState(PIX2NVS(), frames[0])
    held = [emulator.step(frame) for frame in frames[1:]]
    assert [spikes.events() for spikes in held] == [again.step(frame).events() for frame in frames[1:]]


@pytest.mark.parametrize(
    ("videos", "processes", "started"),
    [(0, 4, 0), (1, 4, 0), (3, 1, 0), (2, 2, 2), (2, 4, 2), (4, 3, 3)],
)
def test_as_many_processes_as_there_is_work_for(videos, processes, started, monkeypatch):
    begun = []

    def counted(*given):
        begun.append(given)
        return connected_process(*given)

    monkeypatch.setattr(local, "connected_process", counted)
    assert set(as_done(str, range(videos), processes)) == {str(n) for n in range(videos)}
    assert len(begun) == started


def test_recordings_go_beside_their_videos(tmp_path):
    folder = tmp_path / "walk.1"
    path = write_video(folder / "a.b.avi", [np.dstack([GRAY] * 3)] * 2)
    assert default_out(folder) == tmp_path / "walk.1-events"
    assert default_out(path) == folder / "a.b-events"
    (job,) = plan(folder, None, PIX2NVS(seed=3), size=(4, 3), fps=7.0)
    assert (job.video.path, job.video.target.parent) == (path, tmp_path / "walk.1-events")
    assert (job.settings, job.size, job.fps) == (PIX2NVS(seed=3), (4, 3), 7.0)


def test_settings_have_the_name_of_their_emulator():
    kind = type("Other", (PIX2NVS,), {})
    plain = describe_settings(PIX2NVS(seed=4))
    assert plain["seed"] == 4
    assert "emulator" not in plain
    assert describe_settings(kind(seed=4)) == {"emulator": "Other", **plain}
    assert replace(PIX2NVS(), **plain) == PIX2NVS(seed=4)
    for odd in (PIX2NVS, 3, "PIX2NVS"):
        with pytest.raises(TypeError, match="an emulator must be an instance of a dataclass"):
            describe_settings(odd)
