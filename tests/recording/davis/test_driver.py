"""The driver, against a simulated camera and the vendor's conversation with a real one's stand-in."""

import csv
import errno
import json

import numpy as np
import pytest
from places import SHARED

from nvsdata.recording.camera import CameraError, Unplugged
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import APS, DVS, EXTERNAL, IMU, MUX, SYSTEM, CameraSettings
from nvsdata.recording.simulated.camera import DAVIS240C, SimulatedDavis
from nvsdata.recording.simulated.scenes import Outlines
from nvsdata.recording.simulated.usb_backend import Backend

FOLDER = SHARED / "davis"
ANSWERS = {
    "logic_version": (SYSTEM, 0),
    "logic_patch": (SYSTEM, 7),
    "chip_id": (SYSTEM, 1),
    "is_master": (SYSTEM, 2),
    "logic_clock": (SYSTEM, 3),
    "adc_clock": (SYSTEM, 4),
    "usb_clock": (SYSTEM, 5),
    "clock_deviation": (SYSTEM, 6),
    "dvs_columns": (DVS, 0),
    "dvs_rows": (DVS, 1),
    "dvs_orientation": (DVS, 2),
    "dvs_has_pixel_filter": (DVS, 10),
    "dvs_has_ba_filter": (DVS, 30),
    "dvs_has_roi_filter": (DVS, 40),
    "dvs_has_skip_filter": (DVS, 50),
    "dvs_has_polarity_filter": (DVS, 60),
    "dvs_has_statistics": (DVS, 80),
    "aps_columns": (APS, 0),
    "aps_rows": (APS, 1),
    "aps_orientation": (APS, 2),
    "aps_color_filter": (APS, 3),
    "aps_has_global_shutter": (APS, 6),
    "imu_type": (IMU, 0),
    "imu_orientation": (IMU, 1),
    "ext_has_generator": (EXTERNAL, 10),
    "mux_has_statistics": (MUX, 80),
}
DEVICES = json.loads((FOLDER / "control_devices.json").read_text()) if FOLDER.is_dir() else {}


def transcript(name):
    """The vendor's control transfers, by phase."""
    suffix = "" if name == "d240c" else f"_{name}"
    phases = {}
    with (FOLDER / f"control_transfers{suffix}.csv").open() as file:
        for row in csv.DictReader(file):
            transfer = (
                *(int(row[key], 16) for key in ("bmRequestType", "bRequest")),
                int(row["wValue"]),
                int(row["wIndex"]),
                bytes.fromhex(row["data_hex"]),
            )
            phases.setdefault(row["phase"], []).append(transfer)
    return phases


@pytest.fixture(autouse=True)
def _no_pauses(monkeypatch):
    monkeypatch.setattr("nvsdata.recording.davis.driver.time.sleep", lambda seconds: None)


@pytest.mark.parametrize("name", sorted(DEVICES))
def test_the_conversation_is_the_vendors(name):
    result = DEVICES[name]
    registers = {place: result[key] for key, place in ANSWERS.items()} | {(MUX, 83): 0, (MUX, 84): 0}
    camera = SimulatedDavis(
        serial=result["serial"], product=result["pid"], firmware=result["bcd"], registers=registers, speed=0
    )
    expected = transcript(name)
    with Davis.find(backend=Backend(camera)) as davis:
        # the vendor's library reads some twice, and in an order of its own
        assert set(camera.log) == set(expected["open"])
        assert davis.facts.serial == result["serial"][:8]
        for phase, act in (
            ("default_config", lambda: davis.configure(CameraSettings(frames=True))),
            ("data_start", davis.start),
            ("data_stop", davis.stop),
        ):
            camera.log.clear()
            act()
            assert camera.log == expected[phase]


@pytest.mark.skipif("d240c" not in DEVICES, reason="no conversations here")
def test_the_simulated_camera_answers_as_the_vendors():
    answers = {place: DEVICES["d240c"][key] for key, place in ANSWERS.items()}
    assert answers | {(MUX, 83): 0, (MUX, 84): 0} == DAVIS240C


def camera(**options):
    return SimulatedDavis(speed=0, **options)


def test_events_alone_leave_frames_and_samples_off():
    one = camera()
    with Davis.find(backend=Backend(one)) as davis:
        davis.configure(CameraSettings(inertial=False))
        one.log.clear()
        davis.start()
        started = [(value, index) for *_, value, index, data in one.log if data == b"\0\0\0\1"]
    assert started == [(0, 3), (9, 0), (0, 1), (0, 0), (1, 3), (4, 0)]


