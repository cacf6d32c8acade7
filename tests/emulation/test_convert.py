import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from clips import damage, moving_square, write_stream, write_video
from processes_of_others import dead_owner

import nvsdata
from nvsdata import EventFolder
from nvsdata.batch import cluster
from nvsdata.batch.folder import FORMATS, Video, videos_in
from nvsdata.batch.manifest import as_before
from nvsdata.cli import main
from nvsdata.common.locks import OutputInUse, locked
from nvsdata.emulation import PIX2NVS, convert, preview
from nvsdata.emulation.convert import convert_videos, plan
from nvsdata.emulation.estimate import estimate_conversion
from nvsdata.formats import hdf5
from nvsdata.plots import event_image
from nvsdata.video.frames import frames_of
from nvsdata.video.view import VideoView


@pytest.fixture
def videos(tmp_path):
    for i, name in enumerate(("run/a", "run/b", "walk/c", "walk/deep/d")):
        write_video(tmp_path / f"videos/{name}.avi", moving_square(seed=i))
    (tmp_path / "videos/readme.txt").write_text("no video")
    return tmp_path / "videos"


def lines(out):
    return [json.loads(line) for line in (out / "manifest.jsonl").read_text().splitlines()]


def test_a_folder_of_videos_becomes_a_dataset(videos):
    report = convert_videos(videos)
    out = videos.with_name("videos-events")
    assert (report.done, report.kept, report.failed) == (4, 0, {})
    dataset = EventFolder(out)
    assert dataset.classes == ["run", "walk"]
    assert len(dataset) == 4
    events, label = dataset[1]
    assert label == 0
    assert events == PIX2NVS().emulate(videos / "run/b.avi")
    head, *rest = lines(out)
    assert head["settings"]["threshold"] == 0.2
    assert set(head["versions"]) >= {"nvsdata", "opencv"}
    assert [line["video"] for line in rest] == ["run/a.avi", "run/b.avi", "walk/c.avi", "walk/deep/d.avi"]
    assert rest[1]["events"] == len(events)
    assert rest[1]["frames"] == 12
    assert len(rest[0]["sha256"]) == 64
    assert report.events == sum(line["events"] for line in rest)


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_holds_the_same_events(videos, format):
    convert_videos(videos / "run/a.avi", videos / "out", format=format)
    expected = PIX2NVS().emulate(videos / "run/a.avi")
    found = nvsdata.read(videos / f"out/a{FORMATS[format]}")
    assert (found.t == expected.t).all()
    assert (found.x == expected.x).all()


def test_a_second_run_does_only_what_is_missing(videos, tmp_path):
    out = tmp_path / "out"
    assert convert_videos(videos, out, limit=2).done == 2
    assert convert_videos(videos, out).done == 2
    (out / "run/a.h5").unlink()
    write_video(videos / "run/b.avi", moving_square(20))
    report = convert_videos(videos, out)
    assert (report.done, report.kept) == (2, 2)
    assert len(nvsdata.read(out / "run/b.h5")) == len(PIX2NVS().emulate(videos / "run/b.avi"))
    with pytest.raises(ValueError, match=r"made with threshold 0\.2, not 0\.3: choose another folder"):
        convert_videos(videos, out, PIX2NVS(threshold=0.3))
    with pytest.raises(ValueError, match="made with format hdf5, not text"):
        convert_videos(videos, out, format="text")


def test_a_video_that_is_added_beside_another_gives_it_no_new_name(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out)
    write_video(videos / "run/a.mkv")
    report = convert_videos(videos, out)
    assert (report.done, report.kept) == (1, 4)
    assert sorted(path.name for path in (out / "run").iterdir()) == ["a.h5", "a.mkv.h5", "b.h5"]
    # a.mkv was first, and is called a.h5 there
    (out / "manifest.jsonl").unlink()
    made = [Video("run/a.mkv", videos / "run/a.mkv", out / "run/a.h5"), Video("b", videos, out / "run/a.h5")]
    with pytest.raises(ValueError, match=r"b and run/a\.mkv would both be recorded to .*a\.h5: rename one of them"):
        as_before(made, [], out)


