"""Refresh, placement and waiting of a monitor, to the pixel and by a simulated clock."""

from itertools import cycle

import numpy as np
import pygame
import pytest

from nvsdata.recording.live_view import DisplayError
from nvsdata.rig import monitor as module
from nvsdata.rig.monitor import Monitor
from nvsdata.video.frames import VideoFrame

PERIOD = 1e6 / 60


@pytest.fixture
def screen(clock):
    """A monitor of 64x48 on the clock."""
    with Monitor(window=(64, 48)) as monitor:
        yield monitor


def pixels(monitor):
    return pygame.surfarray.array3d(monitor._surface).swapaxes(0, 1)


@pytest.mark.parametrize(
    ("rates", "display", "refresh"),
    [([], 0, 60), ([0], 0, 60), ([1], 0, 1), ([75], 0, 75), ([75], 1, 60), ([75, 144], 1, 144), ([75, -1], 1, 60)],
)
def test_the_refresh_is_what_the_display_says_or_60_hz(screen, monkeypatch, rates, display, refresh):
    monkeypatch.setattr(pygame.display, "get_desktop_refresh_rates", lambda: rates)
    period, result, synced, _ = screen._measure(display)
    assert period == result == pytest.approx(1e6 / refresh)
    assert not synced


def measured(screen, monkeypatch, times):
    times = iter(times)
    monkeypatch.setattr(module, "host_time", lambda: float(next(times)))
    found = screen._measure(0)
    assert next(times, None) is None
    return found


def jittered(period, jitter, seed=0):
    """Times of flips at each refresh, noted some µs late at random."""
    return 5e6 + period * np.arange(module.TRIALS) + np.random.default_rng(seed).uniform(0, jitter, module.TRIALS)


@pytest.mark.parametrize("hertz", [59.94, 60, 60.3])
def test_the_refresh_is_measured_to_100_ppm(screen, monkeypatch, hertz):
    for seed in range(5):
        period, result, synced, cost = measured(screen, monkeypatch, jittered(1e6 / hertz, 500, seed))
        assert synced
        assert period == pytest.approx(1e6 / hertz, rel=1e-4)
        assert (result, cost) == (PERIOD, 0)


@pytest.mark.parametrize("hertz", [24, 30, 75, 144, 240])
def test_another_refresh_than_the_display_says_must_be_very_even(screen, monkeypatch, hertz):
    period, result, synced, _ = measured(screen, monkeypatch, jittered(1e6 / hertz, 30))
    assert synced
    assert period == pytest.approx(1e6 / hertz, rel=1e-4)
    # a driver that draws without waiting takes about as long each time, but not to a hundredth
    period, result, synced, cost = measured(screen, monkeypatch, jittered(1e6 / hertz, 1e6 / hertz / 10))
    assert (period, synced) == (result, False)
    assert 0 < cost < 1e6 / hertz


def test_refreshes_that_were_missed_are_counted(screen, monkeypatch):
    skipped = np.delete(1e6 / 59.94 * np.arange(module.TRIALS + 6), [40, 41, 90, 130, 131, 200])
    period, _, synced, _ = measured(screen, monkeypatch, skipped)
    assert synced
    assert period == pytest.approx(1e6 / 59.94, rel=1e-6)


def test_flips_that_do_not_wait_are_no_refreshes(screen, monkeypatch):
    uneven = jittered(PERIOD, 0)
    uneven[::10] += 0.2 * PERIOD
    # and those that come at once, however evenly
    for times in (uneven, 5e6 + 100.0 * np.arange(module.TRIALS)):
        period, result, synced, cost = measured(screen, monkeypatch, times)
        assert (period, synced) == (result, False) == (PERIOD, False)
        assert cost == pytest.approx(np.diff(times[2:]).min())


def test_what_is_odd_about_a_display_is_said(screen):
    assert "is vertical sync off?" in screen.refresh_warning()
    screen.synced, screen.stated, screen.refresh = True, PERIOD, 1e6 / 59.97
    assert screen.refresh_warning() is None
    screen.refresh = 1e6 / 59.94
    assert screen.refresh_warning() == "the display states 60.00 Hz, but 59.94 Hz are measured and used"


