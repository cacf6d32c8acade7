"""Folders of videos, and the manifest of a folder of recordings, with files that nothing decodes."""

import errno
import hashlib
import json
import os

import pytest
from clips import write_video

from nvsdata.batch import manifest as module
from nvsdata.batch import run as runs
from nvsdata.batch.folder import Video, check_name, is_fatal, videos_in
from nvsdata.batch.manifest import Manifest, file_facts, sha256
from nvsdata.batch.run import FolderReport, FolderRun, catch_failure
from nvsdata.common.errors import FormatError
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.job import Job, convert

ENDINGS = ".3gp .avi .flv .gif .m2ts .m4v .mkv .mov .mp4 .mpeg .mpg .mts .ogv .ts .webm .wmv"


def test_every_video_below_a_folder_in_order(tmp_path):
    for name in ("b/x.MP4", "b/x.avi", "a.mkv", "b/y.avi", "b/x.txt", "c/x.avi"):
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / name).write_bytes(b"")
    found = videos_in(tmp_path / "in", tmp_path / "out")
    assert [video.name for video in found] == ["a.mkv", "b/x.MP4", "b/x.avi", "b/y.avi", "c/x.avi"]
    assert [video.path for video in found] == [tmp_path / "in" / video.name for video in found]
    # those side by side that differ by their endings alone keep them
    targets = [video.target.relative_to(tmp_path / "out").as_posix() for video in found]
    assert targets == ["a.h5", "b/x.MP4.h5", "b/x.avi.h5", "b/y.h5", "c/x.h5"]
    assert videos_in(tmp_path / "in", tmp_path / "out", limit=2) == found[:2]
    (one,) = videos_in(tmp_path / "in/b/x.txt", tmp_path / "out", "text")
    assert (one.name, one.target) == ("x.txt", tmp_path / "out/x.txt")
    for format, ending in (("aedat2", "aedat"), ("aedat3", "aedat3")):
        assert videos_in(tmp_path / "in", tmp_path / "out", format)[0].target.name == f"a.{ending}"


def test_where_there_are_no_videos(tmp_path):
    with pytest.raises(FileNotFoundError) as none:
        videos_in(tmp_path, tmp_path)
    assert str(none.value) == f"no videos in {tmp_path} and its subfolders; known extensions are {ENDINGS}"
    with pytest.raises(FileNotFoundError, match="gone: no such folder or video"):
        videos_in(tmp_path / "gone", tmp_path)
    with pytest.raises(
        ValueError, match=r"^format must be one of hdf5, hdf5-gzip, aedat2, aedat3, aedat4, text, not 'h5'$"
    ):
        videos_in(tmp_path, tmp_path, "h5")
    check_name("a\nü.avi")
    with pytest.raises(FormatError, match="a name that isn't UTF-8"):
        check_name("a\udcff.avi")


@pytest.mark.parametrize(
    ("number", "own", "others"),
    [
        (errno.ENOSPC, True, True),
        (errno.EDQUOT, True, True),
        (errno.EROFS, True, True),
        (errno.EACCES, False, True),
        (errno.EPERM, False, True),
        (errno.ENOENT, False, False),
        (None, False, False),
    ],
)
def test_which_errors_other_videos_would_have(tmp_path, number, own, others):
    assert is_fatal(OSError(number, "x", str(tmp_path / "a.avi")), tmp_path / "a.avi") is own
    assert is_fatal(OSError(number, "x", str(tmp_path / "out")), tmp_path / "a.avi") is others


@pytest.fixture
def video(tmp_path):
    """A video whose recording is there."""
    (tmp_path / "a.avi").write_bytes(b"video")
    (tmp_path / "a.h5").write_bytes(b"recording")
    return Video("a.avi", tmp_path / "a.avi", tmp_path / "a.h5")


def line(**changed):
    digest = hashlib.sha256(b"video").hexdigest()
    return {"video": "a.avi", "status": "done", "bytes": 5, "sha256": digest, "recording": 9} | changed


def opened(folder, made=None, kind="things", extra=None):
    return Manifest(folder, kind, {"format": "hdf5"} if made is None else made, ["a.avi"], extra)


@pytest.mark.parametrize(
    ("changed", "has"),
    [({}, True), ({"status": "failed"}, False), ({"bytes": 6}, False), ({"recording": 8}, False), (None, False)],
)
def test_which_recordings_a_manifest_has(tmp_path, video, changed, has):
    with opened(tmp_path) as manifest:
        if changed is not None:
            manifest.add(line(**changed))
        assert manifest.has(video, ("done", "short")) is has
    with opened(tmp_path) as manifest:
        assert manifest.has(video, ("done",)) is has
        video.target.unlink()
        assert not manifest.has(video, ("done",))