def test_after_a_run_was_killed(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out, limit=2)
    manifest = out / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes()[:-30])
    (out / f"run/.c.h5.{dead_owner()}-x7.part").write_bytes(b"half")
    report = convert_videos(videos, out)
    assert (report.done, report.kept) == (3, 1)
    assert not list(out.rglob(".*.part"))
    assert len(lines(out)) == 5


def test_a_killed_process_leaves_nothing_half_written(videos, tmp_path):
    """SIGKILL in the middle of a long video: the next run starts with the video in hand."""
    write_video(videos / "run/b.avi", moving_square(800, (320, 240)))
    out = tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-m", "nvsdata", "convert-videos", videos, "--out", out])
    deadline = time.monotonic() + 60
    while not (out / "manifest.jsonl").exists() or len(lines(out)) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    for path in out.rglob("*.h5"):
        if not path.name.startswith("."):
            nvsdata.read(path)
    report = convert_videos(videos, out)
    assert report.done + report.kept == 4
    assert report.kept >= 1


def test_broken_videos_are_reported_and_the_rest_goes_on(videos, tmp_path, capfd):
    (videos / "run/a.avi").write_bytes(b"garbage")
    whole = write_video(videos / "run/b.avi", moving_square(60)).read_bytes()
    (videos / "run/b.avi").write_bytes(whole[: len(whole) // 2])
    write_video(videos / "walk/c.avi", moving_square(1))
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out")]) == 1
    out, err = capfd.readouterr()
    assert "2 converted, 0 already existed, 2 failed" in out
    assert "run/a.avi: " in err
    assert "contains no video" in err
    assert "of 60 frames" in err
    status = {line["video"]: line["status"] for line in lines(tmp_path / "out")[1:]}
    assert status == {
        "run/a.avi": "failed",
        "run/b.avi": "truncated",
        "walk/c.avi": "converted",
        "walk/deep/d.avi": "converted",
    }
    # what there is of the one that is cut off
    assert len(nvsdata.read(tmp_path / "out/run/b.h5")) > 0
    assert len(nvsdata.read(tmp_path / "out/walk/c.h5")) == 0


def test_a_full_disk_stops_the_run_and_loses_nothing(videos, tmp_path, monkeypatch):
    out = tmp_path / "out"
    write, count = hdf5.FORMAT.write, iter(range(9))

    def fills_up(pieces, path):
        if next(count) == 2:
            path.write_bytes(b"half")
            raise OSError(errno.ENOSPC, "No space left on device")
        write(pieces, path)

    monkeypatch.setattr(hdf5.FORMAT, "write", fills_up)
    with pytest.raises(OSError, match="No space left"):
        convert_videos(videos, out)
    assert not list(out.rglob(".*.part"))
    monkeypatch.undo()
    report = convert_videos(videos, out)
    assert (report.done, report.kept) == (2, 2)


def test_an_interrupted_run_goes_on(videos, tmp_path, monkeypatch):
    out, real = tmp_path / "out", convert.convert

    def interrupted(job, progress):
        if job.video.name.startswith("walk"):
            raise KeyboardInterrupt
        return real(job)

    monkeypatch.setattr(convert, "convert", interrupted)
    assert main(["convert-videos", str(videos), "--out", str(out)]) == 130
    monkeypatch.undo()
    assert convert_videos(videos, out).kept == 2


def test_two_processes_do_as_one(videos, tmp_path):
    convert_videos(videos, tmp_path / "one")
    convert_videos(videos, tmp_path / "two", jobs=2)
    assert sorted_lines(tmp_path / "one") == sorted_lines(tmp_path / "two")
    for path in (tmp_path / "one").rglob("*.h5"):
        other = tmp_path / "two" / path.relative_to(tmp_path / "one")
        assert nvsdata.read(path) == nvsdata.read(other)


def sorted_lines(out):
    kept = ("video", "status", "sha256", "events", "frames", "recording")
    return sorted([line.get(name) for name in kept] for line in lines(out)[1:])


def test_names_that_differ_by_extension_only(tmp_path):
    write_video(tmp_path / "v/a/x.avi")
    (tmp_path / "v/a/x.mp4").write_bytes((tmp_path / "v/a/x.avi").read_bytes())
    convert_videos(tmp_path / "v", tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out/a").iterdir()) == ["x.avi.h5", "x.mp4.h5"]


def test_wrong_arguments(videos, tmp_path, capsys):
    with pytest.raises(FileNotFoundError, match="no such folder"):
        convert_videos(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="no videos in"):
        convert_videos(tmp_path / "empty")
    with pytest.raises(ValueError, match="format must be one of hdf5"):
        convert_videos(videos, format="h5")
    (tmp_path / "file").touch()
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "file")]) == 1
    assert str(tmp_path / "file") in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["convert-videos", str(videos), "--set", "threshold=0"])
    assert "threshold must be at least" in capsys.readouterr().err
    (tmp_path / "out").mkdir()
    (tmp_path / "out/manifest.jsonl").write_text("[]\n")
    with pytest.raises(ValueError, match="not a manifest of nvsdata-videos"):
        convert_videos(videos, tmp_path / "out")


