"""Takes that fail, and recordings that aren't what the manifest says: with a camera and a monitor that do nothing."""

import errno
import json
from threading import Event
from types import SimpleNamespace

import cv2
import h5py
import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.batch.folder import Video, videos_in
from nvsdata.batch.manifest import sha256
from nvsdata.recording.camera import CameraError
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.rig import batch, status, take, verification, watch
from nvsdata.rig.batch import BatchOptions
from nvsdata.rig.cameras import Rig
from nvsdata.rig.playback import PlaybackLog
from nvsdata.rig.take import TakeRejected, VideoRecorder

DURATION = 10_000  # µs of each video
MONITOR = SimpleNamespace(
    size=(64, 48), region=(0, 0, 64, 48), refresh=16_667.0, stated=16_667.0, synced=False, scaling="aspect",
    wait=lambda until: None,
)  # fmt: skip
N = 50
SOUND = Events(np.arange(N) * 200, np.arange(N) % 40, np.arange(N) % 30, np.arange(N) % 2, (40, 30))


@pytest.fixture
def folder(tmp_path):
    """Three videos, which nothing decodes."""
    for name in ("a", "b", "c"):
        (tmp_path / "in/run").mkdir(parents=True, exist_ok=True)
        (tmp_path / f"in/run/{name}.avi").write_bytes(name.encode())
    return tmp_path


def recorded(folder, monkeypatch, fails=(), *, resume=False):
    """Record the folder; `fails` are the errors of its takes, in their order, None for one that succeeds."""
    fails, out = list(fails), folder / "out"

    def taken(camera, rig, video, raw, *, live):
        raw.write_bytes(b"")
        return SimpleNamespace(performance=PlaybackLog(16_667.0))

    def cut(take, video, inspector):
        target = video.target
        error = fails.pop(0) if fails else None
        if error is not None:
            raise error
        target.parent.mkdir(parents=True, exist_ok=True)
        nvsdata.write(SOUND, target)
        return {"recording": target.stat().st_size, "duration": DURATION, "events": N, "on": N // 2, "content": {}} | {
            "recording_sha256": sha256(target)
        }

    monkeypatch.setattr(take, "record_screen", taken)
    monkeypatch.setattr(take, "trim", cut)
    camera = SimpleNamespace(facts=SimpleNamespace(serial="x"), configure=lambda _: None, close=lambda: None)
    videos = videos_in(folder / "in", out)
    rig, options = Rig(lambda: camera, MONITOR, CameraSettings()), BatchOptions(resume=resume, until_full=True)
    with batch.manifest_of(out, videos, rig, options) as manifest:
        return batch.record_videos(videos, manifest, rig, options)


def lines(folder):
    _, *result = map(json.loads, (folder / "out/manifest.jsonl").read_text().splitlines())
    return result


def verified(folder):
    return verification.verify(videos_in(folder / "in", folder / "out"), folder / "out").faults


@pytest.mark.parametrize("error", [TakeRejected("no flash"), CameraError("unplugged")])
def test_a_take_that_failed_and_then_succeeded_has_not_failed(folder, monkeypatch, error):
    report = recorded(folder, monkeypatch, [error, None, error] if isinstance(error, TakeRejected) else [error])
    assert (report.done, report.kept, report.events, report.failed) == (3, 0, 3 * N, {})
    result = lines(folder)
    # a take that was wrong is done again after the others, one that the camera ended at once
    order = [("run/a.avi", 2), ("run/b.avi", 1), ("run/c.avi", 1)]
    if isinstance(error, TakeRejected):
        order = [("run/b.avi", 1), ("run/a.avi", 2), ("run/c.avi", 2)]
    assert [(line["video"], line["takes"]) for line in result] == order
    assert all(line["status"] == "recorded" and "reason" not in line for line in result)
    assert verified(folder) == {}


def test_a_video_that_failed_in_an_earlier_run_and_succeeds_in_this_one(folder, monkeypatch):
    rejected = TakeRejected("no flash")
    report = recorded(folder, monkeypatch, [rejected, None, None, rejected, rejected])
    assert (report.done, report.failed) == (2, {"run/a.avi": "no flash"})
    assert verified(folder) == {"run/a.avi": "isn't recorded: no flash"}
    report = recorded(folder, monkeypatch, resume=True)
    assert (report.done, report.kept, report.failed) == (1, 2, {})
    assert verified(folder) == {}
    # of two lines of a video the later counts
    assert [line["status"] for line in lines(folder) if line["video"] == "run/a.avi"] == ["failed", "recorded"]
    assert recorded(folder, monkeypatch, [rejected], resume=True).kept == 3


def state(folder):
    return json.loads((folder / "out/status.json").read_text())


