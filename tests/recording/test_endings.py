"""`nvsdata record` in a process of its own, ended in every way that there is."""

import os
import pty
import resource
import shutil
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from test_capture import Outlines, SimulatedDavis, opened

import nvsdata
from nvsdata.cli import main
from nvsdata.common.locks import locked
from nvsdata.recording.capture import Unfinished, record
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.journal import journal_of, left_over
from nvsdata.recording.pipeline import CameraReader

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="of POSIX")
LONG = ["record", "--simulate", "--out", "a.h5"]


def launched(folder, arguments=LONG, **options):
    """The command in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", f"import sys; from nvsdata.cli import main; sys.exit(main({arguments}))"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "SDL_VIDEODRIVER": "dummy"},
        text=True,
        start_new_session=True,
        **({"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options),
    )


def started(folder, arguments=LONG, **options):
    """The command, recording."""
    process = launched(folder, arguments, **options)
    wait_for(process, folder)
    return process


def wait_for(process, folder, count=60_000):
    """Until so many events are on the disk."""
    journal = folder / "a.h5.davis"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (
        journal.exists() and journal.stat().st_size > 10_000 and len(nvsdata.read(journal)) > count
    ):
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)


def names(folder):
    return sorted(os.listdir(folder))


@pytest.mark.parametrize(("number", "flags"), [(signal.SIGTERM, []), (signal.SIGHUP, ["--live"])])
def test_a_signal_ends_it_and_keeps_it(tmp_path, number, flags):
    process = started(tmp_path, [*LONG, *flags])
    process.send_signal(number)
    result, _ = process.communicate(timeout=30)
    # a machine that is busy may lose some
    assert process.returncode == int("lost" in result or "dropped" in result)
    assert "it was stopped" in result
    assert names(tmp_path) == ["a.h5"]
    events = nvsdata.read(tmp_path / "a.h5")
    assert f"{len(events):,} events" in result
    assert len(events) > 50_000


def test_a_terminal_that_is_closed_ends_it_and_keeps_it(tmp_path):
    ours, theirs = pty.openpty()
    process = started(tmp_path, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    # as the system does for what runs in the terminal
    os.close(ours)
    process.send_signal(signal.SIGHUP)
    process.wait(timeout=30)
    assert names(tmp_path) == ["a.h5"]
    assert len(nvsdata.read(tmp_path / "a.h5")) > 50_000


def test_a_killed_recording_is_finished_by_convert(tmp_path, capsys, monkeypatch):
    process = started(tmp_path)
    process.kill()
    process.communicate()
    monkeypatch.chdir(tmp_path)
    assert [path.name for path in left_over(tmp_path)] == ["a.h5.davis"]

    # nothing takes its place, and the next run sweeps what else was left, and tells of it
    for flags in ([], ["--overwrite"]):
        assert main([*LONG, *flags]) == 1
        output = capsys.readouterr().err
        assert output.count("\n") == 1
        assert "`nvsdata convert a.h5.davis a.h5` finishes it" in output
    assert main(["record", "--simulate", "--seconds", "0.1", "--out", "b.h5"]) == 0
    assert "`nvsdata convert a.h5.davis a.h5` finishes it" in capsys.readouterr().err

    shutil.copy("a.h5.davis", "kept.davis")
    assert main(["convert", "a.h5.davis", "a.h5"]) == 0
    # what it was the journal of is whole
    assert not Path("a.h5.davis").exists()
    assert main(["record", "--simulate", "--seconds", "0.1", "--out", "c.h5"]) == 0
    assert "finishes it" not in capsys.readouterr().err
    recording, journal = nvsdata.open("a.h5"), nvsdata.open("kept.davis")
    events = recording.read()
    assert len(events) > 60_000
    assert events == journal.read()
    assert recording.span == journal.span
    assert (recording.start, recording.end) == (events.start, events.stated_end) == (journal.start, journal.end)
    assert journal.start == 0 <= recording.span[0] < recording.span[1] <= journal.end
    assert recording.inertial().t.tolist() == journal.inertial().t.tolist() != []
    assert recording.about["serial"] == "SIM00001"
    assert recording.about["started"] == journal.about["started"]


def test_a_journal_tells_when_the_recording_begins_and_ends(tmp_path):
    kept = []

    def copied(report, events):
        kept[:] = [journal_of(report.path).read_bytes(), events.end]

    with opened(SimulatedDavis()) as davis:
        record(davis, tmp_path / "a.h5", seconds=0.3, watch=copied)
    (tmp_path / "b.davis").write_bytes(kept[0])
    for strict in (True, False):
        journal = nvsdata.open(tmp_path / "b.davis", strict=strict)
        assert (journal.start, journal.end) == (0, kept[1])
        events = journal.read()
        assert (events.start, events.stated_end) == (0, kept[1])
        assert 0 <= journal.span[0] == events.t[0] < events.t[-1] == journal.span[1] <= kept[1]
        assert journal.read(1_000, 2_000).end == 1_999


class Failing:
    """A journal that can't be written to, for a reason that isn't the disk's."""

    def write(self, block):
        raise RuntimeError("no journal")


def test_a_journal_that_fails_ends_the_recording_and_loses_nothing():
    with opened(SimulatedDavis()) as davis:
        davis.configure(CameraSettings())
        davis.start()
        reader = CameraReader(davis, 30, Event())
        reader.start()
        reader.begin()
        reader.keep(Failing())
        taken = []
        consumer = Thread(target=lambda: taken.extend(iter(reader.take, b"")), daemon=True)
        consumer.start()
        consumer.join(20)
        assert not consumer.is_alive()
        reader.finish()
    assert reader.ended == "the journal failed (no journal)"
    assert sum(map(len, taken)) == reader.received > 0


