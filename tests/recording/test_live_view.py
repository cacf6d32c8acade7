"""The window that shows events, on SDL's dummy driver."""

import numpy as np
import pygame
import pytest
from scipy import ndimage

from nvsdata import Events
from nvsdata.plots.drawing import OFF, ON
from nvsdata.recording import live_view
from nvsdata.recording.live_view import DisplayError, LiveView, sharpness

pytestmark = pytest.mark.usefixtures("headless")


def burst(t, x, y, p, size=(40, 30)):
    return Events(t, x, y, p, size)


def test_the_window_has_the_last_33_ms_three_times_as_large():
    with LiveView((40, 30)) as view:
        view.draw()
        assert view._window.size == (120, 90)
        view.add(burst([0, 1_000, 1_001], [1, 2, 3], [4, 4, 4], [1, 1, 0]))
        view.add(burst([], [], [], []))
        view.add(burst([34_000], [39], [29], [1]))
        view._drawn = 0
        view.draw()
        shown = pygame.surfarray.array3d(view._window.get_surface()).swapaxes(0, 1)
    expected = np.full((90, 120, 3), 255)
    # red comes first on the screen
    for x, y, color in ((2, 4, ON), (3, 4, OFF), (39, 29, ON)):
        expected[3 * y : 3 * y + 3, 3 * x : 3 * x + 3] = color[::-1]
    assert (shown == expected).all()


def test_a_picture_each_33_ms_and_what_its_title_says(monkeypatch):
    now, flips = [1e9], []
    monkeypatch.setattr(live_view, "host_time", lambda: now[0])
    with LiveView((40, 30)) as view:
        monkeypatch.setattr(live_view, "sharpness", lambda events: 1.234)
        view.draw()
        assert view._window.title == "0 k events/s, sharpness 1.23"
        n = 33_000
        view.add(burst(np.arange(n), np.zeros(n, int), np.zeros(n, int), np.ones(n, int)))
        window, view._window = view._window, type("", (), {"flip": lambda self: flips.append(now[0])})()
        for moment in (1, 32_999, 33_000, 33_001, 65_999, 66_000):
            now[0] = 1e9 + moment
            view.draw()
        assert view._window.title == "1,000 k events/s, sharpness 1.23"
        view._window = window
    assert flips == [1e9 + 33_000, 1e9 + 66_000]


@pytest.mark.parametrize(
    ("event", "closed"),
    [
        ((pygame.KEYDOWN, {"key": pygame.K_ESCAPE}), True),
        ((pygame.KEYUP, {"key": pygame.K_ESCAPE}), False),
        ((pygame.KEYDOWN, {"key": pygame.K_RETURN}), False),
        ((pygame.QUIT, {}), True),
        ((pygame.WINDOWCLOSE, {}), True),
        ((pygame.WINDOWMOVED, {}), False),
    ],
)
def test_what_closes_the_window(event, closed):
    with LiveView((40, 30)) as view:
        view.attend()
        assert not view.closed
        pygame.event.clear()
        pygame.event.post(pygame.event.Event(event[0], event[1]))
        view.attend()
        assert view.closed == closed
        # and it stays so
        view.attend()
        assert view.closed == closed


def test_without_a_display(monkeypatch):
    def refused():
        raise pygame.error("no display")

    monkeypatch.setattr(pygame.display, "init", refused)
    with pytest.raises(DisplayError, match="events can't be shown: no display"):
        LiveView((40, 30))


@pytest.mark.parametrize("seed", range(3))
def test_sharpness_is_the_energy_of_the_laplacian_over_that_of_the_picture(seed):
    rng = np.random.default_rng(seed)
    x, y, p = rng.integers(0, 40, 300), rng.integers(0, 30, 300), rng.integers(0, 2, 300)
    signed = np.zeros((30, 40))
    np.add.at(signed, (y, x), np.where(p == 1, 1.0, -1.0))
    picture = ndimage.gaussian_filter(signed, 1, mode="mirror")
    expected = (ndimage.laplace(picture, mode="mirror") ** 2).sum() / (picture**2).sum()
    assert sharpness(burst(np.zeros(300, int), x, y, p)) == pytest.approx(expected, rel=1e-3)
