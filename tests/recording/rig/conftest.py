"""A monitor without a display, and patterns that are over sooner."""

import lab
import pytest

from nvsdata.recording.rig import playback, take


@pytest.fixture
def headless(monkeypatch):
    """SDL without a display."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.fixture
def quick(monkeypatch, headless):
    """`lab.hurry`, undone afterwards."""
    for module, name in ((playback, "STEP"), (playback, "STILL"), (playback, "SETTLE"), (playback, "flashes")):
        monkeypatch.setattr(module, name, getattr(module, name))
    monkeypatch.setattr(take, "MOST_LATE", take.MOST_LATE)
    lab.hurry()