def test_a_dry_run_writes_nothing_and_settings_have_their_names(videos, tmp_path, capsys):
    words = "--preset table-3.3-row-1 --set max_events=5 --set new=true --set seed=3 --dry-run --limit 1".split()
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out"), *words]) == 0
    out = capsys.readouterr().out
    assert "a.avi -> " in out
    assert "b.avi" not in out
    for setting in ("t_log=20", "max_events=5", "new=True", "seed=3"):
        assert setting in out
    assert not (tmp_path / "out").exists()


def test_a_cluster_that_loses_a_worker_does_as_one_machine(tmp_path):
    distributed = pytest.importorskip("distributed")
    for i in range(8):
        write_video(tmp_path / f"v/{'ab'[i % 2]}/{i}.avi", moving_square(40, (160, 120), i))
    convert_videos(tmp_path / "v", tmp_path / "one")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        victim = cluster.workers[0].pid
        seen = []
        real = convert.as_done

        def kills_one(*arguments):
            for found in real(*arguments):
                if not seen:
                    os.kill(victim, signal.SIGKILL)
                seen.append(found)
                yield found

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(convert, "as_done", kills_one)
            report = convert_videos(tmp_path / "v", tmp_path / "many", scheduler=cluster.scheduler_address)
    assert (report.done, report.failed) == (8, {})
    assert sorted_lines(tmp_path / "one") == sorted_lines(tmp_path / "many")
    assert not list((tmp_path / "many").rglob(".*.part"))


@pytest.mark.parametrize("lost", ["the workers", "the scheduler"])
def test_a_cluster_without_workers_ends_the_run_which_resumes(videos, tmp_path, monkeypatch, capsys, lost):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "CHECK_S", 0.1)
    monkeypatch.setattr(cluster, "PATIENCE_S", 0.5)
    # a client that ends looks for a lost scheduler for this long, 30 s unless set
    timeout = pytest.importorskip("dask").config.set({"distributed.comm.timeouts.connect": "1s"})
    there = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with timeout, distributed.LocalCluster(**there) as local:
        seen = []
        real = convert.as_done

        def loses(*arguments):
            for found in real(*arguments):
                if not seen and lost == "the workers":
                    local.scale(0)
                elif not seen:
                    local.sync(local.scheduler.close)
                seen.append(found)
                yield found

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(convert, "as_done", loses)
            many = videos / "many"
            for i in range(6):
                write_video(many / f"{i}.avi", moving_square(40, (160, 120), i))
            command = [
                "convert-videos",
                str(many),
                "--out",
                str(tmp_path / "out"),
                "--scheduler",
                local.scheduler_address,
            ]
            assert main(command) == 1
    err = capsys.readouterr().err
    if lost == "the workers":
        assert f"no worker at {local.scheduler_address}: waiting for one, at most 0 s\n" in err
        assert f"nvsdata convert-videos: no worker at {local.scheduler_address} for 0 s\n" in err
    else:
        assert f"nvsdata convert-videos: the scheduler at {local.scheduler_address} is gone\n" in err
    assert "of 6 videos are done: the same command resumes\n" in err
    done = len(lines(tmp_path / "out")) - 1
    report = convert_videos(videos / "many", tmp_path / "out")
    assert (report.done, report.kept) == (6 - done, done)