def test_the_status_counts_the_batch_and_only_the_last_take_of_a_video(folder, monkeypatch):
    rejected = TakeRejected("no flash")
    with pytest.raises(OSError, match="No space left"):
        recorded(
            folder, monkeypatch, [rejected, None, OSError(errno.ENOSPC, "No space left on device", "out/run/c.h5")]
        )
    text, well = status.status_of(folder / "out")
    first, *others = text.splitlines()
    # with the reason
    assert first.startswith("stopped at 20")
    assert first.endswith("[Errno 28] No space left on device: 'out/run/c.h5'")
    assert others == ["1 of 3 recorded, 0 failed", "last take failed: run/a.avi: no flash"]
    assert not well
    recorded(folder, monkeypatch, [rejected], resume=True)
    text, well = status.status_of(folder / "out")
    assert text.splitlines()[1:] == ["3 of 3 recorded, 0 failed"]
    assert well
    assert (state(folder)["total"], state(folder)["left"], state(folder)["reason"]) == (3, 0, None)
    # a moment isn't stated twice
    assert ", began" not in text or text.count(state(folder)["updated"]) == 1
    recorded(folder, monkeypatch, resume=True)
    assert status.status_of(folder / "out")[0].splitlines()[1:] == ["3 of 3 recorded, 0 failed"]


def test_verification_updates_status_and_report(folder, monkeypatch):
    recorded(folder, monkeypatch)
    (folder / "out/run/b.h5").unlink()
    missing = f"{folder / 'out/run/b.h5'}: is missing"
    # the second time, too
    for _ in range(2):
        assert verified(folder) == {"run/b.avi": missing}
        text, well = status.status_of(folder / "out")
        assert text.startswith("verified at 20")
        assert text.splitlines()[1:] == ["2 of 3 recorded, 1 failed", f"failed: run/b.avi: {missing}"]
        assert not well
        assert "To record again: 1</h2>" in (folder / "out/report.html").read_text()
        assert "is missing" in (folder / "out/report.html").read_text()
    recorded(folder, monkeypatch, resume=True)
    assert verified(folder) == {}
    assert status.status_of(folder / "out")[1]
    assert "To record again" not in (folder / "out/report.html").read_text()


def test_a_status_is_written_in_place_on_a_full_disk(folder, monkeypatch):
    recorded(folder, monkeypatch)

    def full(path, content):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(status, "put", full)
    with pytest.raises(OSError, match="No space left"):
        status.Status(folder / "in", 3).set()
    with pytest.raises(ValueError, match="odd"), batch.ended_status(status.Status(folder / "out", 3)):
        raise ValueError("odd")
    assert (state(folder)["state"], state(folder)["reason"]) == ("stopped", "odd")


def test_progress_is_drawn_each_second_with_what_is_done(monkeypatch):
    drawn, enough = [], Event()

    class Bar:
        def doing(self, what):
            drawn.append(what)
            if len(set(drawn)) == 3:
                enough.set()

    monkeypatch.setattr(batch, "SHOWN_EVERY", 0.001)
    one = SimpleNamespace(state="recording", video="x" * 40 + "/a.avi")
    with batch._shown(Bar(), one) as show:
        for what, going in (("playing", "recording"), ("judging", "recording"), ("judging", "paused")):
            show(what)
            one.state = going
            count = len(drawn)
            while len(drawn) < count + 2:
                enough.wait(0.01)
    assert list(dict.fromkeys(drawn))[-3:] == ["x" * 24 + "/a.avi: playing", "x" * 24 + "/a.avi: judging", "paused"]


def moved(t):
    return Events(np.sort(t), SOUND.x, SOUND.y, SOUND.p, SOUND.sensor_size)


@pytest.mark.parametrize(
    ("events", "fault"),
    [
        (SOUND, None),
        (moved(np.append(SOUND.t[:-1], DURATION - 1)), "was changed since it was recorded"),
        (moved(np.append(SOUND.t[:-1], DURATION)), "outside the video's 10000 µs"),
        (moved(np.append(SOUND.t[:-1], DURATION + 1)), "outside the video's 10000 µs"),
        (moved(np.append(SOUND.t[:-1], 10**9)), "outside the video's 10000 µs"),
        (moved(SOUND.t + DURATION), "outside the video's 10000 µs"),
        (moved(SOUND.t - 1), "outside the video's 10000 µs"),
        (SOUND[1:], "contains 49 events, not the 50 that were recorded"),
    ],
)
def test_verify_sees_events_that_were_not_recorded(folder, monkeypatch, events, fault):
    recorded(folder, monkeypatch)
    if events is not SOUND:
        nvsdata.write(events, folder / "out/run/b.h5")
    found = verified(folder)
    if fault is None:
        assert found == {}
        return
    assert list(found) == ["run/b.avi"]
    assert fault in found["run/b.avi"]
    # noted, so that the next run records it again
    report = recorded(folder, monkeypatch, resume=True)
    assert (report.done, report.kept, report.failed) == (1, 2, {})
    assert verified(folder) == {}


