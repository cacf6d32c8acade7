import tempfile

import cv2
import numpy as np
import pytest
from disks import PAGE, small_disk
from PIL import Image

from nvsdata import Events, plots
from nvsdata.plots.films import Film, save_gif, save_mp4

# an event per ms, along the first row of a sensor of 5x3 pixels
MS = np.arange(100)
EVENTS = Events(10**15 + MS * 1_000, MS // 20, MS * 0, MS // 7 % 2, (5, 3))


def counts(film):
    return [len(window) for window in film.windows(EVENTS)]


def test_windows_by_time_follow_the_film_s_clock():
    assert counts(Film(10_000, fps=100)) == [10] * 10
    assert counts(Film(10_000, fps=50)) == [10] * 5
    # half the speed: twice as many pictures, which overlap
    slow = list(Film(10_000, speed=0.5, fps=100).windows(EVENTS))
    assert len(slow) == 20
    assert [int(window.t[0]) - 10**15 for window in slow[:3]] == [0, 5_000, 10_000]


def test_windows_by_number_have_each_event_once():
    assert counts(Film(count=30)) == [30, 30, 30, 10]
    empty = Events.empty((5, 3))
    assert [len(window) for window in Film(count=30).windows(empty)] == [0]
    assert [len(window) for window in Film().windows(empty)] == [0]


def test_a_gif_has_the_pictures_of_the_events_and_their_times(tmp_path):
    film = Film(10_000, fps=25, zoom=2)
    save_gif(film.images(EVENTS), tmp_path / "a.gif", film.fps)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == len(counts(film)) == 3
        for number, window in enumerate(film.windows(EVENTS)):
            gif.seek(number)
            assert gif.info["duration"] == 40
            shown = np.asarray(gif.convert("RGB"))[..., ::-1]
            assert np.array_equal(shown, plots.event_image(window, 2))


@pytest.mark.parametrize("fps", [30, 24, 50, 200])
def test_a_gif_lasts_as_long_as_its_pictures(tmp_path, fps):
    picture = plots.event_image(EVENTS)
    other = plots.event_image(EVENTS[:2])
    save_gif([picture, other] * 15, tmp_path / "a.gif", fps)
    with Image.open(tmp_path / "a.gif") as gif:
        total = 0
        for number in range(gif.n_frames):
            gif.seek(number)
            total += gif.info["duration"]
    # no more than 50 per second
    assert abs(total - 30_000 / min(fps, 50)) <= 10


def test_an_mp4_has_the_pictures_of_the_events(tmp_path):
    film = Film(10_000, fps=100, zoom=33)
    save_mp4(film.images(EVENTS), tmp_path / "a.mp4", film.fps)
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 100
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 10
    for window in film.windows(EVENTS):
        shown = video.read()[1]
        wanted = np.pad(plots.event_image(window, 33), ((0, 1), (0, 1), (0, 0)), mode="edge")
        assert shown.shape == wanted.shape
        # lossy
        assert abs(shown.astype(int) - wanted).mean() < 6


def test_a_film_that_the_temporary_disk_did_not_take_is_an_error(tmp_path, monkeypatch):
    with small_disk(tmp_path / "disk") as resize:
        resize(16 * PAGE)
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "disk"))
        noise = np.random.default_rng(0).integers(0, 255, (20, 240, 320, 3), np.uint8)
        with pytest.raises(OSError, match="of 20 frames: is the disk of temporary files full") as refused:
            save_mp4(noise, tmp_path / "a.mp4", 30)
        assert refused.value.filename.startswith(str(tmp_path / "disk"))
        assert not (tmp_path / "a.mp4").exists()


def test_a_sheet_has_moments_from_beginning_to_end():
    sheet = Film(10_000).sheet(EVENTS)
    first, last = plots.event_image(EVENTS.window(10**15, 10**15 + 10_000)), plots.event_image(EVENTS[-10:])
    for picture in (first, last):
        colors = {tuple(color) for color in picture.reshape(-1, 3).tolist()}
        assert all((sheet == color).all(2).any() for color in colors)
    # words, in shades of gray that are neither the sheet's nor a picture's
    gray = sheet.max(2) == sheet.min(2)
    assert (gray & ~np.isin(sheet[..., 0], (240, 255))).sum() > 100
    assert Film().sheet(Events.empty((5, 3))).ndim == 3


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"duration": 0}, "duration must be positive"),
        ({"duration": 0.03}, "duration counts whole µs"),
        ({"count": 0}, "count must be"),
        ({"speed": 0}, "speed must be positive"),
        ({"fps": -1}, "fps must be positive"),
        ({"zoom": 0}, "zoom must be"),
    ],
)
def test_settings_out_of_range(settings, reason):
    with pytest.raises(ValueError, match=reason):
        Film(**settings)


def test_too_many_pictures_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"at most 3,000 frames: select a part of the events, or write an \.mp4"):
        save_gif([plots.event_image(EVENTS)] * 3_001, tmp_path / "a.gif", 30)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="frames are more than"):
        next(Film(speed=1e-12).windows(EVENTS))