def test_a_journal_holds_what_the_recording_does(tmp_path):
    kept = []

    def copied(report, events):
        kept[:] = [journal_of(report.path).read_bytes()]

    with opened(SimulatedDavis()) as davis:
        record(davis, tmp_path / "a.h5", seconds=0.5, watch=copied)
    (tmp_path / "b.davis").write_bytes(kept[0])
    whole, journal = nvsdata.open(tmp_path / "a.h5"), nvsdata.open(tmp_path / "b.davis")
    ours, theirs = whole.read(), journal.read()
    assert len(theirs) > 0.8 * len(ours)
    assert theirs == ours[: len(theirs)]
    assert theirs.sensor_size == (240, 180)
    # torn within a word
    (tmp_path / "b.davis").write_bytes(kept[0][:-1])
    assert len(theirs) - 1 <= len(nvsdata.read(tmp_path / "b.davis")) <= len(theirs)
    assert not any(journal.repairs.values())


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"[]\n",
        b'{"decoder": {}, "last": null, "about": {}}\n',
        b'{"decoder": {"width": 99999, "height": 3, "frame_size": null}, "last": null, "about": {}}\n',
        b'{"decoder": {"width": 4, "height": 3, "frame_size": [1]}, "last": null, "about": {}}\n',
        b'{"decoder": {"width": 4, "height": 3, "frame_size": null}, "last": null, "about": {}}',
        b"[" * 60_000,
    ],
)
def test_a_journal_with_an_odd_first_line_is_refused(tmp_path, line):
    (tmp_path / "a.davis").write_bytes(b"#!DAVIS-STREAM1 " + line)
    with pytest.raises(nvsdata.FormatError, match=r"a\.davis: byte \d+: "):
        nvsdata.open(tmp_path / "a.davis")


def test_a_file_that_is_there_is_not_replaced(tmp_path, capsys):
    path = tmp_path / "a.h5"
    path.write_bytes(b"mine")
    assert main(["record", "--simulate", "--out", str(path)]) == 1
    assert f"{path} already exists: --overwrite (in Python overwrite=True) replaces it" in capsys.readouterr().err
    assert path.read_bytes() == b"mine"
    assert main(["record", "--simulate", "--seconds", "0.1", "--overwrite", "--out", str(path)]) == 0
    assert len(nvsdata.read(path)) > 1_000
    (tmp_path / "c").mkdir()
    (tmp_path / "c/calibration.json").write_text("{}")
    assert main(["record", "--simulate", "--calibrate", "--out", str(tmp_path / "c")]) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert names(tmp_path / "c") == ["calibration.json"]


def test_a_second_recorder_of_a_file_is_refused(tmp_path, capsys):
    with locked(tmp_path / "a.h5"):
        assert main(["record", "--simulate", "--out", str(tmp_path / "a.h5")]) == 1
    output = capsys.readouterr().err
    assert output.count("\n") == 1
    assert "is being written by process" in output


def test_what_a_killed_recording_left_is_swept(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    from nvsdata.common.locks import owner

    part = tmp_path / f".a.h5.{owner().rpartition('-')[0]}-{child.pid}-abc.part"
    part.touch()
    assert main(["record", "--simulate", "--seconds", "0.1", "--out", str(tmp_path / "a.h5")]) == 0
    assert names(tmp_path) == ["a.h5"]


def _limited(size):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def test_a_file_that_may_not_grow_leaves_a_journal(tmp_path):
    process = launched(tmp_path, LONG, preexec_fn=lambda: _limited(2_000_000))
    out, err = process.communicate(timeout=60)
    assert process.returncode == 1, (out, err)
    if names(tmp_path) == ["a.h5"]:
        assert "the disk is full (File too large)" in out
    else:
        assert "couldn't be written" in err
        assert names(tmp_path) == ["a.h5.davis"]
        assert main(["convert", str(tmp_path / "a.h5.davis"), str(tmp_path / "a.h5")]) == 0
    assert len(nvsdata.read(tmp_path / "a.h5")) > 50_000


def test_a_file_that_cannot_be_written_is_told_with_its_journal(tmp_path, monkeypatch):
    def failing(pieces, path):
        for count, _ in enumerate(pieces):
            if count == 5:
                raise OSError("No space left on device")

    with monkeypatch.context() as patch, opened(SimulatedDavis(scene=Outlines())) as davis:
        patch.setattr("nvsdata.formats.write", failing)
        with pytest.raises(Unfinished, match=r"No space left on device\); .*a\.h5\.davis is a recording"):
            record(davis, tmp_path / "a.h5", seconds=5)
    assert names(tmp_path) == ["a.h5.davis"]
    events = nvsdata.read(tmp_path / "a.h5.davis")
    assert len(events) > 5_000
    assert (np.diff(events.t) >= 0).all()


@pytest.mark.long
def test_a_kill_at_any_moment_costs_less_than_a_second(tmp_path):
    rng = np.random.default_rng(0)
    lost = []
    for n in range(40):
        folder = tmp_path / str(n)
        folder.mkdir()
        process = started(folder)
        time.sleep(rng.uniform(0, 1.5))
        process.kill()
        ended = datetime.now(UTC)
        process.communicate()
        journal = nvsdata.open(folder / "a.h5.davis")
        recorded = (ended - datetime.fromisoformat(journal.about["started"])).total_seconds()
        lost.append(recorded - journal.span[1] / 1e6)
        assert main(["convert", str(folder / "a.h5.davis"), str(folder / "a.h5")]) == 0
        assert nvsdata.read(folder / "a.h5") == journal.read()
    print(f"s lost by a kill: median {np.median(lost):.3f}, most {max(lost):.3f}")
    assert max(lost) < 1