def test_verify_sees_files_that_are_gone_or_damaged(folder, monkeypatch):
    recorded(folder, monkeypatch)
    (folder / "out/run/a.h5").unlink()
    (folder / "out/run/c.h5").write_bytes((folder / "out/run/c.h5").read_bytes()[:500])
    found = verified(folder)
    assert sorted(found) == ["run/a.avi", "run/c.avi"]
    assert "a.h5" in found["run/a.avi"]
    assert "c.h5" in found["run/c.avi"]


def test_verify_sees_columns_that_were_overwritten(folder, monkeypatch):
    """As many events, at times within the video, but others."""
    recorded(folder, monkeypatch)
    target = folder / "out/run/b.h5"
    target.chmod(0o644)
    with h5py.File(target, "r+") as file:
        file["events/x"][:] = file["events/x"][:][::-1]
    assert verified(folder) == {"run/b.avi": f"{target}: was changed since it was recorded"}


@pytest.mark.parametrize("content", [b"B", b"longer"])
def test_verify_sees_videos_that_were_changed(folder, monkeypatch, content):
    recorded(folder, monkeypatch)
    (folder / "in/run/b.avi").write_bytes(content)
    assert list(verified(folder)) == ["run/b.avi"]
    assert "is no longer the video" in verified(folder)["run/b.avi"]


def test_verify_sees_stray_files(folder, monkeypatch):
    recorded(folder, monkeypatch)
    (folder / "out/run/copy of b.h5").write_bytes((folder / "out/run/b.h5").read_bytes())
    (folder / "out/run/.hidden").write_bytes(b"")
    (folder / "out/contact-sheet-001.png").write_bytes(b"")
    (folder / "in/run/a.avi").unlink()
    (folder / "out/notes.md").write_bytes(b"")
    others = {
        "notes.md": "isn't a recording of any of the videos",
        "run/a.h5": "is a recording of run/a.avi, and that video is gone",
        "run/copy of b.h5": "isn't a recording of any of the videos",
    }
    for limit in (None, 1):
        found = verification.verify(videos_in(folder / "in", folder / "out"), folder / "out", limit)
        assert (found.faults, found.others, found.well) == ({}, others, False)
        assert found.messages()[-1].endswith(
            "recordings are sound, but datasets would read other files in the folder as recordings: 2; move them away"
        )
    assert status.status_of(folder / "out")[1] is False
    assert "move them away" in status.status_of(folder / "out")[0]
    for name in ("a.h5", "copy of b.h5"):
        (folder / "out/run" / name).unlink()
    found = verification.verify(videos_in(folder / "in", folder / "out"), folder / "out")
    assert (list(found.others), found.well) == (["notes.md"], True)
    assert found.messages()[-1] == "2 of 2 recordings are sound; other files, which datasets don't read: 1"
    assert status.status_of(folder / "out")[1] is True
    # and it changes nothing about the recordings
    assert all(line["status"] == "recorded" for line in lines(folder))


def test_takes_that_all_fail_pause_the_batch_and_cost_no_video_its_takes(folder, monkeypatch, capsys):
    """Six in a row, of three videos: then the cause passes."""
    waited = []
    monkeypatch.setattr(MONITOR, "wait", waited.append)
    report = recorded(folder, monkeypatch, [TakeRejected("0 events")] * 6)
    assert (report.done, report.failed) == (3, {})
    assert len(waited) == 1
    assert [line["takes"] for line in lines(folder)] == [1, 1, 1]
    output = capsys.readouterr().err
    assert "6 takes in a row failed, the last one of run/c.avi: 0 events; the batch continues in 10 minutes" in output
    state = json.loads((folder / "out/status.json").read_text())
    assert (state["state"], state["done"], state["failed"], state["left"], state["in_a_row"]) == ("done", 3, 0, 0, 0)


@pytest.mark.parametrize("error", [OSError(errno.EIO, "Input/output error"), ValueError("odd"), cv2.error("odd")])
def test_a_disk_that_fails_is_no_fault_of_the_videos(folder, monkeypatch, error):
    """The takes count as others do: the batch pauses, and the last ones are kept."""
    waited = []
    monkeypatch.setattr(MONITOR, "wait", waited.append)
    monkeypatch.setattr(watch, "KEPT", 2)
    kept = []
    monkeypatch.setattr(batch, "prune", lambda takes: (watch.prune(takes), kept.append(len(list(takes.rglob("*.h5"))))))
    report = recorded(folder, monkeypatch, [error] * 6)
    assert (report.done, report.failed, len(waited)) == (3, {}, 1)
    assert kept == [1, 2, 2, 2, 2, 2]