@pytest.mark.parametrize(
    ("scaling", "size", "region", "place"),
    [
        ("aspect", (20, 10), (0, 0, 64, 48), (0, 8, 64, 32)),
        ("aspect", (10, 20), (0, 0, 64, 48), (20, 0, 24, 48)),
        ("aspect", (10, 10), (3, 5, 20, 13), (6, 5, 13, 13)),
        ("aspect", (128, 96), (0, 0, 64, 48), (0, 0, 64, 48)),
        ("aspect", (1_000, 1), (0, 0, 64, 48), (0, 23, 64, 1)),
        ("aspect", (1, 1_000), (0, 0, 64, 48), (31, 0, 1, 48)),
        ("integer", (64, 48), (0, 0, 64, 48), (0, 0, 64, 48)),
        ("integer", (33, 20), (0, 0, 64, 48), (15, 14, 33, 20)),
        ("integer", (21, 16), (0, 0, 64, 48), (0, 0, 63, 48)),
        ("integer", (10, 10), (3, 5, 29, 39), (7, 14, 20, 20)),
    ],
)
def test_where_a_picture_goes(screen, scaling, size, region, place):
    screen.scaling, screen.region = scaling, region
    screen.fill(200)
    screen.show(VideoFrame(0, np.full((size[1], size[0], 3), 7, np.uint8)))
    x, y, width, height = place
    expected = np.zeros((48, 64, 3))
    expected[y : y + height, x : x + width] = 7
    assert (pixels(screen) == expected).all()


@pytest.mark.parametrize("size", [(65, 48), (64, 49), (128, 10)])
def test_what_is_too_large_for_whole_numbers(screen, size):
    screen.scaling = "integer"
    with pytest.raises(ValueError, match=f"a frame of {size[0]}x{size[1]} is larger than the region of 64x48"):
        screen.show(VideoFrame(0, np.zeros((size[1], size[0]), np.uint8)))


def test_how_pictures_are_scaled(screen):
    """Areas are averaged, gaps are filled in between; by whole numbers pixels stay as they are."""
    step = np.repeat(np.array([0, 100], np.uint8), 2)[None].repeat(4, 0)
    for scaling, region, row in (
        ("aspect", (0, 0, 4, 4), [0, 0, 100, 100]),
        ("aspect", (0, 0, 2, 2), [0, 100]),
        ("aspect", (0, 0, 1, 1), [50]),
        ("aspect", (0, 0, 8, 8), [0, 0, 0, 25, 75, 100, 100, 100]),
        ("integer", (0, 0, 8, 8), [0, 0, 0, 0, 100, 100, 100, 100]),
    ):
        screen.scaling, screen.region = scaling, region
        picture, place = screen._placed(VideoFrame(0, step))
        assert (place, picture.shape) == ((0, 0), (len(row), len(row), 3))
        assert (picture == np.array(row)[None, :, None]).all()


def test_which_values_a_picture_may_have(screen):
    screen.region = (0, 0, 5, 1)
    floats, _ = screen._placed(VideoFrame(0, np.array([[-3.0, 0.4, 0.6, 254.6, 300.0]])))
    assert floats.dtype == np.uint8
    assert floats[0, :, 1].tolist() == [0, 0, 1, 255, 255]
    colors = np.arange(15, dtype=np.uint8).reshape(1, 5, 3)
    assert (screen._placed(VideoFrame(0, colors))[0] == colors[..., ::-1]).all()
    assert (screen._placed(VideoFrame(0, colors, red_first=True))[0] == colors).all()


def test_a_fill_is_gray_all_over(screen):
    screen.fill(77)
    assert (pixels(screen) == 77).all()


@pytest.mark.parametrize(
    ("region", "fits"),
    [
        ((0, 0, 64, 48), True),
        ((63, 47, 1, 1), True),
        ((-1, 0, 5, 5), False),
        ((0, -1, 5, 5), False),
        ((0, 0, 0, 5), False),
        ((0, 0, 5, 0), False),
        ((1, 0, 64, 48), False),
        ((0, 1, 64, 48), False),
        ((60, 40, 4, 9), False),
    ],
)
def test_a_region_lies_on_the_screen(clock, region, fits):
    if fits:
        with Monitor(window=(64, 48), region=region) as monitor:
            assert monitor.region == region
        return
    with pytest.raises(ValueError, match="is not within the screen of 64x48"):
        Monitor(window=(64, 48), region=region)
    assert not pygame.display.get_init()


