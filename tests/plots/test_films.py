import cv2
import numpy as np
import pytest
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
    save_gif(film.pictures(EVENTS), tmp_path / "a.gif", film.fps)
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
    save_mp4(film.pictures(EVENTS), tmp_path / "a.mp4", film.fps)
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 100
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 10
    for window in film.windows(EVENTS):
        shown = video.read()[1]
        wanted = np.pad(plots.event_image(window, 33), ((0, 1), (0, 1), (0, 0)), mode="edge")
        assert shown.shape == wanted.shape
        # lossy
        assert abs(shown.astype(int) - wanted).mean() < 6


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
    with pytest.raises(ValueError, match=r"more than 3,000 pictures: take a part, or write an \.mp4"):
        save_gif([plots.event_image(EVENTS)] * 3_001, tmp_path / "a.gif", 30)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="frames, more than"):
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
