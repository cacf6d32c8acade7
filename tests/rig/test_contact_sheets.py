from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from lab import make_video

import nvsdata
from nvsdata import Events
from nvsdata.batch.folder import Video, videos_in
from nvsdata.plots.drawing import INK, ON
from nvsdata.rig import contact_sheets
from nvsdata.rig.contact_sheets import Sheets, _fitted, _middle, _page


def test_a_damaged_recording_leaves_its_place_empty(tmp_path):
    for name in ("a", "b"):
        make_video(tmp_path / f"in/{name}.avi")
    videos = videos_in(tmp_path / "in", tmp_path)
    events = Events([500_000] * 40, [5] * 40, range(40), [1] * 40, (240, 180))
    for video in videos:
        nvsdata.write(events, video.target)
    whole = videos[0].target.read_bytes()
    videos[0].target.write_bytes(whole[: len(whole) // 2])
    lines = {video.name: {"events": 40, "duration": 1_000_000} for video in videos}
    with Sheets(tmp_path, videos, SimpleNamespace(videos=lines)) as sheets:
        sheets.add(videos[0])
    page = cv2.imread(str(tmp_path / "contact-sheet-001.png"))
    # the first recording's place is gray all over, the second has its events
    first, second = page[18:138, 160:320], page[18:138, 492:652]
    assert (first == 240).all()
    assert second.std() > 0


def test_a_sheet_has_forty_videos(tmp_path):
    videos = [SimpleNamespace(name=f"{n}.avi") for n in range(41)]
    sheets = Sheets(tmp_path, videos, SimpleNamespace(videos={}))
    assert [[video.name for video in page] for page in sheets._pages] == [[f"{n}.avi" for n in range(40)], ["40.avi"]]


def test_a_sheet_is_drawn_when_its_last_video_is_done_or_at_the_end(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(contact_sheets, "ROWS", 1)
    monkeypatch.setattr(contact_sheets, "_page", lambda there: [line and line["n"] for _, line in there])
    monkeypatch.setattr(contact_sheets, "save_png", lambda page, path: drawn.append((path.name, page)))
    videos = [SimpleNamespace(name=f"{n}.avi") for n in range(12)]
    lines = {}
    with Sheets(tmp_path, videos, SimpleNamespace(videos=lines)) as sheets:
        for n in (4, 5, 6, 7, 0, 8):
            lines[f"{n}.avi"] = {"n": n} | ({"review": ["a hand"]} if n in (5, 8) else {})
            sheets.add(videos[n])
            assert drawn == ([] if n in (4, 5, 6) else [("contact-sheet-002.png", [4, 5, 6, 7])])
    assert drawn[1:] == [
        ("contact-sheet-001.png", [0, None, None, None]),
        ("contact-sheet-003.png", [8, None, None, None]),
        # the odd ones again, on a sheet that comes first
        ("contact-sheet-000.png", [5, 8]),
    ]
    (tmp_path / "contact-sheet-000.png").touch()
    del drawn[:], lines["5.avi"], lines["8.avi"]
    with Sheets(tmp_path, videos, SimpleNamespace(videos=lines)):
        pass
    assert drawn == []
    assert not list(tmp_path.iterdir())


def test_a_sheet_that_cannot_be_written_is_no_error(tmp_path):
    videos = [Video("a.avi", tmp_path / "a.avi", tmp_path / "a.h5")]
    with Sheets(tmp_path / "gone", videos, SimpleNamespace(videos={})) as sheets:
        sheets._stale.add(0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("count", "shape"), [(1, (146, 332)), (4, (146, 1_328)), (5, (292, 1_328))])
def test_a_sheet_has_a_place_for_each_video_row_by_row(tmp_path, count, shape):
    """None can be read and none was recorded: a gray picture, an empty place and a caption for each."""
    page = _page([(Video(f"{n}.avi", tmp_path / "none.avi", tmp_path / "none.h5"), None) for n in range(count)])
    expected = np.full((*shape, 3), 240, np.uint8)
    for n in range(count):
        top, left = 146 * (n // 4), 332 * (n % 4)
        expected[top + 18 : top + 138, left : left + 160] = 128
        caption = page[top : top + 18, left : left + 320]
        inked = np.argwhere((caption < 150).all(2))
        # older fonts' thin strokes are lighter
        assert min(INK) <= caption.min() < 100
        # letters of 9 pixels, from the left, whole
        assert 2 <= inked[:, 0].min() < 7 < 10 < inked[:, 0].max() < 16
        assert 2 <= inked[:, 1].min() < 6
        caption[:] = 240
    assert (page == expected).all()


@pytest.mark.parametrize(
    ("events", "duration", "rate"),
    [(5_000, 1_000_000, "5 k/s"), (2_000_000, 500_000, "4,000 k/s"), (3, 0, "3,000 k/s")],
)
def test_a_caption_has_the_name_with_its_class_and_the_rate(tmp_path, monkeypatch, events, duration, rate):
    captions = []
    monkeypatch.setattr(contact_sheets.cv2, "putText", lambda picture, caption, *how: captions.append(caption))
    video = Video("run/abcdefghijklmnopqrstuvwxyz0123.4.avi", tmp_path / "a.avi", tmp_path / "a.h5")
    line = {"events": events, "duration": duration}
    _page([(video, line), (video, None)])
    nvsdata.write(Events([0], [0], [0], [1], (160, 120)), video.target)
    _page([(video, line), (video, {"status": "failed"})])
    name = "..efghijklmnopqrstuvwxyz0123.4"
    assert len(name) == contact_sheets.LONGEST
    assert captions == [f"{name}  -", f"{name}  -", f"{name}  {rate}", f"{name}  -"]


@pytest.mark.parametrize(("middle", "early"), [(500_000, 480_000), (10_000, 0)])
def test_the_events_of_the_middle_are_shown(tmp_path, middle, early):
    """Those of 40 ms around it, as far as there are any."""
    t = [0, early, middle + 19_999, middle + 20_000] if early == 0 else [early - 1, early, middle + 19_999, 520_000]
    video = Video("a.avi", tmp_path / "none.avi", tmp_path / "a.h5")
    nvsdata.write(Events(t, [10, 20, 30, 40], [5, 5, 5, 5], [1, 1, 1, 1], (160, 120)), video.target)
    page = _page([(video, {"events": 4, "duration": 2 * middle})])
    shown = page[18:138, 160:320]
    marked = [(int(x), int(y)) for y, x in np.argwhere((shown == ON).all(2))]
    assert marked == [(x, 5) for x in ((10, 20, 30) if early == 0 else (20, 30))]
    assert (np.delete(shown[5], [10, 20, 30], 0) == 255).all()


@pytest.mark.parametrize("frames", [1, 4, 5])
def test_the_middle_picture_of_a_video(tmp_path, frames):
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25, (80, 60))
    for n in range(frames):
        writer.write(np.full((60, 80, 3), 40 * n + 20, np.uint8))
    writer.release()
    assert _middle(tmp_path / "a.avi").mean() == pytest.approx(40 * (frames // 2) + 20, abs=3)
    unread = _middle(tmp_path / "none.avi")
    assert unread.shape == (120, 160, 3)
    assert (unread == 128).all()


@pytest.mark.parametrize(
    ("width", "height", "place"),
    [
        (160, 120, (0, 160, 0, 120)),
        (320, 120, (0, 160, 30, 90)),
        (80, 30, (0, 160, 30, 90)),
        (40, 240, (70, 90, 0, 120)),
        (1, 1_000, (79, 80, 0, 120)),
        (1_000, 1, (0, 160, 59, 60)),
    ],
)
def test_a_picture_fills_its_place_and_keeps_its_shape(width, height, place):
    left, right, top, bottom = place
    expected = np.full((120, 160, 3), 220)
    expected[top:bottom, left:right] = 7
    assert (_fitted(np.full((height, width, 3), 7, np.uint8)) == expected).all()