@pytest.mark.parametrize("display", [-1, 2])
def test_displays_are_counted_from_0(clock, monkeypatch, display):
    monkeypatch.setattr(pygame.display, "get_desktop_sizes", lambda: [(64, 48), (80, 60)])
    with pytest.raises(DisplayError, match=rf"there is no display {display}; there are 0 \(64x48\), 1 \(80x60\)"):
        Monitor(display)
    assert not pygame.display.get_init()


@pytest.mark.parametrize("window", [None, (64, 48)])
def test_the_whole_screen_or_a_window(clock, monkeypatch, window):
    asked, quiet = [], []
    set_mode = pygame.display.set_mode

    def opened(size, flags, **options):
        asked.append((size, flags, options))
        return set_mode((64, 48))

    monkeypatch.setattr(pygame.display, "get_desktop_sizes", lambda: [(9, 9), (80, 60)])
    monkeypatch.setattr(pygame.display, "set_mode", opened)
    monkeypatch.setattr(pygame.display, "set_allow_screensaver", lambda value: quiet.append(value))
    monkeypatch.setattr(pygame.mouse, "set_visible", lambda value: quiet.append(value))
    with Monitor(1, window=window) as monitor:
        assert monitor.size == (window or (80, 60))
        assert monitor.region == (0, 0, *monitor.size)
        assert (monitor.confirmed, monitor.synced, monitor.scaling) == (False, False, "aspect")
    flags = 0 if window else pygame.FULLSCREEN | pygame.SCALED
    assert asked == [(window or (80, 60), flags, {"display": 1, "vsync": 0 if window else 1})]
    assert quiet == [False, False]


@pytest.mark.parametrize(
    ("events", "confirmed"),
    [
        ([(pygame.KEYDOWN, pygame.K_RETURN)], True),
        ([(pygame.KEYDOWN, pygame.K_SPACE)], True),
        ([(pygame.KEYDOWN, pygame.K_SPACE), (pygame.KEYDOWN, pygame.K_a)], True),
        ([(pygame.KEYDOWN, pygame.K_a)], False),
        ([(pygame.KEYUP, pygame.K_RETURN)], False),
        ([(pygame.KEYUP, pygame.K_ESCAPE)], False),
        ([], False),
    ],
)
def test_enter_and_space_confirm(screen, events, confirmed):
    pygame.event.clear()
    for kind, key in events:
        pygame.event.post(pygame.event.Event(kind, {"key": key}))
    screen._attend()
    assert screen.confirmed is confirmed


@pytest.mark.parametrize("synced", [False, True])
def test_a_wait_looks_at_the_keyboard_50_times_a_second(screen, clock, synced):
    screen.synced = clock.synced = synced
    checks = []
    screen.check = lambda: checks.append(clock.now)
    until = clock.now + 500_000
    screen.wait(until)
    gaps = np.diff([*checks, clock.now])
    assert until <= clock.now < until + (PERIOD if synced else 10)
    assert len(checks) == (23 + 4 if synced else 25)
    # near the end flips set the pace if they can
    slept = 22 if synced else 24
    assert np.allclose(gaps[:slept], 20_000, atol=5)
    assert not synced or np.allclose(gaps[slept + 1 :], PERIOD, atol=5)
    before = len(checks)
    screen.wait(clock.now)
    screen.wait(clock.now - 1)
    assert len(checks) == before


def test_a_display_that_goes_away(screen, monkeypatch):
    def gone():
        raise pygame.error("lost")

    monkeypatch.setattr(pygame.display, "flip", gone)
    with pytest.raises(DisplayError, match="the display is gone: lost"):
        screen.fill(1)


def test_drawing_that_takes_long_begins_earlier(clock):
    """A picture comes at its refresh, though each flip takes 5 ms, or a little more."""
    takes = cycle((5e-3, 5.2e-3))
    clock.flip = lambda: clock.sleep(next(takes))
    with Monitor(window=(64, 48)) as monitor:
        assert monitor._cost == pytest.approx(5_000, abs=5)
        origin = monitor._origin
        for n in (10, 15.4, 20.6, 30):
            shown = (monitor.fill(3, origin + n * PERIOD) - origin) / PERIOD
            assert shown == pytest.approx(round(n), abs=0.015)
