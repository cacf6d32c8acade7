from types import SimpleNamespace

import cv2
from lab import make_video

import nvsdata
from nvsdata import Events
from nvsdata.recording.rig.contact_sheets import Sheets
from nvsdata.video.folder import videos_in


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