def test_a_sheet_says_when_each_picture_is(monkeypatch):
    seen = []
    monkeypatch.setattr(
        "nvsdata.plots.films.captioned_sheet", lambda tiles, **how: seen.extend(words for _, words in tiles)
    )
    events = Events(10**15 + np.arange(1_000) * 1_000, np.zeros(1_000, int), np.zeros(1_000, int), [1] * 1_000, (4, 4))
    Film(count=100).sheet(events)
    assert [words[0] for words in seen] == [f"{n * 900 // 11:,.1f} ms: 100 events" for n in range(12)]
    seen.clear()
    Film(duration=50_000).sheet(events)
    assert seen[0] == ["0.0 ms: 50 events"]
    assert seen[-1] == ["949.0 ms: 50 events"]


@pytest.mark.parametrize(("width", "zoom"), [(5, 96), (240, 2), (241, 1), (480, 1), (640, 1)])
def test_small_sensors_are_scaled_up_to_480_pixels(width, zoom):
    events = Events([0], [0], [0], [1], (width, 2))
    (picture,) = Film().images(events)
    assert picture.shape == (2 * zoom, width * zoom, 3)
    (picture,) = Film(zoom=1).images(events)
    assert picture.shape == (2, width, 3)


def test_a_film_by_default_is_of_real_time():
    # an event per ms, for a second and a thirtieth
    ms = np.arange(1_034)
    events = Events(10**15 + ms * 1_000, ms * 0, ms * 0, ms * 0, (1, 1))
    windows = list(Film().windows(events))
    assert [window.start - 10**15 for window in windows] == [round(n * 1e6 / 30) for n in range(31)]
    for window in windows:
        since = events.t - window.start
        assert np.array_equal(window.t, events.t[(since >= 0) & (since < 33_333)])
    # a picture begins where the last event is, and none after it
    assert len(list(Film(fps=1_000).windows(events))) == 1_034
    assert len(list(Film(fps=1_000, speed=2).windows(events))) == 517


def test_pictures_of_a_gif_end_at_the_nearest_hundredth_of_a_second(tmp_path):
    def durations(fps, count):
        pictures = [plots.event_image(EVENTS[: 7 * (n % 2)]) for n in range(count)]
        save_gif(pictures, tmp_path / "a.gif", fps)
        with Image.open(tmp_path / "a.gif") as gif:
            assert gif.info["loop"] == 0
            found = []
            for number in range(gif.n_frames):
                gif.seek(number)
                found.append(gif.info["duration"])
        return found

    # 33.3, 66.7, 100, ...
    assert durations(30, 6) == [30, 40, 30, 30, 40, 30]
    assert durations(45, 5) == [20, 20, 30, 20, 20]
    assert durations(50, 3) == [20, 20, 20]
    # browsers show shorter ones for longer
    assert durations(60, 4) == [20, 20, 20, 20]


def test_as_many_pictures_as_a_gif_may_have(tmp_path, monkeypatch):
    monkeypatch.setattr("nvsdata.plots.films.MOST_IN_GIF", 3)
    pictures = [plots.event_image(EVENTS[: 25 * n]) for n in range(4)]
    save_gif(pictures[:3], tmp_path / "a.gif", 30)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 3
    with pytest.raises(ValueError, match="a GIF has at most 3 frames"):
        save_gif(pictures, tmp_path / "b.gif", 30)


@pytest.mark.parametrize("sides", [(3, 4), (4, 3), (4, 4)])
def test_an_mp4_has_even_sides(tmp_path, sides):
    picture = np.full((sides[0] * 11, sides[1] * 11, 3), 200, np.uint8)
    save_mp4([picture] * 2, tmp_path / "a.mp4", 30)
    shown = cv2.VideoCapture(str(tmp_path / "a.mp4")).read()[1]
    assert shown.shape == (sides[0] * 11 + sides[0] % 2, sides[1] * 11 + sides[1] % 2, 3)
    assert abs(shown.astype(int) - 200).max() < 10


def moments(film, events, monkeypatch):
    """Windows on a film's sheet: words, and events."""
    seen = []
    monkeypatch.setattr("nvsdata.plots.films.event_image", lambda window: window)
    monkeypatch.setattr("nvsdata.plots.films.captioned_sheet", lambda tiles, **_: seen.extend(tiles))
    film.sheet(events)
    return [(words, len(window)) for window, words in seen]


def test_a_sheet_shows_a_moment_once(monkeypatch):
    assert moments(Film(200_000), EVENTS, monkeypatch) == [(["0.0 ms: 100 events"], 100)]
    # whole µs from 0 to 2
    assert moments(Film(98_999), EVENTS, monkeypatch) == [
        (["0.0 ms: 99 events"], 99),
        (["0.0 ms: 98 events"], 98),
        (["0.0 ms: 99 events"], 99),
    ]
    assert moments(Film(count=99), EVENTS, monkeypatch) == [(["0.0 ms: 99 events"], 99), (["1.0 ms: 99 events"], 99)]
    assert moments(Film(count=100), EVENTS, monkeypatch) == [(["0.0 ms: 100 events"], 100)]
    empty = Events.empty((5, 3))
    assert moments(Film(count=9), empty, monkeypatch) == [(["0.0 ms: 0 events"], 0)]
    assert moments(Film(), empty, monkeypatch) == [(["0.0 ms: 0 events"], 0)]


def test_a_sheet_has_four_moments_in_a_row():
    # images of 240 pixels: of 5 x 3, 48 times as large
    assert Film(10_000).sheet(EVENTS).shape == (12 + 3 * (240 + 16 + 12 + 4), 12 + 4 * 252, 3)
