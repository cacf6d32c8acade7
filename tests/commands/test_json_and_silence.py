"""What all commands have: results as JSON, silence, every step told, and completion by the shell."""

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trees
from clips import write_video

import nvsdata
from nvsdata import NMNIST, EventFolder, cli
from nvsdata import transforms as T
from nvsdata.cli import main
from nvsdata.commands.options import shard
from nvsdata.common.progress import bar
from nvsdata.common.terminal import is_quiet, remark


@pytest.fixture
def said(capsys):
    """A function that runs a command: its exit code, and the objects that it printed as JSON."""

    def run(*words):
        code = main([str(word) for word in words])
        return code, [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return run


@pytest.fixture
def digits(tmp_path):
    return trees.put(tmp_path / "n-mnist", trees.nmnist())


@pytest.fixture
def videos(tmp_path):
    for n in range(5):
        write_video(tmp_path / f"in/run/{n}.avi")
    return tmp_path / "in"


def test_files_as_json(said, tmp_path):
    events = nvsdata.Events([5, 15], [1, 1], [2, 2], [1, 0], (34, 30))
    nvsdata.write(events, tmp_path / "a.h5")
    code, (facts, empty) = said("info", "--json", tmp_path / "a.h5", tmp_path / "none.h5", trees_empty(tmp_path))
    assert code == 1
    assert facts == {"file": str(tmp_path / "a.h5"), "format": "hdf5", "sensor_size": [34, 30], "events": 2} | {
        "size_is_guessed": False, "first": 5, "last": 15, "on": 0.5, "anomalies": {},
    }  # fmt: skip
    assert (empty["events"], empty["first"], empty["on"]) == (0, None, None)
    code, (made,) = said("convert", "--json", tmp_path / "a.h5", tmp_path / "b.aedat")
    assert (code, made["events"], made["out"]) == (0, 2, str(tmp_path / "b.aedat"))
    pictures = ["--image", tmp_path / "c.png"]
    code, (apart,) = said("compare", "--json", tmp_path / "a.h5", tmp_path / "a.h5", *pictures)
    # JSON has no NaN: two events aren't enough for a distance
    assert (code, apart["chamfer"]["value"], apart["emulated_events"]) == (0, None, [1, 1])


def trees_empty(tmp_path):
    nvsdata.write(nvsdata.Events.empty((5, 5)), tmp_path / "empty.h5")
    return tmp_path / "empty.h5"


def test_datasets_as_json(said, digits, tmp_path):
    code, (result,) = said("datasets", "--root", digits.parent, "--json")
    assert code == 0
    first = result["datasets"][0]
    assert (first["name"], first["here"], first["sensor_size"]) == ("n-mnist", str(digits), [34, 34])
    out = tmp_path / "n.h5"
    how = ["pack", digits, "--dataset", "n-mnist", "--out", out, "--json"]
    code, (planned,) = said(*how, "--dry-run")
    assert (code, planned["recordings"], out.exists()) == (0, 50, False)
    (digits / "Train/3/00002.bin").write_bytes(b"abc")
    code, (packed,) = said(*how)
    assert (code, packed["packed"], list(packed["left_out"])) == (1, 49, ["Train/3/00002.bin"])
    # of so few events most is the file's own
    assert 0.5 < out.stat().st_size / planned["needed"] < 8
    code, (plan,) = said("download", "n-mnist", "--dry-run", "--json", "--root", tmp_path / "x")
    assert (code, [file["name"] for file in plan["files"]]) == (0, ["Train.zip", "Test.zip"])
    assert not (tmp_path / "x").exists()


def test_what_a_conversion_takes_is_estimated(said, videos, tmp_path):
    how = ["convert-videos", videos, "--json", "--jobs", 1]
    code, (planned,) = said(*how, "--dry-run")
    assert not (tmp_path / "in-events").exists()
    assert (code, planned["videos"], planned["frames"]) == (0, 5, 60)
    assert planned["seconds"] > 0
    code, (report,) = said(*how)
    assert (code, report["done"], report["failed"]) == (0, 5, {})
    size = sum(path.stat().st_size for path in (tmp_path / "in-events").rglob("*.h5"))
    assert planned["bytes"] == pytest.approx(size, rel=0.2)
    code, (again,) = said(*how)
    assert (again["done"], again["kept"]) == (0, 5)


def test_cameras_and_what_lacks(said, capsys, monkeypatch):
    code, (camera,) = said("record", "--list", "--simulate", "--json")
    assert (code, camera["found"]) == (0, "DAVIS240C SIM00001, 240x180, FX2 with firmware 4")
    code, found = said("record", "--doctor", "--simulate", "--json")
    assert {"libusb", "camera", "pygame-ce", "disk"} <= {one["what"] for one in found}
    assert all(one["cure"] is None for one in found if one["what"] in ("libusb", "camera", "udev rule"))
    # libusb isn't there
    monkeypatch.setattr("usb.core.find", no_backend)
    code, found = said("record", "--doctor", "--json")
    assert (code, found[0]["what"], found[0]["found"]) == (1, "libusb", "isn't installed")
    assert "libusb" in found[0]["cure"]
    assert main(["record", "--list"]) == 1
    assert capsys.readouterr().out.startswith("libusb: isn't installed\n    ")


@pytest.mark.parametrize(("asked", "code"), [([], 0), (["--live"], 1), (["--monitor", "in"], 1), (["--calibrate"], 1)])
def test_only_what_is_needed_for_what_was_asked_is_a_failure(capsys, monkeypatch, tmp_path, asked, code):
    from types import SimpleNamespace

    from nvsdata.recording import diagnostics as doctor

    monkeypatch.setattr(doctor.importlib.util, "find_spec", lambda name: None)
    how = ["record", "--doctor", "--simulate", "--out", str(tmp_path / "none/a.h5"), *asked]
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: SimpleNamespace(free=doctor.RESERVE))
    assert main(how) == code
    out = capsys.readouterr().out
    assert ("pygame-ce: isn't installed (optional)\n" in out) is not bool(code)
    assert ("pygame-ce: isn't installed\n    --live, --monitor and --calibrate need it" in out) is bool(code)
    assert f"disk: 0.1 GB are free in {tmp_path} (optional)\n    a minute of recording may take 1 GB" in out
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: SimpleNamespace(free=doctor.RESERVE - 1))
    assert main(how) == 1


