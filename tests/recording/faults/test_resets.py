"""Resets of the camera's clock that never come, come late, or come in the middle of a recording."""

import numpy as np
import pytest

import nvsdata
from nvsdata.cli import main
from nvsdata.recording import capture
from nvsdata.recording.camera import CameraError, host_time
from nvsdata.recording.capture import Unfinished, record
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import MUX
from nvsdata.recording.recorder import Recorder
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.usb_backend import Backend


class Deaf(SimulatedDavis):
    """Doesn't hear the first so many requests to reset its clock."""

    deaf = 10**9
    asked = 0

    def _write(self, module, parameter, number):
        if (module, parameter) == (MUX, 2) and number:
            self.asked += 1
            if self.asked <= self.deaf:
                return
            self.heard = host_time()
        super()._write(module, parameter, number)


class Jumpy(SimulatedDavis):
    """Its clock is reset from outside, 300 ms after the recording began."""

    reset = jumped = False

    def _write(self, module, parameter, number):
        super()._write(module, parameter, number)
        self.reset |= (module, parameter) == (MUX, 2)

    def _words(self, t, seen, pulses, now):
        words = super()._words(t, seen, pulses, now)
        if self.reset and not self.jumped and now > 300_000:
            self.jumped = True
            words = np.append(words, 1).astype("<u2")
            self._begin()
        return words


def opened(camera):
    return Davis.find(backend=Backend(camera))


@pytest.fixture
def soon(monkeypatch):
    monkeypatch.setattr(capture, "RESET_WAIT", 0.2)


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("seconds", [0.1, 30])
def test_a_reset_that_never_comes_ends_the_recording_and_loses_nothing(tmp_path, capsys, seconds):
    camera, path = Deaf(), tmp_path / "a.h5"
    with opened(camera) as davis, pytest.raises(Unfinished, match=r"doesn't mark the reset of its clock.*convert"):
        record(davis, path, seconds=seconds)
    assert camera.asked == capture.RESETS
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5.davis"]
    kept = nvsdata.read(tmp_path / "a.h5.davis")
    # in the camera's own time, which began when it was started
    assert len(kept) > 10_000
    assert (np.diff(kept.t) >= 0).all()
    assert main(["convert", f"{path}.davis", str(path)]) == 0
    assert len(nvsdata.read(path)) == len(kept)


@pytest.mark.usefixtures("soon")
def test_a_take_without_a_reset_is_an_error_of_the_camera(tmp_path):
    """A batch waits for the first block, and reopens the camera then."""
    with opened(Deaf()) as davis:
        recorder = Recorder(davis, tmp_path / "a.h5", None, journaled=False)
        recorder.start()
        assert recorder.begun.wait(20)
        with pytest.raises(CameraError, match="doesn't mark the reset"):
            recorder.check()
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("soon")
def test_a_reset_that_is_missed_once_is_asked_for_again(tmp_path):
    camera = Deaf()
    camera.deaf = 1
    with opened(camera) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=0.4)
    events = nvsdata.read(tmp_path / "a.h5")
    assert camera.asked == 2
    # as long as it was to be, from the second request on
    assert 350_000 < events.t[-1] < 400_000
    assert report.whole
    # times count from that
    assert abs(report.zero - camera.heard) < 100_000


def test_a_reset_in_the_middle_is_counted_and_time_goes_on(tmp_path):
    camera = Jumpy()
    with opened(camera) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=0.8)
    events = nvsdata.read(tmp_path / "a.h5")
    assert camera.jumped
    assert report.error_counts["late_resets"] == 1
    assert report.events == len(events) > 100_000
    assert (np.diff(events.t) >= 0).all()
    assert 700_000 < events.t[-1] < 800_000
