"""The page about a batch, and the estimate before it."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from lab import make_video

from nvsdata.batch import estimate as estimating
from nvsdata.batch.folder import Video
from nvsdata.plots import charts
from nvsdata.recording.capture import RESERVE
from nvsdata.rig import report
from nvsdata.rig.batch import estimate_recording


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
        line("odd.avi", review=["a hand & more"]),
        line("cut.avi", "truncated", reason="cut off"),
        line("lost.avi", "failed", reason="no flashes"),
    ]
    head = {"monitor": {"refresh": 1e6 / 59.94}}
    lines[0]["note"] = lines[1]["note"] = "lamp <off>"
    page = report.report_page(lines, head, "out")
    text = words(page)
    assert "1 recordings without findings, 1 to review, 2 to record again" in text
    assert "screen of 59.94 Hz" in text
    assert text.count("lamp &lt;off&gt;") == 1
    places = [text.index(word) for word in ("To record again: 2", "cut.avi", "lost.avi", "To review: 1", "odd.avi")]
    assert places == sorted(places)
    assert text.index("odd.avi") < text.index("Without findings: 1") < text.index("fine&lt;1&gt;.avi")
    assert "a hand &amp; more" in text
    assert "20,000" in text
    # what the words mean, and no charts of three dots
    assert "Flagged above 10." in text
    assert "clock drift" not in text
    assert "<img" not in page
    assert page.startswith('<!doctype html><html lang="en"><head><meta charset="utf-8">')
    assert f"<title>Recordings in out</title><style>{report.STYLE}</style></head><body>" in page
    # nothing that a browser would have to fetch
    assert "http" not in page


def test_a_batch_without_a_recording():
    text = words(report.report_page([line("a.avi", "failed", reason="no camera")], {}, "out"))
    assert "0 recordings without findings, 0 to review, 1 to record again" in text
    assert "<img" not in text


def test_the_page_of_a_folder(tmp_path):
    for name in ("contact-sheet-001.png", "contact-sheet-000.png"):
        (tmp_path / name).touch()
    report.write_batch_report([line("a.avi")], {}, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "a.avi" in page
    places = [
        page.index('<a href="contact-sheet-000.png">flagged recordings</a>'),
        page.index('<a href="contact-sheet-001.png">contact-sheet-001.png</a>'),
        page.index("<table>"),
    ]
    assert places == sorted(places)


def test_charts_come_after_the_table_if_there_are_enough_recordings(monkeypatch):
    drawn = {}

    def chart(values, title, xlabel, *, limits, form):
        drawn[title] = (len(values), [round(limit, 3) for limit in limits])
        return np.zeros((2, 2, 3), np.uint8)

    monkeypatch.setattr(report, "timeline", chart)
    lines = [line(f"{n}.avi") for n in range(report.FEWEST)]
    page = report.report_page([*lines, line("x.avi", "failed", reason="")], {}, "out")
    assert page.index("</table>") < page.index("Over the batch") < page.index("<img") < page.index("Terms")
    # the tightest of fixed limits and those relative to the median; no recording has a temperature
    assert drawn == {
        "events per emulated event": (10, [0.27, 2.97]),
        "noise, Hz": (10, [10.0]),
        "clock drift, ppm": (10, []),
        "flash error, µs": (10, [1_000]),
        "flashes seen": (10, [0.665]),
    }
    assert "clock drift, ppm" in words(page)
    drawn.clear()
    assert "Over the batch" not in report.report_page(lines[1:], {}, "out")
    assert drawn == {}


def test_a_timeline_has_whole_recordings_and_its_limits(monkeypatch):
    figures = []
    monkeypatch.setattr(charts, "rendered", figures.append)
    charts.timeline([1.0, 2.0, np.nan, 4.0], "noise", "recording", limits=[5.0, 1_000.0], form=".1f")
    (axes,) = figures[0].axes
    assert axes.get_title(loc="left") == "noise; limit 1000.0, above the chart"
    assert [text.get_text() for text in axes.texts] == [" limit 5.0"]
    assert axes.get_ylim()[1] > 5
    ticks = axes.get_xticks()
    assert (ticks == ticks.round()).all()


@pytest.mark.parametrize("strange", ["<b>", None, [], {"a": 1}, float("nan"), 10**400])
def test_nothing_of_a_manifest_is_believed_to_be_a_number_or_harmless(strange):
    """A manifest from somewhere else, as `--verify` may read it."""
    lines = [
        line("<i>a", "<u>x", reason=strange, events=strange, takes=strange, note=strange),
        line("b", review=[strange], duration=strange, sync=strange, content=strange),
    ]
    page = report.report_page(lines, {"monitor": {"refresh": strange}}, "<s>", ["<p>.png"])
    for tag in ("<i>", "<u>", "<b>", "<s>", 'href="<'):
        assert tag not in page


@pytest.fixture
def videos(tmp_path):
    """Three of two seconds and one of which nothing is known."""
    made = [make_video(tmp_path / f"{n}.avi", frames=50, fps=25) for n in range(3)]
    (tmp_path / "x.avi").write_bytes(b"RIFF")
    return [Video(path.name, path, path.with_suffix(".h5")) for path in (*made, tmp_path / "x.avi")]


def test_an_estimate_of_time_and_disk(tmp_path, videos, monkeypatch):
    monkeypatch.setattr(estimating.shutil, "disk_usage", lambda out: SimpleNamespace(free=5 * 10**9))
    result = estimate_recording(videos * 100, [], tmp_path, 1e6 / 60)
    # 2 s each; patterns of 0.6 s and 32 steps of 3/60 s, twice; 2 s of the first picture, 0.8 s of fading, 2 s besides
    assert str(result) == "400 videos: about 1 h 15 min and 1.60 GB of recordings; 5.0 GB of disk are free"
    assert not result.short
    recorded = [{"recording": 60_000_000, "duration": 3_000_000}, {"status": "failed"}]
    result = estimate_recording(videos * 100, recorded, tmp_path, 1e6 / 60)
    assert "16.00 GB of recordings; 5.0 GB of disk are free, which is too little" in str(result)
    assert result.short
    # what recordings leave free at their end is needed, too
    for free, small in ((1_600_000_000 + RESERVE, False), (1_600_000_000 + RESERVE - 1, True)):
        monkeypatch.setattr(estimating.shutil, "disk_usage", lambda out, free=free: SimpleNamespace(free=free))
        assert estimate_recording(videos * 100, [], tmp_path, 1e6 / 60).short is small
        assert not estimate_recording([], [], tmp_path, 1e6 / 60).short


def test_an_estimate_of_nothing(tmp_path):
    found = estimate_recording([], [], tmp_path, 1e6 / 60)
    assert str(found).startswith("0 videos: about 0 s and 0.00 GB")
