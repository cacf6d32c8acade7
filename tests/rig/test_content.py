"""Recordings that show something else than their video, made from one that is right."""

import re

import cv2
import lab
import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.recording import pipeline
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.simulated.options import Simulation
from nvsdata.rig import motion, playback, take
from nvsdata.rig.cameras import Rig
from nvsdata.rig.content import Content, Inspector, Span, TakeRejected, _compared
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.motion import emulated
from nvsdata.rig.sync import ScreenRecording, synced
from nvsdata.video.frames import VideoFrame

SIZE = (240, 180)


def panned(path, frames=40, fps=20, still=False, level=None):
    """A blotchy ground that pans, or a still one, or one of a single level."""
    rng = np.random.default_rng(0)
    ground = cv2.resize(rng.integers(30, 220, (24, 40), dtype=np.uint8), (400, 240), interpolation=cv2.INTER_CUBIC)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (160, 120))
    for n in range(frames):
        x = 0 if still else round(2.5 * n)
        shown = ground[40:160, 40 + x : 200 + x] if level is None else np.full((120, 160), level, np.uint8)
        writer.write(cv2.cvtColor(np.ascontiguousarray(shown), cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


@pytest.fixture(scope="module")
def lab_of_one(tmp_path_factory):
    """A monitor, and what records a video on it: the span of the take."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SDL_VIDEODRIVER", "dummy")
        for name in ("STEP", "STILL", "SETTLE", "FADE", "flashes"):
            patch.setattr(playback, name, getattr(playback, name))
        patch.setattr(take, "MOST_WRONG", take.MOST_WRONG)
        lab.hurry()
        # the simulated camera may wait for a busy machine
        patch.setattr(Davis, "silence", 60.0)
        patch.setattr(pipeline, "SILENT_END", 60.0)
        backend, show = Simulation().watched()
        folder = tmp_path_factory.mktemp("takes")
        with Monitor(window=(320, 240), on_change=show) as monitor:
            rig = Rig(lambda: Davis.find(backend=backend), monitor, CameraSettings())

            def recorded(video):
                with Davis.find(backend=backend) as camera:
                    camera.configure(rig.settings)
                    one = take.record_screen(camera, rig, video, folder / f"{video.stem}.h5")
                line = synced(one).line
                ends = round(line.camera(one.performance.start)), round(line.camera(one.performance.stop))
                return Span(one, nvsdata.open(one.raw), line, *ends)

            recorded.monitor = monitor
            yield recorded


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return panned(tmp_path_factory.mktemp("videos") / "pan.avi")


@pytest.fixture(scope="module")
def right(lab_of_one, video):
    """A span of a good recording, and its events."""
    span = lab_of_one(video)
    return span, span.recording.read()


def judged(lab_of_one, video, span, events, path, **how):
    """The figures of a recording with other events, and what is odd about it."""
    nvsdata.write(events, path)
    other = span._replace(
        take=ScreenRecording(path, span.take.report, span.take.performance), recording=nvsdata.open(path)
    )
    inspector = Inspector(lab_of_one.monitor, **how)
    found = inspector.measure(other, video)
    return found, inspector.doubts(found)


def beside(events, t, x, y, rng):
    """Further events, which a camera saw besides."""
    columns = [np.concatenate(pair) for pair in zip(events.columns, (t, x, y, rng.integers(0, 2, t.size)), strict=True)]
    return Events(*columns, SIZE)


def without(span, events, start, stop):
    """Without the events of a part of the video, from and to these shares of it."""
    lo, hi = (span.start + share * (span.stop - span.start) for share in (start, stop))
    return events[(events.t < lo) | (events.t >= hi)]


def test_a_good_recording_has_nothing_odd(lab_of_one, video, right, tmp_path):
    span, events = right
    found, doubts = judged(lab_of_one, video, span, events, tmp_path / "a.h5")
    assert doubts == []
    # the camera is of PIX2NVS's own kind here
    assert 0.5 < found.scale < 1.5
    assert found.hidden == 0
    # a busy machine shows frames late, which then fall into the next bin of 50 ms
    assert found.gap <= 50 + span.take.performance.wrong
    assert found.stray < 0.05
    assert found.noise == pytest.approx(0.5, rel=0.3)
    # where scenes.CORNERS say, seen from the middle of the outermost pixels
    assert np.allclose(found.corners, [(14, 12), (228, 8), (226, 172), (10, 168)], atol=3)
    assert found.cover == pytest.approx(0.8, abs=0.03)
    assert found.seen > 0.85
    assert not found.quiet


def spoiled(kind, span, events):
    rng = np.random.default_rng(1)
    inside = (events.t >= span.start) & (events.t < span.stop)
    count, end = int(inside.sum()), int(events.t[-1])
    if kind == "200 ms are missing":
        return without(span, events, 0.5, 0.5 + 200_000 / (span.stop - span.start))
    if kind == "90% are missing":
        return events[~inside | (rng.random(len(events)) < 0.1)]
    if kind == "a hand before the lens":
        return events[~(inside & (events.x > 130))]
    if kind == "someone walks by":
        t = np.sort(rng.integers(span.start, span.stop, count))
        x = (200 * (t - span.start) / (span.stop - span.start) + rng.integers(0, 40, count)).astype(int)
        return beside(events, t, x, rng.integers(0, 180, count), rng)
    if kind == "a storm":
        t = np.sort(rng.integers(span.start + 500_000, span.start + 700_000, 3 * count))
        return beside(events, t, rng.integers(0, 240, t.size), rng.integers(0, 180, t.size), rng)
    if kind == "12 Hz of noise":
        t = np.sort(rng.integers(0, end, int(12 * 240 * 180 * end / 1e6)))
        return beside(events, t, rng.integers(0, 240, t.size), rng.integers(0, 180, t.size), rng)
    share = float(kind.split("%")[0]) / 100
    return events[events.x >= 12 + share * 215]


SPOILED = {
    "200 ms are missing": r"no events for (2\d\d|1[5-9]\d) ms in which the video moves",
    "90% are missing": "times the events that the video's motion should cause",
    "a hand before the lens": "of the video's motion caused no events",
    "someone walks by": "of the events are where, or when, nothing moves",
    "a storm": "of the events are where, or when, nothing moves",
    "12 Hz of noise": r"1[1-4] Hz of noise per pixel",
    "50% out of view": "is part of it out of view, or hidden",
    "75% out of view": "is part of it out of view, or hidden",
    "99% out of view": "too few pixels see the screen",
}


@pytest.mark.parametrize("kind", SPOILED)
def test_what_is_odd_is_told(lab_of_one, video, right, tmp_path, kind):
    _, doubts = judged(lab_of_one, video, *right[:1], spoiled(kind, *right), tmp_path / "a.h5")
    assert any(re.search(SPOILED[kind], doubt) for doubt in doubts), doubts


@pytest.mark.parametrize("kind", [{"still": True}, {"level": 0}, {"level": 255}])
def test_still_and_blank_videos_are_quiet_and_right(lab_of_one, tmp_path, kind):
    video = panned(tmp_path / "quiet.avi", frames=20, **kind)
    span = lab_of_one(video)
    inspector = Inspector(lab_of_one.monitor, strict=True)
    result = inspector.judged(span, video, 420)
    assert result["content"]["scale"] is None
    assert "review" not in result
    # unless something else happens before the camera
    rng, count = np.random.default_rng(0), 200_000
    t = np.sort(rng.integers(span.start, span.stop, count))
    crowded = beside(span.recording.read(), t, rng.integers(0, 60, count), rng.integers(0, 180, count), rng)
    _, doubts = judged(lab_of_one, video, span, crowded, tmp_path / "a.h5")
    assert any("nothing moves" in doubt for doubt in doubts)


def test_strict_refuses_and_a_moving_video_needs_events(lab_of_one, video, right, tmp_path):
    span, events = right
    nvsdata.write(spoiled("a hand before the lens", span, events), tmp_path / "a.h5")
    take_ = ScreenRecording(tmp_path / "a.h5", span.take.report, span.take.performance)
    odd = span._replace(take=take_, recording=nvsdata.open(tmp_path / "a.h5"))
    lenient, strict = Inspector(lab_of_one.monitor), Inspector(lab_of_one.monitor, strict=True)
    assert len(lenient.judged(odd, video, 10**6)["review"]) >= 1
    with pytest.raises(TakeRejected, match="something is in front of the screen"):
        strict.judged(odd, video, 10**6)
    # two seconds
    assert lenient.judged(span, video, 2_000)
    with pytest.raises(
        TakeRejected, match=r"1999 events in 2\.00 s are too few: the video's motion should cause about \d+"
    ):
        lenient.judged(span, video, 1_999)
    assert Inspector(lab_of_one.monitor, accept_quiet=True).judged(span, video, 0)


def test_a_screen_that_hardly_a_pixel_sees_is_no_quiet_video(lab_of_one, video, right, tmp_path):
    """One event of 200 still shows the flashes, but no corners to expect events between."""
    span, events = right
    faint = events[np.random.default_rng(0).random(len(events)) < 0.005]
    nvsdata.write(faint, tmp_path / "a.h5")
    take_ = ScreenRecording(tmp_path / "a.h5", span.take.report, span.take.performance)
    odd = span._replace(take=take_, recording=nvsdata.open(tmp_path / "a.h5"))
    with pytest.raises(TakeRejected, match=r"150 events in 2\.00 s are too few: hardly any pixel saw the screen"):
        Inspector(lab_of_one.monitor).judged(odd, video, 150)
    # other recordings, or a calibration, tell where it should be
    others = [Inspector(lab_of_one.monitor).measure(span, video).as_dict()] * 3
    for known in (Inspector(lab_of_one.monitor, others=others), Inspector(lab_of_one.monitor, others[0]["corners"])):
        with pytest.raises(
            TakeRejected, match=r"150 events in 2\.00 s are too few: the video's motion should cause about \d+"
        ):
            known.judged(odd, video, 150)


def test_a_video_that_moves_for_a_second_only_is_judged_by_that():
    """30 s; some 30,000 events are due within one of them."""
    bins = 30_000_000 // motion.BIN
    due = np.zeros((bins, 108))
    due[200:220] = 29_000 / 20 / 108
    noise = np.full(108, 0.01)
    still = np.repeat(noise[None], bins, 0)
    # nothing of it was seen: that is no quiet video, and the scale is one that is told
    assert _compared(still.copy(), due, noise)[0] == pytest.approx(0)
    half = due.copy()
    half[:, :54] = 0
    assert _compared(still + half, due, noise)[2] == pytest.approx(0.5)
    late = due.copy()
    late[208:212] = 0
    assert _compared(still + late, due, noise)[1] == 200
    scale, gap, hidden, stray = _compared(still + due, due, noise)
    assert (round(scale, 2), gap, hidden, round(stray, 3)) == (1, 0, 0, 0)
    # less than 1,000 in the busiest second is a quiet video
    assert _compared(still, due / 30, noise)[0] is None


def test_flashes_at_the_edge_of_a_bin_are_not_missing():
    """Of a video that turns white and black every 100 ms; the screen takes 12 ms to do so."""
    due = np.zeros((40, 108))
    due[1::2] = 50.0
    found = np.roll(due, 1, 0)
    noise = np.zeros(108)
    scale, gap, _, _ = _compared(found, due, noise)
    assert scale == pytest.approx(1)
    assert gap <= motion.BIN / 1e3


def test_bins_go_by_the_cameras_clock(lab_of_one, video):
    corners = np.array([(14, 12), (228, 8), (226, 172), (10, 168)], np.float32)
    usual = emulated(video, lab_of_one.monitor, corners, SIZE, 60)
    slow = emulated(video, lab_of_one.monitor, corners, SIZE, 60, drift=0.25)
    last = [np.flatnonzero(counts.sum(1)).max() for counts in (usual, slow)]
    # the last picture comes after 1.95 s
    assert last == [39, 48]
    assert slow.sum() == usual.sum()


def figures(**changed):
    corners = [[14.0, 12.0], [228.0, 8.0], [226.0, 172.0], [10.0, 168.0]]
    usual = {"emulated": 10**5, "scale": 1.0, "gap": 0.0, "hidden": 0.0, "stray": 0.0, "noise": 0.5}
    return Content(**usual | {"cover": 0.8, "seen": 0.95, "corners": corners} | changed)


SHIFTED = [[20.1, 12.0], [234.1, 8.0], [232.1, 172.0], [16.1, 168.0]]


@pytest.mark.parametrize(
    ("changed", "result"),
    [
        ({}, None),
        ({"scale": 0.31}, None),
        ({"scale": 0.29}, r"recorded events per emulated event: 0\.29, in the other recordings 1"),
        ({"scale": 3.4}, "recorded events per emulated event"),
        ({"scale": None}, None),
        ({"cover": 0.63}, r"of the sensor that sees the screen: 0\.63, in the other recordings 0\.8"),
        ({"seen": 0.6}, "fraction of the flashes that a pixel recorded"),
        ({"corners": SHIFTED}, "corners are 6 pixels from where they were"),
        ({"gap": 100.0, "hidden": 0.25, "stray": 0.2, "noise": 10.0}, None),
        ({"gap": 101.0}, "no events for 101 ms"),
        ({"corners": None}, "too few pixels see the screen"),
        ({"cover": 0.2}, "fills 20% of the view"),
    ],
)
def test_limits_and_the_other_recordings(changed, result):
    class Screen:
        size = (320, 240)

    others = [figures(scale=scale).as_dict() for scale in (0.9, 1.0, 50.0)]
    alone, among = Inspector(Screen()), Inspector(Screen(), others=others)
    found = figures(**changed)
    doubts = among.doubts(found)
    if result is None:
        assert doubts == []
        assert alone.doubts(found) == []
    else:
        assert any(re.search(result, doubt) for doubt in doubts), doubts
    if result and "other" in result:
        # two recordings don't say what is usual
        assert Inspector(Screen(), others=others[:2]).doubts(found) == []


def test_a_calibration_says_where_the_screen_was():
    class Screen:
        size = (320, 240)

    calibrated = Inspector(Screen(), corners=SHIFTED)
    assert calibrated.doubts(figures(corners=SHIFTED)) == []
    assert "6 pixels" in calibrated.doubts(figures())[0]
    # it may stand on its side
    assert calibrated.doubts(figures(corners=SHIFTED, cover=0.1)) == []


def test_the_emulated_video_is_where_the_screen_shows_it(monkeypatch):
    """A square that moves in the left half of a wide picture, on a screen that fills the sensor's middle."""
    frames = []
    for n in range(5):
        pixels = np.zeros((50, 200), np.uint8)
        pixels[15:35, 10 + 10 * n : 40 + 10 * n] = 200
        frames.append(VideoFrame(n * 40_000, pixels))
    monkeypatch.setattr(motion, "frames_of", lambda video: iter(frames))

    class Screen:
        size = (400, 200)

        @staticmethod
        def place_of(width, height):
            assert (width, height) == (200, 50)
            return 0, 50, 400, 100

    corners = np.array([(40, 40), (200, 40), (200, 120), (40, 120)], np.float32)
    counts = emulated(None, Screen, corners, SIZE, 4)
    assert counts.shape == (4, 12 * 9)
    x, y = np.meshgrid(np.arange(12) * 20 + 10, np.arange(9) * 20 + 10)
    there = counts.sum(0).reshape(9, 12)
    assert there.sum() > 100
    # the square's way: 0.4 sensor pixels per pixel of the screen, 2 of that per pixel of the picture
    assert there[(x < 40) | (x > 120) | (y < 60) | (y > 100)].sum() == 0
    # from the first change on
    assert (counts.sum(1)[:3] > 0).all()