def test_ctrl_c_ends_all_processes_at_once(videos, tmp_path):
    """As a terminal sends it: to the whole group. What is in hand is given up, not half-written."""
    write_video(videos / "long/0.avi", moving_square(1200, (320, 240)))
    shutil.copy(videos / "long/0.avi", videos / "long/1.avi")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "nvsdata", "convert-videos", videos, "--out", out, "--jobs", "2"]
    process = subprocess.Popen(
        command,
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
        # a shell that runs the tests in the background has interrupts ignored, and that is inherited
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    deadline = time.monotonic() + 60
    while not list((out / "long").rglob(".*.part")):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert not list(out.rglob(".*.part"))
    for path in out.rglob("*.h5"):
        nvsdata.read(path)


def die(job):
    os._exit(9)


def test_a_process_that_is_killed_ends_the_run_with_a_word(videos, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(convert, "convert", die)
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out"), "--jobs", "2"]) == 1
    err = capsys.readouterr().err
    assert "0 of 4 videos are done: the same command resumes" in err
    assert "was killed (out of memory?)" in err
    monkeypatch.undo()
    assert convert_videos(videos, tmp_path / "out").done == 4


def test_names_with_newlines_work_and_others_than_utf8_are_refused_at_the_beginning(tmp_path, capsys):
    odd = tmp_path / "videos/a\nb.avi"
    write_video(tmp_path / "videos/x.avi", moving_square())
    os.rename(tmp_path / "videos/x.avi", odd)
    out = tmp_path / "out"
    for kept in (0, 1):
        assert convert_videos(odd.parent, out).kept == kept
    assert len(nvsdata.read(out / "a\nb.h5")) > 0
    bad = os.fsdecode(os.fsencode(tmp_path / "videos") + b"/\xff.avi")
    try:
        os.rename(odd, bad)
    except OSError:
        pytest.skip("this system has UTF-8 names only")
    assert main(["convert-videos", str(odd.parent), "--out", str(tmp_path / "none")]) == 1
    assert "isn't UTF-8" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
    with pytest.raises(nvsdata.FormatError, match="isn't UTF-8"):
        PIX2NVS().emulate(bad)


def test_the_command_says_by_its_exit_code_whether_any_video_failed(videos, tmp_path, capsys):
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out")]) == 0
    assert "4 converted, 0 already existed, 0 failed" in capsys.readouterr().out
    (videos / "run/broken.avi").write_bytes(b"no video at all" * 100)
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out")]) == 1
    found = capsys.readouterr()
    assert "run/broken.avi" in found.err
    assert "0 converted, 4 already existed, 1 failed" in found.out
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "other"), "--dry-run"]) == 0
    assert not (tmp_path / "other").exists()


