"""A monitor of SDL's dummy driver."""

import sys

import numpy as np
import pygame
import pytest

from nvsdata.recording.camera import host_time
from nvsdata.recording.live_view import DisplayError
from nvsdata.rig.monitor import Monitor
from nvsdata.video.frames import VideoFrame

pytestmark = pytest.mark.usefixtures("headless")


class Eye:
    """Remembers what the screen showed."""

    def __init__(self):
        self.times, self.pictures = [], []

    def __call__(self, time, picture):
        self.times.append(time)
        self.pictures.append(picture.copy())


def picture(width, height, color=(10, 20, 200)):
    return VideoFrame(0, np.full((height, width, 3), color, np.uint8))


def test_a_picture_is_as_large_as_fits_and_black_around():
    eye = Eye()
    with Monitor(window=(200, 100), on_change=eye) as monitor:
        monitor.show(picture(20, 20))
    shown = eye.pictures[-1]
    assert shown.shape == (100, 200, 3)
    # blue came first in the frame, red comes first on the screen
    assert (shown[:, 50:150] == (200, 20, 10)).all()
    assert not shown[:, :50].any()
    assert not shown[:, 150:].any()


def test_whole_numbers_keep_pixels_whole():
    eye = Eye()
    checks = np.indices((10, 10)).sum(0).astype(np.uint8) % 2 * 255
    with Monitor(window=(100, 100), region=(20, 10, 60, 45), scaling="integer", on_change=eye) as monitor:
        monitor.show(VideoFrame(0, checks))
    shown = eye.pictures[-1]
    # 45 of height are room for 4 a pixel, in the middle of the region
    assert (shown[12:52, 30:70, 0] == checks.repeat(4, 0).repeat(4, 1)).all()
    assert shown.sum() == shown[12:52, 30:70].sum()


def test_what_does_not_fit_in_whole_numbers_is_refused():
    with Monitor(window=(100, 100), scaling="integer") as monitor, pytest.raises(ValueError, match="larger than"):
        monitor.show(picture(101, 20))


@pytest.mark.parametrize("synced", [False, True])
def test_each_picture_comes_at_the_refresh_nearest_to_its_time(clock, synced):
    """By a clock of the test's own, so that neither the load of the machine nor the code decides what is late."""
    clock.synced = synced
    eye = Eye()
    with Monitor(window=(64, 48), on_change=eye) as monitor:
        assert monitor.synced == synced
        period = monitor.refresh
        assert period == pytest.approx(clock.PERIOD, abs=50)
        start = clock() + 5 * period
        due = [start + n * 3.37 * period for n in range(60)]
        shown = [monitor.show(picture(8, 8), moment) for moment in due]
        filled = monitor.fill(9, due[-1] + 4.2 * period)
    assert eye.times == [*shown, filled]
    off = np.array([*shown, filled]) - [*due, due[-1] + 4.2 * period]
    # reading the clock takes 1 µs here
    assert abs(off).max() < period / 2 + 100
    assert off.min() < -0.4 * period
    assert off.max() > 0.4 * period
    assert abs(off.mean()) < 0.1 * period
    # whole refreshes lie between them
    gaps = np.diff(shown) / period
    assert abs(gaps - np.rint(gaps)).max() < 0.02


def test_a_picture_whose_time_is_over_comes_at_the_next_refresh(clock):
    with Monitor(window=(64, 48)) as monitor:
        for due in (None, clock() - 1e6):
            before = clock()
            assert before < monitor.show(picture(8, 8), due) <= before + monitor.refresh + 100


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"display": 7}, DisplayError, r"there is no display 7; there are 0 \("),
        ({"region": (0, 0, 65, 10)}, ValueError, "not within the screen of 64x48"),
        ({"scaling": "fill"}, ValueError, "scaling must be one of"),
    ],
)
def test_what_cannot_be_shown_on(options, error, message):
    with pytest.raises(error, match=message):
        Monitor(**{"window": (64, 48)} | options)


def test_without_a_display(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    with pytest.raises(DisplayError, match="videos can't be shown"):
        Monitor()


def test_without_pygame(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ImportError, match=r"nvsdata\[monitor\]"):
        Monitor()


@pytest.mark.parametrize("event", [(pygame.KEYDOWN, {"key": pygame.K_ESCAPE}), (pygame.QUIT, {})])
def test_escape_and_closing_interrupt(event):
    with Monitor(window=(64, 48)) as monitor:
        pygame.event.post(pygame.event.Event(event[0], event[1]))
        with pytest.raises(KeyboardInterrupt):
            monitor.wait(host_time() + 10e6)


def test_a_check_ends_a_wait():
    def gone():
        raise DisplayError("gone")

    with Monitor(window=(64, 48)) as monitor:
        monitor.check = gone
        with pytest.raises(DisplayError, match="gone"):
            monitor.wait(host_time() + 10e6)