def test_settings_are_sent_after_the_defaults():
    one = camera()
    with Davis.find(backend=Backend(one)) as davis:
        settings = CameraSettings(
            biases={"OnBn": (4, 200), "SSP": (2, 30)},
            region=(10, 20, 100, 80),
            activity_filter=None,
            refractory_filter=1_000,
            exposure=12_345,
            external="both",
            packet_delay=10_000,
            masked=((3, 4), (239, 179)),
            skip=7,
            polarity="off",
            frame_region=(8, 4, 100, 60),
        )
        davis.configure(settings)
        davis.reset_time()
        register = one.registers
    assert register[5, 1] == 4 << 12 | 200 << 4 | 0xF
    assert register[5, 20] == 30 << 10 | 2 << 4
    assert [register[1, n] for n in (41, 42, 43, 44)] == [10, 20, 109, 99]
    assert [register[1, n] for n in (31, 33, 34)] == [0, 1, 4]
    assert (register[2, 12], register[9, 1]) == (370_350, 300_000)
    assert [register[4, n] for n in (1, 2, 3)] == [1, 1, 0]
    # row before column; those that aren't used lie outside
    assert [register[1, n] for n in range(11, 17)] == [4, 3, 179, 239, 180, 240]
    # events that are ON are suppressed
    assert [register[1, n] for n in (51, 52, 62, 63)] == [1, 7, 1, 1]
    assert [register[2, n] for n in (8, 9, 10, 11)] == [8, 4, 107, 63]
    assert one.log[-1] == (0x40, 0xC2, 2, 0, bytes.fromhex("000200000001000200000000"))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (CameraSettings(biases={"Onbn": (1, 1)}), "DAVIS240C has no bias 'Onbn'; it has DiffBn, OnBn"),
        (CameraSettings(biases={"OnBn": (8, 1)}), r"takes 0..7:0..255, not 8:1"),
        (CameraSettings(region=(200, 0, 41, 10)), "not within 240x180"),
        (CameraSettings(frame_region=(0, 100, 10, 81)), "frame_region .* is not within 240x180"),
        (CameraSettings(masked=((240, 0),)), r"masked pixel \(240, 0\) is not within"),
    ],
)
def test_settings_that_do_not_fit(settings, message):
    with Davis.find(backend=Backend(camera())) as davis, pytest.raises(ValueError, match=message):
        davis.configure(settings)


def registers(**changes):
    return dict(DAVIS240C) | {ANSWERS[name]: value for name, value in changes.items()}


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ([], "no DAVIS camera is connected"),
        ([camera(serial="A"), camera(serial="B")], r"2 cameras are connected: choose one .* \(A, B\)"),
        ([camera(firmware=3)], "has firmware 3, at least 4 is needed: update it"),
        ([camera(registers=registers(logic_version=17))], "has logic 17, 18 is needed"),
        ([camera(registers=registers(logic_patch=0))], "has patch level 0"),
        ([camera(registers=registers(dvs_columns=0xFFFFFFFF))], "returns implausible answers"),
        ([camera(registers=registers(usb_clock=0))], r"returns implausible answers \(clocks of 90, 30 and 0 MHz"),
        ([camera(registers=registers(chip_id=8))], "DAVIS208 isn't supported"),
        ([camera(refusal=errno.EACCES)], "no permission to use the camera; .*rules.d"),
        ([camera(refusal=errno.EBUSY)], "another program uses the camera"),
    ],
)
def test_what_keeps_a_camera_from_opening(cameras, message):
    with pytest.raises(CameraError, match=message):
        Davis.find(backend=Backend(*cameras))


def test_a_camera_is_chosen_by_its_serial():
    backend = Backend(camera(serial="A"), camera(serial="B"))
    with Davis.find("B", backend=backend) as davis:
        assert davis.facts.serial == "B"
    with pytest.raises(CameraError, match="no camera of serial number C; there is A, B"):
        Davis.find("C", backend=backend)


@pytest.mark.parametrize("phase", ["open", "configure", "start", "read", "stop"])
def test_unplugged_in_each_phase(phase):
    one = camera()
    backend = Backend(one)
    if phase == "open":
        one.refusal = errno.ENODEV
        with pytest.raises(Unplugged):
            Davis.find(backend=backend)
        return
    with Davis.find(backend=backend) as davis:
        if phase == "configure":
            one.unplugged = True
            with pytest.raises(Unplugged, match="was unplugged"):
                davis.configure(CameraSettings())
            return
        davis.configure(CameraSettings())
        if phase == "start":
            one.unplugged = True
            with pytest.raises(Unplugged):
                davis.start()
            return
        davis.start()
        one.unplugged = True
        if phase == "read":
            with pytest.raises(Unplugged, match="stopped sending"):
                davis.read()
        davis.stop()


class Noted(Outlines):
    """Remembers what it showed."""

    def events(self, start, stop):
        self.start, self.shown = start, super().events(start, stop)
        return self.shown


def test_the_stream_of_a_simulated_camera_is_what_it_saw():
    one = camera(scene=Noted(), room=1 << 22)
    with Davis.find(backend=Backend(one)) as davis:
        davis.configure(CameraSettings())
        davis.start()
        davis.reset_time()
        decoder = davis.decoder()
        one.advance(100_000)
        pieces = []
        while block := davis.read():
            pieces.append(decoder.feed(block))
        davis.stop()
    seen = one.scene.shown
    t, x, y, p = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in "txyp")
    assert len(seen) > 10_000
    assert np.array_equal(t, seen.t - one.scene.start)
    assert np.array_equal(x, seen.x)
    assert np.array_equal(y, seen.y)
    assert np.array_equal(p, seen.p)
    assert not any(decoder.error_counts.values())
