"""Reading in another process, whose simulated camera sends what this one asks for."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import usb.core

from nvsdata.recording.camera import CameraError
from nvsdata.recording.davis import driver
from nvsdata.recording.davis.driver import ENDPOINT, Davis
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.davis.stream import DavisDecoder
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.scenes import Outlines
from nvsdata.recording.simulated.usb_backend import Backend
from nvsdata.recording.usb.process_reader import SubprocessStream, can_read_in_subprocess
from nvsdata.recording.usb.transfers import Disconnected, SyncStream


def streaming(reads=None, rate=400_000):
    """A device that streams already, and goes away after so many reads."""
    camera, count = SimulatedDavis(scene=Outlines(rate=rate)), 0

    def before(camera, call):
        nonlocal count
        count += call == "read"
        camera.unplugged = reads is not None and count > reads

    one = Davis.find(backend=Backend(camera, before=before))
    one.configure(CameraSettings())
    one.start()
    return one.device


def read_out(apart):
    """How many bytes come before the end, which is an error."""
    came = 0
    try:
        while True:
            came += len(apart.read(100))
    except Disconnected as error:
        return came, str(error)


def failing(message):
    raise usb.core.USBError(message)


def dying():
    os._exit(3)


def test_what_another_process_reads_is_the_stream():
    apart = SubprocessStream(streaming, ENDPOINT)
    decoder, events = DavisDecoder(240, 180), []
    until = time.monotonic() + 30
    while sum(map(len, events)) <= 50_000 and time.monotonic() < until:
        events.append(decoder.feed(apart.read(100)))
    apart.close()
    t = np.concatenate([piece.t for piece in events])
    assert t.size > 50_000
    assert (np.diff(t) >= 0).all()
    assert not any(decoder.error_counts.values())


def test_a_device_that_goes_away_there_is_gone_here():
    freed = []
    apart = SubprocessStream(partial(streaming, 200), ENDPOINT, lambda: freed.append(True))
    came, result = read_out(apart)
    apart.close()
    assert came > 1_000
    assert result == "the process that reads the camera ended"
    assert freed == [True]


@pytest.mark.parametrize(
    ("opener", "reason"), [(partial(failing, "no such device"), "no such device"), (dying, "it ended")]
)
def test_a_process_that_cannot_begin(opener, reason):
    with pytest.raises(Disconnected, match=reason):
        SubprocessStream(opener, ENDPOINT)


def test_a_process_that_is_killed():
    apart = SubprocessStream(streaming, ENDPOINT)
    apart._process.kill()
    assert "ended" in read_out(apart)[1]
    apart.close()


PARENT = """
import os, signal, sys
sys.path[:0] = {paths}
from test_process_reader import ENDPOINT, SubprocessStream, streaming
if __name__ == "__main__":
    apart = SubprocessStream(streaming, ENDPOINT)
    print(apart._process.pid, flush=True)
    while True:
        apart.read(100)
"""


def test_the_reader_ends_with_the_one_that_started_it_and_not_with_its_group(tmp_path):
    (tmp_path / "parent.py").write_text(PARENT.format(paths=[os.path.dirname(__file__), *sys.path]))
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True)
    try:
        reader = int(parent.stdout.readline())
        # as `timeout` and a terminal that is closed do, to all of a group
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            os.kill(reader, number)
        time.sleep(0.3)
        assert parent.poll() is None
        os.kill(reader, 0)
    finally:
        parent.kill()
        parent.communicate()
    until = time.monotonic() + 20
    while runs(reader) and time.monotonic() < until:
        time.sleep(0.05)
    assert not runs(reader)


def runs(pid):
    """Whether there is a process of that number; one that ended but that nobody asked after doesn't count."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


class Elsewhere(Backend):
    """As if it were one of pyusb's own."""


Elsewhere.__module__ = "usb.backend.other"


def test_backends_of_pyusb_are_read_apart_and_others_here(monkeypatch):
    here = usb.core.find(backend=Backend(SimulatedDavis()))
    there = usb.core.find(backend=Elsewhere(SimulatedDavis()))
    assert not can_read_in_subprocess(here)
    assert can_read_in_subprocess(there)
    assert isinstance(driver._stream(here), SyncStream)
    # the other process finds no such device
    with pytest.raises(CameraError, match="process that reads the camera failed"):
        driver._stream(there)
