"""The page about a batch, and the estimate before it."""

import re
from types import SimpleNamespace

import pytest
from lab import make_video

from nvsdata.recording.rig import estimate as estimating
from nvsdata.recording.rig import report
from nvsdata.recording.rig.estimate import estimate
from nvsdata.video.folder import Video


def line(name, status="recorded", **more):
    content = {"scale": 0.9, "noise": 0.5, "gap": 0.0, "stray": 0.01, "seen": 0.95}
    return (
        {"video": name, "status": status}
        | more
        | (
            {}
            if status == "failed"
            else {"events": 60_000, "duration": 3_000_000, "wrong": 0.0, "temperature": None}
            | {"sync": {"drift": 2e-6, "residual": 5.0}, "content": content}
        )
    )


def words(page):
    return re.sub(r"<[^>]*>", " ", page)


def test_what_is_to_be_done_comes_first():
    lines = [
        line("fine<1>.avi"),
        line("odd.avi", look=["a hand & more"]),
        line("cut.avi", "truncated", reason="cut off"),
        line("lost.avi", "failed", reason="no flashes"),
    ]
    head = {"monitor": {"refresh": 1e6 / 59.94}}
    page = report.page(lines, head, "out", "lamp <off>")
    text = words(page)
    assert "1 recordings as they should be, 1 to look at, 2 videos to record again" in text
    assert "screen of 59.94 Hz" in text
    assert "lamp &lt;off&gt;" in text
    places = [text.index(word) for word in ("To record again: 2", "cut.avi", "lost.avi", "To look at: 1", "odd.avi")]
    assert places == sorted(places)
    assert text.index("odd.avi") < text.index("The others: 1") < text.index("fine&lt;1&gt;.avi")
    assert "a hand &amp; more" in text
    assert "20,000" not in text
    assert "2e+04" in text
    # a picture per figure, but for the temperature, which no recording has
    assert page.count("<img") == len(report.CURVES) - 1
    assert page.startswith('<!doctype html><html lang="en"><head><meta charset="utf-8">')
    assert f"<title>Recordings in out</title><style>{report.STYLE}</style></head><body>" in page
    # nothing that a browser would have to fetch
    assert "http" not in page


def test_a_batch_without_a_recording():
    text = words(report.page([line("a.avi", "failed", reason="no camera")], {}, "out", None))
    assert "0 recordings as they should be, 0 to look at, 1 videos" in text
    assert "<img" not in text


def test_the_page_of_a_folder(tmp_path):
    manifest = SimpleNamespace(videos={"a.avi": line("a.avi")}, head={})
    report.write_report(manifest, tmp_path)
    assert "a.avi" in (tmp_path / "report.html").read_text()


@pytest.fixture
def videos(tmp_path):
    """Three of two seconds and one of which nothing is known."""
    made = [make_video(tmp_path / f"{n}.avi", frames=50, fps=25) for n in range(3)]
    (tmp_path / "x.avi").write_bytes(b"RIFF")
    return [Video(path.name, path, path.with_suffix(".h5")) for path in (*made, tmp_path / "x.avi")]


def test_an_estimate_of_time_and_disk(tmp_path, videos, monkeypatch):
    monkeypatch.setattr(estimating.shutil, "disk_usage", lambda out: SimpleNamespace(free=5 * 10**9))
    told = estimate(videos * 100, [], tmp_path, 1e6 / 60)
    # 2 s each; patterns of 0.6 s and 32 steps of 3/60 s, twice; 2 s of the first picture, 0.8 s of fading, 2 s besides
    assert told == "400 videos: about 1 h 15 min and 1.6 GB; 5.0 GB of disk are free"
    recorded = [{"recording": 60_000_000, "duration": 3_000_000}, {"status": "failed"}]
    assert "16.0 GB; 5.0 GB of disk are free, which is too little" in estimate(
        videos * 100, recorded, tmp_path, 1e6 / 60
    )


def test_an_estimate_of_nothing(tmp_path):
    assert estimate([], [], tmp_path, 1e6 / 60).startswith("0 videos: about 0 h 00 min and 0.0 GB")