def test_a_video_that_is_gone_fails_and_the_rest_goes_on(folder, monkeypatch):
    (folder / "in/run/b.avi").unlink()
    videos = [Video(f"run/{n}.avi", folder / f"in/run/{n}.avi", folder / f"out/run/{n}.h5") for n in "abc"]
    monkeypatch.setattr("test_takes.videos_in", lambda *_: videos)
    report = recorded(folder, monkeypatch)
    assert report.done == 2
    assert "No such file" in report.failed["run/b.avi"]


def test_a_full_disk_ends_the_batch_at_once(folder, monkeypatch):
    with pytest.raises(OSError, match="No space left"):
        recorded(folder, monkeypatch, [OSError(errno.ENOSPC, "No space left on device")])


def test_a_last_take_that_fails_with_all_others_is_none_of_its_video(folder, monkeypatch):
    """Two takes for each video; the second of a.avi is the fifth of six in a row."""
    for name in "def":
        (folder / f"in/run/{name}.avi").write_bytes(name.encode())
    monkeypatch.setattr(batch, "TAKES", 2)
    monkeypatch.setattr(MONITOR, "wait", lambda until: None)
    bad = TakeRejected("0 events")
    report = recorded(folder, monkeypatch, [bad, None, *[bad] * 7])
    assert (report.done, report.failed) == (6, {})
    result = [(line["video"][4], line["status"]) for line in lines(folder)]
    assert result[:2] == [("b", "recorded"), ("a", "failed")]
    assert sorted(result[2:]) == [(name, "recorded") for name in "acdef"]
    state = json.loads((folder / "out/status.json").read_text())
    assert (state["done"], state["failed"], state["left"]) == (6, 0, 0)


def test_a_recording_that_is_cut_short_counts_as_failed_everywhere(folder, monkeypatch):
    whole, cut_off = VideoRecorder.record, {"status": "truncated", "reason": "cut off"}
    monkeypatch.setattr(VideoRecorder, "record", lambda *how: whole(*how) | cut_off)
    report = recorded(folder, monkeypatch)
    assert (report.done, sorted(report.failed)) == (3, [f"run/{name}.avi" for name in "abc"])
    state = json.loads((folder / "out/status.json").read_text())
    assert (state["done"], state["failed"]) == (0, 3)


def test_a_batch_that_gives_up_says_so(folder, monkeypatch):
    monkeypatch.setattr(watch, "MOST_PAUSES", 1)
    with pytest.raises(watch.BatchStopped, match="the batch ended after 1 pauses"):
        recorded(folder, monkeypatch, [TakeRejected("0 events")] * 12)
    assert json.loads((folder / "out/status.json").read_text())["state"] == "stopped"
    # and goes on when it is told to
    assert recorded(folder, monkeypatch, resume=True).done == 3


def test_bad_videos_at_the_end_of_a_batch_are_not_waited_for(folder, monkeypatch):
    """Three that can't be recorded, beside one that could: it is tried once more, and then they are given up."""
    (folder / "in/run/_.avi").write_bytes(b"good")
    waited, bad = [], TakeRejected("too few events")
    monkeypatch.setattr(MONITOR, "wait", waited.append)
    # the good one, six takes of the others, the good one again, and their last takes
    report = recorded(folder, monkeypatch, [None, *[bad] * 6, None, *[bad] * 3])
    assert (report.done, sorted(report.failed)) == (1, [f"run/{name}.avi" for name in "abc"])
    assert waited == []
    assert [line["takes"] for line in lines(folder)] == [1, 3, 3, 3]
    assert not list((folder / "out/.takes").rglob("probe/*"))
    assert verified(folder).keys() == {f"run/{name}.avi" for name in "abc"}


def test_a_batch_whose_good_videos_fail_too_waits(folder, monkeypatch):
    (folder / "in/run/_.avi").write_bytes(b"good")
    waited, bad = [], TakeRejected("0 events")
    monkeypatch.setattr(MONITOR, "wait", waited.append)
    report = recorded(folder, monkeypatch, [None, *[bad] * 7])
    assert (report.done, report.failed, len(waited)) == (4, {}, 1)


def test_a_good_video_that_is_gone_is_no_probe(folder, monkeypatch):
    (folder / "in/run/_.avi").write_bytes(b"good")
    waited, bad = [], TakeRejected("0 events")
    monkeypatch.setattr(MONITOR, "wait", waited.append)
    cutting = iter([lambda: None, *[lambda: (folder / "in/run/_.avi").unlink(missing_ok=True)] * 99])
    recorded_ = VideoRecorder.record

    def watched(*how):
        next(cutting)()
        return recorded_(*how)

    monkeypatch.setattr(VideoRecorder, "record", watched)
    report = recorded(folder, monkeypatch, [None, *[bad] * 6])
    # the batch waits, and goes on
    assert (report.done, report.failed, len(waited)) == (4, {}, 1)
