"""A monitor without a display, and patterns that are over sooner."""

import lab
import pygame
import pytest

from nvsdata.rig import monitor, playback, take


class Clock:
    """Host time (µs) that passes by sleeping, and 1 µs each time it is read; flips wait for refreshes if `synced`."""

    PERIOD = 1e6 / 60

    def __init__(self):
        self.now, self.synced = 1_000.0, False

    def __call__(self):
        self.now += 1
        return self.now

    def sleep(self, seconds):
        assert seconds >= 0
        self.now += seconds * 1e6

    def flip(self):
        if self.synced:
            self.now = (self.now // self.PERIOD + 1) * self.PERIOD


@pytest.fixture
def clock(monkeypatch, headless):
    """A clock of the test's own in place of the host's, for the monitor and for what plays on it."""
    clock = Clock()
    for module in (monitor, playback):
        monkeypatch.setattr(module, "host_time", clock)
    monkeypatch.setattr(monitor, "time", clock)
    flip = pygame.display.flip

    def flipped():
        flip()
        clock.flip()

    monkeypatch.setattr(pygame.display, "flip", flipped)
    monkeypatch.setattr(pygame.display, "get_desktop_refresh_rates", lambda: [60])
    return clock


@pytest.fixture
def quick(monkeypatch, headless):
    """`lab.hurry`, undone afterwards."""
    for name in ("STEP", "STILL", "SETTLE", "FADE", "flashes"):
        monkeypatch.setattr(playback, name, getattr(playback, name))
    monkeypatch.setattr(take, "MOST_WRONG", take.MOST_WRONG)
    lab.hurry()
