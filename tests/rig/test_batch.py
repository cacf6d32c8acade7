"""Videos played on a monitor of SDL's dummy driver, and recorded by a simulated camera that looks at it."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from lab import make_video

import nvsdata
from nvsdata import EventFolder
from nvsdata.batch.folder import videos_in
from nvsdata.cli import main
from nvsdata.recording import capture
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.simulated.camera import SimulatedDavis, picture
from nvsdata.recording.simulated.scenes import Watched
from nvsdata.recording.simulated.usb_backend import Backend
from nvsdata.rig import batch, cameras, take, verification
from nvsdata.rig.batch import BatchOptions
from nvsdata.rig.cameras import Rig
from nvsdata.rig.monitor import Monitor

pytestmark = pytest.mark.usefixtures("quick")


def recorded(source, out, camera, *, before=lambda camera, call: None, resume=False, format="hdf5"):
    """Run a batch over a camera that watches the monitor."""
    videos = videos_in(source, out, format)
    backend = Backend(camera, before=before)
    with (
        Monitor(window=(320, 240), on_change=camera.scene.show) as monitor,
    ):
        rig = Rig(lambda: Davis.find(backend=backend), monitor, CameraSettings())
        options = BatchOptions(format, resume=resume, until_full=True)
        with batch.manifest_of(out, videos, rig, options) as manifest:
            return batch.record_videos(videos, manifest, rig, options)


def lines(out):
    return [json.loads(line) for line in (out / "manifest.jsonl").read_text().splitlines()]


@pytest.fixture
def truth(monkeypatch):
    """Of each take, how far its start and drift (µs, ppm) are from what the camera's clock says."""
    found, began = [], []
    begin, develop = SimulatedDavis._begin, take.trim

    def remembering(self):
        begin(self)
        began.append((self._began, self.speed))

    def measuring(one, *how):
        line = take.synced(one).line
        zero, speed = began[-1]
        start = one.performance.start
        found.append((line.camera(start) - (start - zero) * speed, (1 + line.drift - speed) * 1e6))
        return develop(one, *how)

    monkeypatch.setattr(SimulatedDavis, "_begin", remembering)
    monkeypatch.setattr(take, "trim", measuring)
    return found


def test_from_videos_to_a_dataset(tmp_path, truth, capsys):
    for n, name in enumerate(("run/a", "walk/b")):
        make_video(tmp_path / f"in/{name}.avi", seed=n)
    (tmp_path / "in/run/broken.avi").write_bytes(b"RIFF....")
    out = tmp_path / "out"
    camera = SimulatedDavis(scene=Watched(late=0.03, seed=1), speed=1 + 100e-6)
    result = recorded(tmp_path / "in", out, camera)
    assert (result.done, result.kept, list(result.failed)) == (2, 0, ["run/broken.avi"])
    head, *output = lines(out)
    assert head["settings"]["inertial"]
    by_name = {line["video"]: line for line in output}
    assert "decode" in by_name["run/broken.avi"]["reason"]

    dataset = EventFolder(out)
    assert dataset.classes == ["run", "walk"]
    assert [label for _, label in dataset] == [0, 1]
    for (events, _), name in zip(dataset, ("run/a", "walk/b"), strict=True):
        line = by_name[f"{name}.avi"]
        assert len(events) == line["events"] > 2_000
        assert events.t[0] >= 0
        assert events.t[-1] < line["duration"]
        assert line["duration"] == pytest.approx(400_000 * (1 + 100e-6), abs=20)
        assert (line["dropped"], line["errors"], line["temperature"]) == (0, {}, 25.0)
        assert line["camera"] == "SIM00001"
        # a disc moves from left to right
        discs = [np.mean(events.x[(events.t >= a) & (events.t < a + 100_000)]) for a in (0, 300_000)]
        assert discs[0] < discs[1]
    played = [json.loads(line) for line in (out / "playback.jsonl").read_text().splitlines()]
    assert [line["video"] for line in played] == ["run/a.avi", "walk/b.avi"]
    for line in played:
        assert len(line["shown"]) == len(line["due"]) == 12 - line["skipped"]
        # on a busy machine, the last frame may be shown late
        assert line["shown"][0] == 0
        assert line["shown"] == sorted(set(line["shown"]))
        assert line["stop"] == pytest.approx(400_000, abs=2)
    # the screen begins to change at once, the camera sees it when a threshold is crossed
    # a busy computer shows fewer flashes in time: half of the clock's 100 ppm must be found in any case
    for start, drift in truth:
        assert 0 < start < 1_000
        assert abs(drift) < 50
    assert (out / "contact-sheet-001.png").exists()
    assert not (out / ".takes").exists()

    with pytest.raises(FileExistsError, match="--resume"):
        recorded(tmp_path / "in", out, camera)
    again = recorded(tmp_path / "in", out, camera, resume=True)
    assert (again.done, again.kept, list(again.failed)) == (0, 2, ["run/broken.avi"])

    monitor = ["record", "--monitor", str(tmp_path / "in"), "--out", str(out), "--verify"]
    assert main(monitor) == 1
    assert "run/broken.avi: isn't recorded" in capsys.readouterr().out
    nvsdata.write(nvsdata.read(out / "run/a.h5")[:-1], out / "run/a.h5")
    assert main(monitor) == 1
    output = capsys.readouterr().out
    assert "run/a.avi" in output
    assert "1 of 3 recordings are sound" in output
    assert {line["video"]: line["status"] for line in lines(out)[1:]}["run/a.avi"] == "failed"


