"""Takes that fail one after another: what is done, in which order, and what others can read about it."""

import json
import os
import sys
import time
from types import SimpleNamespace

import pytest

from nvsdata.cli import main
from nvsdata.common.errors import FormatError
from nvsdata.common.locks import locked
from nvsdata.rig import status as module
from nvsdata.rig import watch as watching
from nvsdata.rig.status import Status, status_of
from nvsdata.rig.watch import BatchStopped, Watch, prune


def ended(number):
    """Whether a process has ended, or only waits to be asked how."""
    try:
        return open(f"/proc/{number}/stat").read().split()[2] == "Z"
    except FileNotFoundError:
        return True


@pytest.fixture
def lab(tmp_path):
    """A watch, and what it did."""
    did, status = [], Status(tmp_path, 12)
    status.set()
    watch = Watch(status, None, lambda: did.append("reopen"), lambda until: did.append("wait"))
    alarm = watch.alarm
    watch.alarm = lambda text: did.append(text) or alarm(text)
    return SimpleNamespace(watch=watch, status=status, did=did, out=tmp_path)


def test_the_camera_is_opened_anew_then_the_batch_pauses(lab):
    spared = [lab.watch.failed(f"{n}.avi", "0 events") for n in range(6)]
    assert spared == [[], [], [], [], [], [f"{n}.avi" for n in range(6)]]
    assert lab.did[:1] == ["reopen"]
    text, *others = lab.did[1:]
    assert text == "6 takes in a row failed, the last one of 5.avi: 0 events; the batch continues in 10 minutes"
    # the camera may be what has to be tried again, too
    assert others == ["reopen", "wait"]
    written = json.loads((lab.out / "status.json").read_text())
    assert (written["state"], written["in_a_row"]) == ("recording", 6)
    assert written["recent"] == [f"{n}.avi: 0 events" for n in (5, 4, 3, 2, 1)]


def test_takes_that_succeed_between_are_no_row(lab):
    for n in range(20):
        assert lab.watch.failed(f"{n}.avi", "late") == []
        if n % 2:
            lab.watch.succeeded()
    assert lab.did == []


def test_a_few_bad_videos_are_no_alarm(lab):
    for n in range(30):
        assert lab.watch.failed(f"{n % 2}.avi", "too dark") == []
    assert lab.did == ["reopen"]


def test_a_batch_gives_up_in_the_end(lab, monkeypatch):
    monkeypatch.setattr(watching, "MOST_PAUSES", 2)
    failures = (lab.watch.failed(f"{n}.avi", "0 events") for n in range(100))
    with pytest.raises(BatchStopped, match=r"6 takes in a row failed.*ended after 2 pauses: --resume continues"):
        list(failures)
    assert lab.did.count("wait") == 2
    # one that succeeds begins the count anew
    lab.did.clear()
    lab.watch.succeeded()
    for n in range(12):
        lab.watch.failed(f"{n}.avi", "0 events")
    assert lab.did.count("wait") == 2


def test_the_command_of_an_alarm_knows_why(lab, capsys):
    script = "import os, pathlib; o = os.environ; pathlib.Path(o['NVSDATA_OUT'], 'told').write_text(o['NVSDATA_ALARM'])"
    Watch(lab.status, f'"{sys.executable}" -c "{script}"', None, None).alarm("the lamp's off")
    assert (lab.out / "told").read_text() == "the lamp's off"
    Watch(lab.status, "exit 4", None, None).alarm("x")
    assert "the command for alarms ended with exit code 4" in capsys.readouterr().err


def test_a_command_that_hangs_ends(lab, capsys, monkeypatch):
    monkeypatch.setattr(watching, "TIMEOUT", 0.1)
    Watch(lab.status, f'"{sys.executable}" -c "import time; time.sleep(5)"', None, None).alarm("x")
    assert "the command for alarms failed" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="shells as POSIX has them")
def test_a_command_that_reads_its_input_gets_none_and_what_hangs_ends_with_what_it_started(lab, monkeypatch):
    """As `mail` does, which waits for a text from the terminal."""
    Watch(lab.status, 'cat > "$NVSDATA_OUT/mail"; echo sent >> "$NVSDATA_OUT/mail"', None, None).alarm("x")
    assert (lab.out / "mail").read_text() == "sent\n"
    monkeypatch.setattr(watching, "TIMEOUT", 0.3)
    Watch(lab.status, 'sleep 30 & echo $! > "$NVSDATA_OUT/child"; wait', None, None).alarm("x")
    child = int((lab.out / "child").read_text())
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline and not ended(child):
        time.sleep(0.02)
    assert ended(child)


def test_the_newest_failed_takes_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(watching, "KEPT", 2)
    for n, name in enumerate(("b/old.h5", "a/middle.h5", "c/new.h5", "newest.h5")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
        os.utime(tmp_path / name, (n, n))
    prune(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*.h5")) == ["new.h5", "newest.h5"]
    prune(tmp_path / "none")


def test_how_a_batch_is_going(lab, capsys):
    lab.status.set(done=3, failed=1, flagged=2, video="x.avi")
    lab.status._began -= 4 * 3_600
    lab.status.failure("y.avi", "too dark")
    with locked(lab.out):
        text, well = status_of(lab.out)
        assert well
        assert "3 of 12 recorded, 1 failed, 2 to review" in text
        # four were done in four hours
        assert "about 8 h 00 min left" in text
        assert "playing x.avi" in text
        assert "last take failed: y.avi: too dark" in text
        assert main(["record", "--status", str(lab.out)]) == 0
    assert capsys.readouterr().out.startswith("recording: began 20")
    # nobody holds the folder
    assert main(["record", "--status", str(lab.out)]) == 1
    assert "the process of the batch ended without a status" in capsys.readouterr().out
    for state, done, failed, code in (
        ("done", 12, 0, 0),
        ("verified", 12, 0, 0),
        ("verified", 11, 0, 1),
        ("done", 11, 1, 1),
        ("interrupted", 3, 0, 1),
        ("stopped", 3, 0, 1),
    ):
        lab.status.set(state=state, done=done, failed=failed)
        assert main(["record", "--status", str(lab.out)]) == code
    with locked(lab.out):
        lab.status.set(state="paused")
        assert status_of(lab.out)[1] is False


def test_a_folder_without_a_batch(tmp_path, capsys):
    assert main(["record", "--status", str(tmp_path)]) == 1
    assert "no batch has recorded there" in capsys.readouterr().err
    (tmp_path / module.STATUS).write_text("{}")
    with pytest.raises(FormatError, match="isn't the status of a batch"):
        status_of(tmp_path)
