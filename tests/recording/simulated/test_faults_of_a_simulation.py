"""What a simulated camera is to USB, and the faults that it may have."""

import pytest
import usb.core

from nvsdata.recording.simulated import options
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.options import Simulation
from nvsdata.recording.simulated.scenes import Outlines
from nvsdata.recording.simulated.usb_backend import Backend


def test_its_descriptors_are_those_of_a_device_with_one_endpoint():
    """As USB 2.0 has them (9.6): lengths, types, and one bulk endpoint for input."""
    device = usb.core.find(backend=Backend(SimulatedDavis(speed=0, serial="A"), SimulatedDavis(speed=0)), address=2)
    (configuration,) = device
    (interface,) = configuration
    (endpoint,) = interface
    for part, result in (
        (device, (18, 1, 0x200, 0, 0, 0, 64, 0x152A, 0x841B, 4, 1, 2, 3, 1)),
        (configuration, (9, 2, 25, 1, 1, 0, 0x80, 200)),
        (interface, (9, 4, 0, 0, 1, 0xFF, 0, 0, 0)),
        (endpoint, (7, 5, 0x82, 2, 512, 0)),
    ):
        assert tuple(getattr(part, name) for name in FIELDS[len(result)]) == result
    assert (device.bus, device.address, device.port_number, device.port_numbers, device.speed) == (1, 2, 1, (1,), 3)
    assert (endpoint.bRefresh, endpoint.bSynchAddress) == (0, 0)
    assert usb.util.get_string(device, device.iSerialNumber) == "SIM00001"
    nameless = usb.core.find(backend=Backend(SimulatedDavis(speed=0, serial="")))
    assert nameless.iSerialNumber == 0
    assert nameless.get_active_configuration().bConfigurationValue == 1


FIELDS = {
    14: (
        "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 idVendor "
        "idProduct bcdDevice iManufacturer iProduct iSerialNumber bNumConfigurations"
    ).split(),
    8: (
        "bLength bDescriptorType wTotalLength bNumInterfaces bConfigurationValue iConfiguration bmAttributes bMaxPower"
    ).split(),
    9: (
        "bLength bDescriptorType bInterfaceNumber bAlternateSetting bNumEndpoints bInterfaceClass bInterfaceSubClass "
        "bInterfaceProtocol iInterface"
    ).split(),
    6: "bLength bDescriptorType bEndpointAddress bmAttributes wMaxPacketSize bInterval".split(),
}


def test_faults_by_name():
    assert Simulation.of("") == Simulation(0, 0.5, 0, 0, 0, 0, 0, 0)
    assert Simulation.of("drift=-50,late=0.1,,seed=3,") == Simulation(drift=-50, late=0.1, seed=3)
    for text in ("drift", "drift=x", "wind=3", "drift=3;late=1", "noise=1,late="):
        with pytest.raises(
            ValueError, match="--simulate takes NAME=NUMBER of drift, noise, late, lossy, wired, unplug"
        ):
            Simulation.of(text)


def test_what_faults_do_to_a_camera_and_its_scene():
    faults = Simulation(drift=200, noise=3, late=0.25, lossy=0.5, wired=1, seed=7)
    backend = faults.alone()
    (camera,) = backend.cameras
    assert (camera.speed, camera.lossy, camera.scene) == (1.0002, 0.5, Outlines(noise=3 * 43_200))
    backend, show = faults.watched()
    scene = backend.cameras[0].scene
    assert show == scene.show
    assert (scene.late, scene.wired, scene.seed, scene.pixels.noise_rate, scene.pixels.seed) == (0.25, True, 7, 3, 7)
    assert not Simulation().watched()[0].cameras[0].scene.wired


@pytest.mark.parametrize(
    ("faults", "planned"),
    [
        (Simulation(), []),
        (Simulation(unplugged=3), [(3, "unplugged", True), (5, "unplugged", False)]),
        (Simulation(stalled=4), [(4, "stalled", True)]),
        (Simulation(unplugged=3, stalled=4), [(3, "unplugged", True), (4, "stalled", True), (5, "unplugged", False)]),
    ],
)
def test_when_a_camera_fails(monkeypatch, faults, planned):
    found = []

    class Timer:
        def __init__(self, seconds, call, given):
            self.what = (seconds, *given[1:])

        def start(self):
            assert self.daemon is True
            found.append(self.what)

    monkeypatch.setattr(options, "Timer", Timer)
    backend = faults.alone()
    (camera,) = backend.cameras
    camera.stalled = True
    backend.before(camera, "read")
    assert (found, camera.stalled) == ([], True)
    # it is opened again and again, and fails once
    for _ in range(2):
        camera.stalled = True
        backend.open_device(camera)
        assert not camera.stalled
    assert sorted(found) == planned
