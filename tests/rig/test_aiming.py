"""Aiming, and what is flashed and watched for a calibration, on a monitor that shows nothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.rig import calibrate
from nvsdata.rig.clock_fit import ClockFit
from nvsdata.rig.playback import BRIGHT, DIM


@pytest.mark.parametrize(("width", "height"), [(240, 160), (160, 240)])
def test_the_target_is_a_star_of_18_rays_in_a_frame(width, height):
    target = calibrate._target((width, height))
    assert (target.dtype, target.shape) == (np.uint8, (height, width))
    assert set(np.unique(target)) == {0, 255}
    assert (target == target[::-1, ::-1]).all()
    inner = target[4:-4, 4:-4]
    frame = target.copy()
    frame[4:-4, 4:-4] = 255
    assert (frame == 255).all()
    assert not np.concatenate((inner[0], inner[-1], inner[:, 0], inner[:, -1])).all()
    y, x = np.mgrid[:height, :width]
    away = np.hypot(x - (width - 1) / 2, y - (height - 1) / 2)
    radius = 0.48 * height
    assert not inner[away[4:-4, 4:-4] > radius].any()
    if width < height:
        return
    for share in (0.4, 0.97):
        angle = np.linspace(0, 2 * np.pi, 3_600, endpoint=False) + 1e-3
        place = ((height - 1) / 2 + share * radius * np.sin(angle), (width - 1) / 2 + share * radius * np.cos(angle))
        along = target[tuple(np.rint(side).astype(int) for side in place)]
        rays = np.count_nonzero(np.diff(np.append(along, along[0]).astype(int)) > 0)
        assert rays == 18
        assert along[50] == 255
        assert along[-50] == 0


class Screen:
    """A monitor that shows nothing and whose waits take no time."""

    region, refresh = (5, 6, 81, 61), 16_667.0

    def __init__(self, confirmed_after=None):
        self.now, self.shown, self.left, self.confirmed = 7e6, [], confirmed_after, True

    def show(self, frame, due):
        self.shown.append((frame.pixels.copy(), due))
        return due

    def wait(self, until):
        self.now = until
        if self.left is not None:
            self.left -= 1
            self.confirmed = self.left == 0


@pytest.mark.parametrize(
    ("seconds", "after", "count"), [(1.0, None, 5), (0.9, None, 4), (0.1, None, 1), (1.0, 3, 3), (None, 12, 12)]
)
def test_aiming_ends_by_enter_or_when_its_time_is_up(monkeypatch, seconds, after, count):
    screen = Screen(after)
    monkeypatch.setattr(calibrate, "host_time", lambda: screen.now)
    calibrate._aim(screen, seconds)
    target = calibrate._target((81, 61))
    assert [due for _, due in screen.shown] == [7e6 + n * 250_000 for n in range(count)]
    assert all((shown == (255 - target if n % 2 else target)).all() for n, (shown, _) in enumerate(screen.shown))
    # the next is asked for two refreshes before it is due
    assert screen.now == 7e6 + count * 250_000 - 2 * 16_667


@pytest.mark.parametrize(("part", "bright"), [(1, (61, 81)), (2, (30, 40))])
def test_what_flashes_of_a_region(monkeypatch, part, bright):
    screen = Screen()
    monkeypatch.setattr(calibrate, "pattern", lambda monitor, show: (show(True, 5.0), show(False, 7.0)))
    assert calibrate._flashed(screen, part) == (5.0, 7.0)
    expected = np.full((61, 81), DIM)
    expected[: bright[0], : bright[1]] = BRIGHT
    (lit, _), (dark, _) = screen.shown
    assert (lit == expected).all()
    assert (dark == DIM).all()


def test_a_still_screen_is_watched_after_its_flashes(monkeypatch):
    """What the camera sees of it is looked at for flicker: neither the time before nor the end."""
    asked = SimpleNamespace()
    events = Events([0, 5_000_000, 5_000_001, 9_000_000, 9_000_001], [0] * 5, [0] * 5, [1] * 5, (4, 3))

    class Camera:
        facts = SimpleNamespace(width=4, height=3)

    class Quick:
        def __init__(self, camera, path, settings, watch):
            self.watch, self.begun = watch, SimpleNamespace(wait=lambda: None)

        def start(self):
            self.watch(None, events[:1])

        def finish(self):
            self.watch(None, events)

        def check(self):
            asked.checked = True

    class Live(SimpleNamespace):
        def __init__(self, size):
            super().__init__(add=lambda events: None, draw=lambda: None)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    def pattern(monitor, show):
        monitor.check()
        show(True, 1.0)
        return [1.0, 2.0], [True, False]

    def spectrum(given, moment, duration):
        asked.spectrum = (given.t.tolist(), moment, duration)
        return np.arange(30.0), np.ones(30)

    screen = Screen(1)
    screen.fill = lambda level: 4_700_000.6 if level == BRIGHT else None
    for name, value in (
        ("Recorder", Quick),
        ("LiveView", Live),
        ("pattern", pattern),
        ("host_time", lambda: screen.now),
        ("fit_clock", lambda seen, host, bright: ClockFit(0.0, 0.0, 0.0, 2, len(seen))),
        ("response", lambda given, line, *shown: (len(given), shown)),
        ("corners_of", lambda whole, quarter: (whole, quarter)),
        ("rectangles", lambda corners, size: ((0, 0, *size), (0, 0, 1, 1), 0.5)),
        ("spectrum_of", spectrum),
        ("lines_of", lambda frequencies, spectrum, expected: expected),
    ):
        monkeypatch.setattr(calibrate, name, value)
    found = calibrate.calibrate(Camera(), screen, CameraSettings(), None)
    # the screen is still from 0.3 s after it was filled
    assert asked.spectrum == ([5_000_001, 9_000_000], 5_000_001, 4_000_000)
    assert screen.now == pytest.approx(4_700_000.6 + 300_000 + 4_000_000 + 300_000)
    # what came while aiming isn't looked at
    assert found.response == (5, ([1.0, 2.0], [True, False]))
    assert found.roi == (0, 0, 4, 3)
    assert found.flicker == (pytest.approx(59.9988, abs=1e-3), 100.0, 120.0)
    assert asked.checked
    # the whole of it flashes, and then its upper left quarter
    whole, quarter = (shown for shown, _ in screen.shown[-2:])
    assert (whole == BRIGHT).all()
    assert (quarter == BRIGHT).sum() == 30 * 40
    assert screen.check() is None
