"""USB that fails for a moment: what is lost is counted, and what can be tried again is."""

import errno

import pytest
import usb.core

from nvsdata.recording.camera import CameraError
from nvsdata.recording.capture import record
from nvsdata.recording.davis import driver
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.usb_backend import Backend


class Late(usb.core.USBTimeoutError):
    def __init__(self):
        super().__init__("Operation timed out", -7, errno.ETIMEDOUT)


@pytest.mark.parametrize("times", [1, 2])
def test_a_control_transfer_that_is_late_is_tried_again_once(times):
    left = 0

    def late(camera, call):
        nonlocal left
        if call == "control" and left:
            left -= 1
            raise Late

    with Davis.find(backend=Backend(SimulatedDavis(), before=late)) as davis:
        left = times
        if times == 1:
            assert davis.get(6, 0) == 18
            left = 1
            davis.set(5, 4, 7)
            assert davis.get(5, 4) == 7
        else:
            with pytest.raises(CameraError, match="refused a request: Operation timed out"):
                davis.get(6, 0)


def test_a_serial_number_that_cannot_be_read_is_an_error_of_the_camera(monkeypatch):
    def unreadable(self):
        raise ValueError("The device has no langid (permission issue, no string descriptors supported or device error)")

    monkeypatch.setattr(usb.core.Device, "serial_number", property(unreadable))
    with pytest.raises(CameraError, match="serial number of the camera can't be read"):
        Davis.find(backend=Backend(SimulatedDavis()))


def test_a_camera_without_a_configuration_gets_its_own():
    class Unset(Backend):
        number = 0

        def get_configuration(self, dev_handle):
            return self.number

        def set_configuration(self, dev_handle, config_value):
            self.number = config_value

    backend = Unset(SimulatedDavis())
    with Davis.find(backend=backend) as davis:
        assert backend.number == 1
        assert davis.facts.serial == "SIM00001"


def test_requests_that_failed_are_in_the_report(tmp_path, monkeypatch):
    """The simulated camera has no requests that wait, so they are counted by its stream."""
    made = []

    class Faulty(driver.SyncStream):
        def read(self, timeout):
            self.faults = 3
            return super().read(timeout)

    monkeypatch.setattr(driver, "_stream", lambda device: made.append(Faulty(device, driver.ENDPOINT)) or made[-1])
    with Davis.find(backend=Backend(SimulatedDavis())) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=0.2)
    assert report.error_counts["usb_errors"] == 3
    assert report.events > 0
    assert not report.whole


def test_messages_of_an_fx3_are_read_beside_the_stream(monkeypatch):
    class Messages:
        faults = 0

        def __init__(self):
            self.waiting = [b"\0\3\0\0\0\0FIFO full\n\0", b"\1nothing for us"]

        def arrived(self):
            said, self.waiting = self.waiting, []
            return said

        def close(self):
            self.closed = True

    one = Messages()
    monkeypatch.setattr(driver, "queued", lambda device, endpoint, *how: one if endpoint == driver.DEBUG else None)
    with Davis.find(backend=Backend(SimulatedDavis(product=0x841A, firmware=6))) as davis:
        davis.configure()
        davis.start()
        davis.read()
        assert davis.messages == ["FIFO full"]
        davis.stop()
    assert one.closed