def test_frames_that_no_chip_of_aedat_2_has_are_refused_before_the_batch(videos, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(ValueError, match=r"AEDAT 2\.0 is written for sensors up to 346x260, not 640x480"):
        convert_videos(videos, out, format="aedat2", size=(640, 480))
    large = [np.zeros((300, 400, 3), np.uint8)] * 2
    write_video(tmp_path / "large/b.avi", large)
    (tmp_path / "large/a.avi").write_bytes(b"no video")
    with pytest.raises(ValueError, match="not 400x300"):
        convert_videos(tmp_path / "large", out, format="aedat2")
    assert not out.exists()
    # a part of it may fit
    report = convert_videos(tmp_path / "large", out, format="aedat2", view=VideoView(crop=(0, 0, 100, 100)))
    assert (report.done, list(report.failed)) == (1, ["a.avi"])


def test_shards_of_other_settings_are_refused_and_nothing_is_joined(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out, shard=(1, 2))
    with pytest.raises(ValueError, match=r"manifest-1-of-2\.jsonl has recordings made with other settings"):
        convert_videos(videos, out, PIX2NVS(threshold=0.5), shard=(2, 2))
    with pytest.raises(ValueError, match="other settings"):
        convert_videos(videos, out, PIX2NVS(threshold=0.5))
    assert (out / "manifest-1-of-2.jsonl").exists()
    with pytest.raises(ValueError, match="overwrite can't be combined with shards"):
        convert_videos(videos, out, shard=(1, 2), overwrite=True)
    report = convert_videos(videos, out)
    assert (report.done, report.kept) == (2, 2)
    with pytest.raises(ValueError, match="other settings"):
        convert_videos(videos, out, PIX2NVS(threshold=0.5), shard=(1, 2))


def test_more_shards_than_videos(videos, tmp_path):
    report = convert_videos(videos, tmp_path / "out", shard=(7, 9))
    assert (report.done, report.kept) == (0, 0)


def test_shards_that_overlap_are_refused(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out, shard=(1, 2))
    before = sorted(path.name for path in out.rglob("*"))
    with pytest.raises(
        ValueError, match="has the recordings of shard 1/2, which overlaps with 1/3: use the same N, or"
    ):
        convert_videos(videos, out, shard=(1, 3))
    assert sorted(path.name for path in out.rglob("*")) == before
    (out / "manifest-1-of-2.jsonl").rename(out / "manifest.jsonl")
    # while it runs
    with (
        locked(out / "manifest-2-of-2.jsonl"),
        pytest.raises(OutputInUse, match="is being written by shard 2/2, which overlaps with 1/3: use the same N"),
    ):
        convert_videos(videos, out, shard=(1, 3))
    # after a run without shards, any number of shards continues
    report = convert_videos(videos, out, shard=(1, 3))
    assert (report.done, report.kept) == (1, 1)


def test_an_altered_recording_of_the_same_size_is_found_by_check(videos, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["convert-videos", str(videos), "--out", str(out)]
    assert main(command) == 0
    victim = out / "run/a.h5"
    sound = victim.read_bytes()
    victim.write_bytes(sound[:-1] + bytes([sound[-1] ^ 1]))
    capsys.readouterr()
    assert main(command) == 0
    assert capsys.readouterr().out.startswith(
        "0 converted, 4 already existed, 0 failed; 0 events converted, 4 recordings"
    )
    assert main([*command, "--check"]) == 0
    assert capsys.readouterr().out.startswith("1 converted, 3 already existed, 0 failed")
    assert nvsdata.read(victim) == PIX2NVS().emulate(videos / "run/a.avi")
    # what is shorter or gone is converted again in any case
    victim.write_bytes(sound[:-1])
    (out / "run/b.h5").unlink()
    report = convert_videos(videos, out)
    assert (report.done, report.kept, report.kept_events > 0) == (2, 2, True)
    # shards compare, too
    victim.write_bytes(sound[:-1] + bytes([sound[-1] ^ 1]))
    assert convert_videos(videos, out, shard=(1, 2), check=True).done == 1


def test_what_is_overwritten_leaves_no_old_recording(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out)
    convert_videos(videos, out, format="text", overwrite=True)
    assert {path.suffix for path in out.rglob("*") if path.is_file()} == {".txt", ".jsonl"}
    write_video(videos / "run/a.mkv")
    convert_videos(videos, out, format="text", overwrite=True)
    assert sorted(path.name for path in (out / "run").iterdir()) == ["a.avi.txt", "a.mkv.txt", "b.txt"]
    # and what nobody made is left alone
    (out / "run/mine.txt").write_text("mine")
    convert_videos(videos, out, PIX2NVS(threshold=0.5), overwrite=True)
    assert (out / "run/mine.txt").read_text() == "mine"


def test_an_estimate_looks_at_the_part_that_is_converted(videos, tmp_path):
    jobs = plan(videos, tmp_path / "out", PIX2NVS(), view=VideoView(stop=0.2))
    found = estimate_conversion(jobs, tmp_path / "out")
    # 4 videos of 0.2 s at the 10 frames per second that they have
    whole = estimate_conversion(plan(videos, tmp_path / "out", PIX2NVS()), tmp_path / "out")
    assert 0 < found.frames < whole.frames


def test_a_video_that_is_too_short_refuses_no_batch(tmp_path):
    write_video(tmp_path / "in/a.avi", moving_square(3), fps=10)
    write_video(tmp_path / "in/b.avi", moving_square(30), fps=10)
    report = convert_videos(tmp_path / "in", tmp_path / "out", format="aedat2", view=VideoView(start=1.0))
    assert (report.done, list(report.failed)) == (1, ["a.avi"])


def test_a_damaged_stream_is_marked_in_the_manifest(videos, tmp_path, capsys):
    (videos / "run/a.avi").unlink()
    damage(write_stream(videos / "run/a.mp4", moving_square(24)))
    for jobs in (1, 2):
        out = tmp_path / f"out{jobs}"
        assert main(["convert-videos", str(videos), "--out", str(out), "--jobs", str(jobs)]) == 0
        output = capsys.readouterr()
        found = {line["video"]: line.get("decoder_errors", 0) for line in lines(out)[1:]}
        assert found.pop("run/a.mp4") >= 1
        assert not any(found.values())
        assert "run/a.mp4: its stream is damaged, frames may be smeared: " in output.err
        assert output.out.startswith("4 converted, 0 already existed, 0 failed")


def films(out):
    return sorted(path.relative_to(out / ".previews").as_posix() for path in (out / ".previews").rglob("*.mp4"))


def test_a_preview_shows_frames_and_events_side_by_side(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out, preview=True, size=(32, 24), format="hdf5-gzip")
    assert films(out) == [f"{name}.h5.mp4" for name in ("run/a", "run/b", "walk/c", "walk/deep/d")]
    shown = [frame.pixels for frame in frames_of(out / ".previews/run/a.h5.mp4")]
    assert len(shown) == 12
    zoom = 360 // 32
    events = nvsdata.open(out / "run/a.h5")
    for n, (picture, frame) in enumerate(zip(shown, frames_of(videos / "run/a.avi", size=(32, 24)), strict=True)):
        assert picture.shape == (24 * zoom, 2 * 32 * zoom, 3)
        left, right = np.hsplit(picture.astype(float), 2)
        assert abs(cv2.resize(left, (32, 24)).mean() - frame.pixels.mean()) < 12
        since = events.between_frames(n - 1, n) if n else events.read(None, 1)
        expected = event_image(since, zoom)
        # what the film's compression leaves of it
        assert abs(right - expected).mean() < 20
    # neither videos nor recordings
    assert len(EventFolder(out)) == 4
    with pytest.raises(FileNotFoundError, match="no videos in"):
        videos_in(out, tmp_path / "other")
    # a recording that is made anew has no preview of the one before
    convert_videos(videos, out, size=(32, 24), format="text", overwrite=True)
    assert films(out) == []


def test_previews_are_made_where_there_is_none(videos, tmp_path, capsys):
    out = tmp_path / "out"
    convert_videos(videos, out)
    assert not (out / ".previews").exists()
    for jobs in ("1", "2"):
        assert main(["convert-videos", str(videos), "--out", str(out), "--preview", "--jobs", jobs]) == 0
        output = capsys.readouterr()
        assert f"previews are in {out / '.previews'}\n" in output.err
        assert output.out.startswith("0 converted, 4 already existed, 0 failed")
        assert len(films(out)) == 4
        for name in films(out)[: int(jobs) + 1]:
            (out / ".previews" / name).unlink()


def test_films_of_recordings_before_are_made_anew_and_what_is_in_their_place_ends_no_run(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out, preview=True)
    film = out / ".previews/run/a.h5.mp4"
    os.utime(film, (1, 1))
    convert_videos(videos, out, preview=True)
    assert film.stat().st_mtime > 1
    shutil.rmtree(out)
    out.mkdir()
    (out / ".previews").write_text("no folder")
    assert convert_videos(videos, out).done == 4
    report = convert_videos(videos, out, preview=True)
    assert len(report.without_preview) == 4


def test_files_of_the_users_stay_whatever_their_names(tmp_path):
    kept = write_video(tmp_path / "a.preview.mp4").read_bytes()
    write_video(tmp_path / "a.mp4")
    report = convert_videos(tmp_path, tmp_path, preview=True)
    assert (report.done, report.failed) == (2, {})
    assert (tmp_path / "a.preview.mp4").read_bytes() == kept
    assert films(tmp_path) == ["a.h5.mp4", "a.preview.h5.mp4"]


def test_a_preview_goes_with_the_recording_that_it_shows(tmp_path):
    for name in ("a.avi", "a.mp4"):
        write_video(tmp_path / "in" / name)
    out = tmp_path / "out"
    convert_videos(tmp_path / "in", out, preview=True)
    assert films(out) == ["a.avi.h5.mp4", "a.mp4.h5.mp4"]
    (tmp_path / "in/a.mp4").unlink()
    # its name is short now, and what had the long one goes
    convert_videos(tmp_path / "in", out, overwrite=True, preview=True)
    assert films(out) == ["a.h5.mp4", "a.mp4.h5.mp4"]


def test_what_keeps_a_preview_from_being_made_costs_no_recording(videos, tmp_path, monkeypatch, capsys):
    def fails(pictures, path, fps):
        raise OSError("no codec")

    monkeypatch.setattr(preview, "save_mp4", fails)
    out = tmp_path / "out"
    assert main(["convert-videos", str(videos / "run/a.avi"), "--out", str(out), "--preview"]) == 0
    output = capsys.readouterr()
    assert "a.avi: no preview: no codec\n" in output.err
    assert output.out.startswith("1 converted, 0 already existed, 0 failed")

    def full(pictures, path, fps):
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(preview, "save_mp4", full)
    with pytest.raises(OSError, match="full"):
        convert_videos(videos / "run/a.avi", out, preview=True)


@pytest.mark.parametrize("fps", [0.01, 29.97, 70.1234, 1_000])
def test_previews_of_any_rate(videos, tmp_path, fps):
    report = convert_videos(videos / "run/a.avi", tmp_path / "out", fps=fps, preview=True)
    assert (report.done, report.failed, report.without_preview) == (1, {}, {})
    # the first minute
    assert len(list(frames_of(tmp_path / "out/.previews/a.h5.mp4"))) == (1 if fps == 0.01 else 12)


def test_a_preview_of_a_video_that_is_cut_off_ends_with_it(videos, tmp_path):
    path = videos / "run/a.avi"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    report = convert_videos(path, tmp_path / "out", preview=True)
    assert "cut off" in report.failed["a.avi"]
    (line,) = lines(tmp_path / "out")[1:]
    assert line["status"] == "truncated"
    assert len(list(frames_of(tmp_path / "out/.previews/a.h5.mp4"))) == line["frames"]


def test_a_video_that_changed_is_converted_anew_and_one_that_was_copied_is_not(videos, tmp_path):
    out = tmp_path / "out"
    convert_videos(videos, out)
    for path in videos.rglob("*.avi"):
        os.utime(path, (1, 1))
    changed = bytearray((videos / "run/b.avi").read_bytes())
    changed[-40] ^= 1
    (videos / "run/b.avi").write_bytes(changed)
    report = convert_videos(videos, out)
    assert (report.done, report.kept) == (1, 3)


def test_a_line_says_how_many_events_each_imperfection_added_and_left_out(videos, tmp_path):
    clean = PIX2NVS()
    flawed = PIX2NVS(noise_rate=20.0, hot_pixels=0.01, hot_rate=500.0)
    blind = replace(flawed, refractory=20_000)
    for number, settings in enumerate((clean, flawed, blind)):
        convert_videos(videos, tmp_path / str(number), settings)
    for one, noisy, dead in zip(*(lines(tmp_path / str(n))[1:] for n in range(3)), strict=True):
        assert "imperfections" not in one
        counts = noisy["imperfections"]
        assert counts["noise"] > 100
        assert counts["hot_pixels"] > 100
        assert counts["refractory"] == 0
        assert noisy["events"] == one["events"] + counts["noise"] + counts["hot_pixels"]
        # the same seed adds the same
        assert dead["imperfections"] | {"refractory": 0} == counts
        assert dead["events"] == noisy["events"] - dead["imperfections"]["refractory"] < noisy["events"]
        assert nvsdata.open(tmp_path / "2" / dead["file"]).about["imperfections"] == dead["imperfections"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_manifest_can_not_have_files_outside_its_folder_written_or_removed(videos, tmp_path, overwrite):
    out = tmp_path / "out"
    convert_videos(videos, out)
    mine = tmp_path / "mine.h5"
    mine.write_text("a thesis")
    head, first, *rest = (out / "manifest.jsonl").read_text().splitlines()
    (out / "manifest.jsonl").write_text("\n".join([head, first.replace("run/a.h5", "../mine.h5"), *rest, ""]))
    with pytest.raises(ValueError, match=r"names a recording of run/a\.avi outside the folder"):
        convert_videos(videos, out, overwrite=overwrite)
    assert mine.read_text() == "a thesis"