def no_backend(**_):
    import usb.core

    raise usb.core.NoBackendError("No backend available")


@pytest.mark.parametrize(
    ("number", "result", "cure"),
    [
        (13, "no permission to use the camera", "65-davis.rules"),
        (16, "another program uses the camera", "close it"),
    ],
)
def test_a_camera_that_cannot_be_used_is_told_with_the_way_out(said, monkeypatch, number, result, cure):
    from nvsdata.recording.simulated.camera import SimulatedDavis
    from nvsdata.recording.simulated.options import Simulation
    from nvsdata.recording.simulated.usb_backend import Backend

    monkeypatch.setattr(Simulation, "alone", lambda self: Backend(SimulatedDavis(refusal=number)))
    code, found = said("record", "--list", "--simulate", "--json")
    (camera,) = [one for one in found if one["what"] == "camera"]
    assert code == 1
    assert result in camera["found"]
    assert cure in camera["cure"]
    monkeypatch.setattr(Simulation, "alone", lambda self: Backend())
    code, (none,) = said("record", "--list", "--simulate", "--json")
    assert (code, none["found"]) == (1, "none is connected")


def test_a_recording_and_a_batch_as_json(said, tmp_path):
    code, (report,) = said("record", "--simulate", "--seconds", 0.2, "--out", tmp_path / "a.h5", "--json")
    assert (code, report["whole"], report["path"]) == (0, True, str(tmp_path / "a.h5"))
    assert report["events"] == len(nvsdata.read(tmp_path / "a.h5"))


def test_caches_are_found_and_removed(said, digits, tmp_path, capsys):
    dataset = nvsdata.cache(NMNIST(digits, transform=T.EventImage()), tmp_path / "kept")
    for path in digits.rglob("*.bin"):
        os.utime(path, (1, 1))
    assert len([dataset[i] for i in range(5)]) == 5
    nvsdata.windows(EventFolder(digits), 10_000)
    (tmp_path / "kept/mine.txt").write_text("not a cache's")
    (tmp_path / "kept/empty/folder").mkdir(parents=True)
    (tmp_path / "other").mkdir()
    (tmp_path / "other/CACHEDIR.TAG").write_text("Signature: somebody else's")
    code, (*found, summary) = said("cache", "info", tmp_path, "--json")
    kinds = {one["kind"]: one for one in found}
    assert (code, sorted(kinds)) == (0, ["index", "samples"])
    assert kinds["samples"]["path"] == str(tmp_path / "kept")
    assert summary == {"total": sum(one["bytes"] for one in found)}
    assert main(["cache", "clear", str(tmp_path)]) == 0
    assert "removed: " in capsys.readouterr().out
    # only what a user put there is left
    assert sorted(path.name for path in (tmp_path / "kept").rglob("*")) == ["empty", "folder", "mine.txt"]
    (tmp_path / "kept/mine.txt").unlink()
    assert (tmp_path / "other/CACHEDIR.TAG").exists()
    assert said("cache", "info", tmp_path, "--json") == (0, [{"total": 0}])
    assert main(["cache", "info", str(tmp_path / "none")]) == 1
    assert "no such folder" in capsys.readouterr().err
    # it is made again
    assert torch_equal(dataset[0][0], NMNIST(digits, transform=T.EventImage())[0][0])


def torch_equal(one, other):
    return np.array_equal(one.numpy(), other.numpy())