def test_a_video_that_changed_is_noticed_by_its_content(tmp_path, video, monkeypatch):
    read = []
    monkeypatch.setattr(module, "sha256", lambda path: read.append(path) or sha256(path))
    with opened(tmp_path) as manifest:
        manifest.add(line(modified=video.path.stat().st_mtime_ns))
        assert manifest.has(video, ("done",))
        assert not read
        # copied, or touched
        os.utime(video.path, (1, 1))
        assert manifest.has(video, ("done",))
        assert len(read) == 1
        # another of the same length
        video.path.write_bytes(b"VIDEO")
        assert not manifest.has(video, ("done",))

        def unreadable(path):
            raise PermissionError(path)

        monkeypatch.setattr(module, "sha256", unreadable)
        assert not manifest.has(video, ("done",))
        # a line of before times were kept
        video.path.write_bytes(b"video")
        monkeypatch.setattr(module, "sha256", sha256)
        manifest.add(line())
        assert manifest.has(video, ("done",))


def test_a_manifest_s_first_line_and_which_others_fit(tmp_path):
    made = {"format": "hdf5", "settings": {"b": (1, 2), "a": 3}}
    with opened(tmp_path, made, extra={"monitor": 5}):
        pass
    text = (tmp_path / "manifest.jsonl").read_text()
    head = json.loads(text)
    assert list(head) == ["things", "format", "settings", "monitor", "settings_sha256", "versions", "videos"]
    same = json.dumps({"format": "hdf5", "settings": {"a": 3, "b": [1, 2]}})
    assert (head["things"], head["monitor"]) == (1, 5)
    assert head["settings_sha256"] == hashlib.sha256(same.encode()).hexdigest()
    assert sorted(head["versions"]) == ["h5py", "numpy", "nvsdata", "opencv", "python"]
    # as long as no video has a line, others may begin anew
    with opened(tmp_path, {"format": "text"}) as manifest:
        manifest.add(line())
    with pytest.raises(ValueError, match=r"is not a manifest of others: choose another folder"):
        opened(tmp_path, {"format": "text"}, "others")
    with pytest.raises(ValueError, match=r"has recordings made with format text, not hdf5, a None, not 3: choose"):
        opened(tmp_path, {"format": "hdf5", "a": 3})
    with pytest.raises(ValueError, match=r"has recordings made with a None, not 3: choose"):
        opened(tmp_path, {"format": "text", "settings": {"a": 3}})
    with opened(tmp_path, {"format": "text"}, extra={"monitor": 9}) as manifest:
        manifest.add(line(status="failed"))
        # the last line of a video counts
        assert manifest.videos == {"a.avi": line(status="failed")}
    with opened(tmp_path, {"format": "text"}) as manifest:
        assert (len(manifest.lines), manifest.videos) == (2, {"a.avi": line(status="failed")})


def test_what_a_run_over_a_folder_counts(tmp_path, video, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(runs.time, "monotonic", lambda: now[0])
    others = [Video(f"{n}.avi", tmp_path / f"{n}.avi", tmp_path / f"{n}.h5") for n in range(3)]
    with opened(tmp_path) as manifest:
        manifest.add(line())
        with FolderRun(manifest, [video, *others], ("done", "short"), "testing") as run:
            assert run.waiting == others
            assert run.report == FolderReport(0, 1, 0, {})
            assert (run.bar.total, run.bar.disable) == (3, True)
            said = []
            monkeypatch.setattr(run.bar, "set_postfix_str", lambda text, refresh: said.append((text, refresh)))
            for one, given in zip(
                others,
                (
                    {"status": "done", "events": 5_000},
                    {"status": "failed", "reason": "why"},
                    {"status": "short", "events": 1_000},
                ),
                strict=True,
            ):
                run.add({"video": one.name} | given)
                now[0] += 2
        assert run.report == FolderReport(2, 1, 6_000, {"1.avi": "why"})
        assert said == [("5,000,000 events/s", False), ("2,500 events/s", False), ("1,500 events/s", False)]
        assert set(manifest.videos) == {"a.avi", "0.avi", "1.avi", "2.avi"}


def test_what_is_noted_of_a_video(tmp_path, video):
    modified = video.path.stat().st_mtime_ns
    assert file_facts(video) == {"bytes": 5, "modified": modified, "sha256": hashlib.sha256(b"video").hexdigest()}
    assert sha256(video.target) == hashlib.sha256(b"recording").hexdigest()
    full, odd = OSError(errno.ENOSPC, "full"), FormatError("a", "b")
    result = {}
    with catch_failure(video, result):
        pass
    assert result == {}
    for error in (ValueError("odd"), OSError("odd"), MemoryError("odd"), runs.cv2.error("odd")):
        result = {}
        with catch_failure(video, result):
            raise error
        assert result == {"status": "failed", "reason": "odd"}
    for error, more in ((full, ()), (odd, (FormatError,)), (KeyError("x"), ())):
        with pytest.raises(type(error)), catch_failure(video, result := {}, more):
            raise error
        assert result == {}


def test_a_video_that_is_gone_fails_and_the_rest_goes_on(tmp_path):
    for name in ("a", "b"):
        write_video(tmp_path / f"in/{name}.avi")
    gone, there = videos_in(tmp_path / "in", tmp_path / "out")
    gone.path.unlink()
    result = [convert(Job(video, PIX2NVS(), None, None)) for video in (gone, there)]
    assert [line["status"] for line in result] == ["failed", "converted"]
    assert "No such file" in result[0]["reason"]
    assert result[1] == result[1] | file_facts(there)