def test_a_camera_that_is_unplugged_is_waited_for(tmp_path, capsys):
    make_video(tmp_path / "in/run/a.avi")
    camera = SimulatedDavis(scene=Watched())
    reads = 0

    def pulled(camera, call):
        nonlocal reads
        reads += call == "read"
        if call == "read" and reads == 300:
            camera.unplugged = True

    finding = Davis.find

    def back(serial=None, *, backend=None):
        # plugged in again when it is looked for the third time
        back.tries += 1
        if back.tries == 3:
            camera.unplugged = False
        return finding(serial, backend=backend)

    back.tries = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Davis, "find", back)
        patch.setattr(cameras, "RETRY", 10_000)
        result = recorded(tmp_path / "in", tmp_path / "out", camera, before=pulled, format="aedat2")
    assert (result.done, result.failed) == (1, {})
    assert lines(tmp_path / "out")[-1]["takes"] == 2
    assert "waiting for the camera" in capsys.readouterr().err
    assert len(nvsdata.read(tmp_path / "out/run/a.aedat")) == lines(tmp_path / "out")[-1]["events"]
    # the manifest knows the format, and where each recording is, whatever is put beside the videos later
    make_video(tmp_path / "in/run/a.mp4.avi")
    (tmp_path / "in/run/a.gif").write_bytes(b"GIF89a")
    assert main(["record", "--monitor", str(tmp_path / "in"), "--out", str(tmp_path / "out"), "--verify"]) == 1
    output = capsys.readouterr().out
    assert "a.gif: isn't recorded" in output
    assert "1 of 3 recordings are sound" in output
    head = json.loads((tmp_path / "out/manifest.jsonl").read_text().splitlines()[0])
    (tmp_path / "out/manifest.jsonl").write_text(json.dumps({"nvsdata-videos": 1} | head).replace(batch.KIND, "x"))
    with pytest.raises(ValueError, match="is not a manifest of nvsdata-recordings"):
        verification.recorded_format(tmp_path / "out")


def test_takes_that_fail_are_done_again_and_the_last_is_kept(tmp_path, monkeypatch):
    make_video(tmp_path / "in/run/a.avi", frames=3)
    monkeypatch.setattr(batch, "TAKES", 2)
    result = recorded(tmp_path / "in", tmp_path / "out", SimulatedDavis(scene=Watched(), lossy=0.2))
    assert list(result.failed) == ["run/a.avi"]
    assert lines(tmp_path / "out")[-1]["takes"] == 2
    assert len(nvsdata.read(tmp_path / "out/.takes/run/a.avi.h5")) > 0
    assert not (tmp_path / "out/run").exists()