def test_shards_together_do_all(said, videos, tmp_path, capsys):
    how = ["convert-videos", videos, "--out", tmp_path / "out", "--json"]
    for part, count in ((1, 3), (2, 2)):
        assert said(*how, "--shard", f"{part}/2")[1][0]["done"] == count
        # a job that is started again finds its own work done
        assert said(*how, "--shard", f"{part}/2")[1][0]["kept"] == count
    assert sorted(path.name for path in (tmp_path / "out").glob("*.jsonl")) == [
        "manifest-1-of-2.jsonl",
        "manifest-2-of-2.jsonl",
    ]
    code, (report,) = said(*how)
    assert (code, report["done"], report["kept"]) == (0, 0, 5)
    assert [path.name for path in (tmp_path / "out").glob("*.jsonl")] == ["manifest.jsonl"]
    # and a shard knows what was done before
    assert said(*how, "--shard", "1/3")[1][0]["kept"] == 2
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out"), "--set", "threshold=0.3"]) == 1
    assert "made with threshold 0.2, not 0.3" in capsys.readouterr().err
    code, (report,) = said(*how, "--set", "threshold=0.3", "--overwrite")
    assert (code, report["done"], report["kept"]) == (0, 5, 0)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "1/0", "a/b", "-1/2"])
def test_shards_that_make_no_sense(text):
    with pytest.raises(Exception, match="must be I/N"):
        shard(text)


def test_quiet_leaves_notes_and_progress_out(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    seen = []

    def run(args):
        seen.append(is_quiet())
        remark("by the way")
        list(bar(range(3), "working"))
        logging.getLogger("nvsdata.remote").warning("trouble")
        print("result")
        return 0

    monkeypatch.setattr("nvsdata.commands.datasets.run", run)
    assert main(["datasets", "-q"]) == 0
    assert capsys.readouterr() == ("result\n", "")
    assert main(["datasets"]) == 0
    output = capsys.readouterr()
    assert "by the way" in output.err
    assert "working" in output.err
    assert "trouble" in output.err
    assert seen == [True, False]
    assert not is_quiet()
    with pytest.raises(SystemExit):
        main(["datasets", "-q", "-v"])


def test_verbose_tells_each_step_and_leaves_no_handler(videos, capsys, tmp_path):
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "out"), "-v"]) == 0
    assert "nvsdata.batch.run: run/0.avi: converted, " in capsys.readouterr().err
    assert not logging.getLogger("nvsdata").handlers
    assert main(["convert-videos", str(videos), "--out", str(tmp_path / "more")]) == 0
    assert capsys.readouterr().err == ""


def test_broken_videos_are_told_once_and_by_name(tmp_path):
    """FFmpeg's and OpenCV's own lines, which don't name the video, stay away."""
    for n, content in enumerate((b"", b"RIFF....", write_video(tmp_path / "whole.avi").read_bytes()[:700])):
        (tmp_path / f"in/{n}.mp4").parent.mkdir(exist_ok=True)
        (tmp_path / f"in/{n}.mp4").write_bytes(content)
    command = [sys.executable, "-m", "nvsdata", "convert-videos", str(tmp_path / "in")]
    output = subprocess.run(command, capture_output=True, text=True, check=False)
    assert output.returncode == 1
    assert [line[:6] for line in output.stderr.splitlines()] == ["0.mp4:", "1.mp4:", "2.mp4:"]


def test_the_shell_is_told_how_a_line_goes_on(monkeypatch):
    """argcomplete isn't needed: it is asked only if it is there."""
    asked = []

    class Argcomplete:
        @staticmethod
        def autocomplete(parser):
            asked.append(parser)
            raise SystemExit(0)

    monkeypatch.setitem(sys.modules, "argcomplete", Argcomplete)
    monkeypatch.setenv("_ARGCOMPLETE", "1")
    monkeypatch.setenv("COMP_LINE", "nvsdata convert-videos 'a b' --sh")
    with pytest.raises(SystemExit):
        main([])
    (parser,) = asked
    commands = next(action for action in parser._actions if action.dest == "command")
    assert "convert-videos" in commands.choices
    assert "--shard" in commands.choices["convert-videos"].format_help()
    assert cli._split_line("nvsdata info 'a") == ["info", "'a"]
    assert b"PYTHON_ARGCOMPLETE_OK" in Path(cli.__file__).read_bytes()[:1024]


def test_arrays_are_lists_in_json(capsys):
    from nvsdata.common.terminal import tell

    tell("", {"a": np.arange(3), "b": np.float64("nan"), "c": np.int64(4), "d": [np.array([np.inf])]}, as_json=True)
    assert json.loads(capsys.readouterr().out) == {"a": [0, 1, 2], "b": None, "c": 4, "d": [[None]]}


def test_a_rule_that_cannot_be_read_is_no_rule(monkeypatch, tmp_path):
    from nvsdata.recording import diagnostics as doctor

    (tmp_path / "a.rules").symlink_to(tmp_path / "gone")
    monkeypatch.setattr(doctor, "_rules", lambda: [tmp_path / "a.rules"])
    assert main(["record", "--doctor", "--simulate"]) == 0