def test_a_full_disk_ends_the_batch(tmp_path, monkeypatch):
    make_video(tmp_path / "in/run/a.avi")
    monkeypatch.setattr(capture.shutil, "disk_usage", lambda place: type("", (), {"free": 0}))
    with pytest.raises(OSError, match=r"the disk has 0\.0 MB left"):
        recorded(tmp_path / "in", tmp_path / "out", SimulatedDavis(scene=Watched()))
    assert len(lines(tmp_path / "out")) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_what_is_done(tmp_path, number):
    make_video(tmp_path / "in/run/a.avi", frames=3)
    make_video(tmp_path / "in/run/b.avi", frames=900)
    arguments = ["record", "--simulate", "--monitor", "in", "--out", "out"]
    program = f"import sys, lab; from nvsdata.cli import main; lab.hurry(); sys.exit(main({arguments}))"
    paths = os.pathsep.join((os.path.dirname(__file__), *sys.path))
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths},
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    manifest = tmp_path / "out/manifest.jsonl"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (manifest.exists() and len(lines(tmp_path / "out")) == 2):
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(number)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    assert "1 of 2 videos are done: --resume continues" in error
    assert len(nvsdata.read(tmp_path / "out/run/a.h5")) == lines(tmp_path / "out")[-1]["events"]
    assert sorted(os.listdir(tmp_path / "out/run")) == ["a.h5"]
    assert not any(name.endswith((".part", ".davis", ".lock")) for name in os.listdir(tmp_path / "out"))


def test_a_disk_that_is_too_small_is_refused_with_figures(tmp_path, monkeypatch, capsys):
    make_video(tmp_path / "in/run/a.avi")
    real = capture.shutil.disk_usage
    monkeypatch.setattr(capture.shutil, "disk_usage", lambda place: real(place)._replace(free=capture.RESERVE))
    how = ["record", "--simulate", "--monitor", str(tmp_path / "in"), "--out", str(tmp_path / "out")]
    assert main(how) == 1
    reason = (
        "0.1 GB of disk are free, which is too little: free some space, choose another disk, or record until it is full"
    )
    assert reason in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out/run").exists()
    assert main(["record", "--status", str(tmp_path / "out")]) == 1
    out = capsys.readouterr().out
    assert out.startswith("stopped at 20")
    assert reason in out.splitlines()[0]
    assert out.splitlines()[1] == "0 of 1 recorded, 0 failed"
    # the folder isn't in the way
    assert main([*how, "--until-full"]) == 0


def test_frames_and_samples_are_cut_with_their_video(tmp_path):
    make_video(tmp_path / "in/run/a\nb.avi")
    videos = videos_in(tmp_path / "in", tmp_path / "out")
    camera = SimulatedDavis(scene=Watched())
    backend, settings = Backend(camera), CameraSettings(frames=True)
    with (
        Monitor(window=(320, 240), on_change=camera.scene.show) as monitor,
    ):
        rig = Rig(lambda: Davis.find(backend=backend), monitor, settings)
        with batch.manifest_of(tmp_path / "out", videos, rig, BatchOptions()) as manifest:
            result = batch.record_videos(videos, manifest, rig, BatchOptions())
    assert result.done == 1
    # a name with a line break is a name
    recording = nvsdata.open(tmp_path / "out/run/a\nb.h5")
    duration = lines(tmp_path / "out")[-1]["duration"]
    frames = list(recording.frames())
    # one each 40 ms, if the simulated camera is looked after as often
    assert 3 <= len(frames) <= 11
    assert all(0 <= frame.exposure_start < duration for frame in frames)
    assert all(np.array_equal(frame.pixels >> 6, picture([0, 0, 239, 179])) for frame in frames)
    t = recording.inertial().t
    assert 1 <= t.size <= 5
    assert 0 <= t[0] <= t[-1] < duration
    assert recording.about["serial"] == "SIM00001"
    assert recording.about["temperature"] == 25.0


def test_a_format_without_frames_is_refused_before_anything_is_touched(tmp_path, capsys):
    make_video(tmp_path / "in/run/a.avi")
    (tmp_path / "s.json").write_text('{"frames": true}')
    how = ["--simulate", "--settings", str(tmp_path / "s.json"), "--format", "text"]
    assert main(["record", "--monitor", str(tmp_path / "in"), "--out", str(tmp_path / "out"), *how]) == 1
    assert ".txt files can't store frames: record to .h5, .aedat or .aedat4" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
