"""Which settings a camera takes, and the numbers that they become in its registers."""

import errno
import math
from dataclasses import replace

import pytest
import usb.core

from nvsdata.recording.camera import CameraError, Unplugged
from nvsdata.recording.davis.configuration import DeviceInfo, changes, cycles, defaults
from nvsdata.recording.davis.driver import Davis, _translated_errors
from nvsdata.recording.davis.registers import SHIFTED, VDAC, Bias, CameraSettings, N, P, biases_of
from nvsdata.recording.simulated.camera import DAVIS240C, SimulatedDavis
from nvsdata.recording.simulated.usb_backend import Backend

PARTS = "pixel filter, activity filter, region filter, skip filter, polarity filter, global shutter, generator"
FACTS = DeviceInfo("1", "FX3", 5, 346, 260, False, (346, 260), 0, 2, 0, 100.0, 30.0, 50.0, frozenset(PARTS.split(", ")))


@pytest.mark.parametrize(
    ("kind", "numbers", "value"),
    [
        (N, (7, 255), 0b0111_1111_1111_1111),
        (P, (0, 0), 0b0000_0000_0000_1101),
        (N, (8, 0), "0..7:0..255, not 8:0"),
        (N, (0, 256), "0..7:0..255, not 0:256"),
        (N, (-1, 0), "0..7:0..255, not -1:0"),
        (N, (0, -1), "0..7:0..255, not 0:-1"),
        (VDAC, (63, 7), 0b111_111111),
        (VDAC, (0, 1), 0b001_000000),
        (VDAC, (64, 0), "0..63:0..7, not 64:0"),
        (VDAC, (0, 8), "0..63:0..7, not 0:8"),
        (SHIFTED, (63, 63), 0b111111_111111_0000),
        (SHIFTED, (1, 2), 0b000010_000001_0000),
        (SHIFTED, (64, 0), "0..63:0..63, not 64:0"),
        (SHIFTED, (0, 64), "0..63:0..63, not 0:64"),
        (N, (None, None), 3 << 12 | 4 << 4 | 0xF),
        (N, (0, None), 4 << 4 | 0xF),
        (N, (None, 0), 3 << 12 | 0xF),
    ],
)
def test_the_numbers_of_a_bias(kind, numbers, value):
    bias = Bias(9, 3, 4, kind)
    if isinstance(value, int):
        assert bias.value(*numbers) == value
    else:
        with pytest.raises(ValueError, match=f"a bias of this kind takes {value}$"):
            bias.value(*numbers)


@pytest.mark.parametrize("chip", range(11))
def test_which_chips_have_biases(chip):
    if chip in (0, 1, 2, 4, 5, 9):
        assert ("AdcRefLow" in biases_of(chip)) == (chip in (4, 5, 9))
    else:
        name = {3: "DAVIS128", 6: "DAVIS640", 7: "DAVIS640H", 8: "DAVIS208", 10: "chip 10"}[chip]
        with pytest.raises(ValueError, match=f"^{name} isn't supported"):
            biases_of(chip)


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ({"exposure": 0}, {"exposure": -1}),
        ({"frame_interval": 0}, {"frame_interval": -1}),
        ({"packet_delay": 1}, {"packet_delay": 0}),
        ({"activity_filter": 1}, {"activity_filter": 0}),
        ({"refractory_filter": 1}, {"refractory_filter": 0}),
        ({"skip": 1}, {"skip": 0}),
        ({"external": "falling"}, {"external": "fall"}),
        ({"polarity": "on"}, {"polarity": "ON"}),
        ({"region": (0, 0, 1, 1)}, {"region": (-1, 0, 1, 1)}),
        ({"region": (0, 5, 1, 1)}, {"region": (0, -1, 1, 1)}),
        ({"frame_region": (0, 0, 1, 1)}, {"frame_region": (0, 0, 0, 1)}),
        ({"frame_region": (1, 1, 1, 1)}, {"frame_region": (0, 0, 1, 0)}),
        ({"region": None}, {"region": (0, 0, 1)}),
        ({"region": None}, {"region": (0, 0, 1, 1, 1)}),
        ({"masked": ((0, 0),) * 8}, {"masked": ((0, 0),) * 9}),
        ({"masked": ()}, {"masked": ((0, 0), (1,))}),
        ({"masked": ()}, {"masked": ((0, 0, 0),)}),
    ],
)
def test_settings_and_their_bounds(good, bad):
    CameraSettings(**good)
    with pytest.raises(ValueError, match=next(iter(bad))):
        CameraSettings(**bad)


def test_what_is_set_if_nothing_is_said():
    assert CameraSettings() == CameraSettings(
        {}, False, True, None, 2_000, None, 4_000, 40_000, 1_000, "pulses", (), None, "both", None
    )
    assert list(changes(FACTS, CameraSettings())) == []


@pytest.mark.parametrize(
    ("time", "clock", "count"), [(10, 90, 900), (0.5, 1, 1), (0.49, 1, 0), (1.5, 1, 2), (2.5, 1, 3)]
)
def test_a_time_in_cycles(time, clock, count):
    assert cycles(time, clock) == count


@pytest.mark.parametrize(
    ("settings", "facts", "writes"),
    [
        ({"region": (0, 0, 346, 260)}, {}, [(1, 41, 0), (1, 42, 0), (1, 43, 345), (1, 44, 259)]),
        ({"region": (3, 5, 20, 10)}, {"swap": True}, [(1, 41, 5), (1, 42, 3), (1, 43, 14), (1, 44, 22)]),
        ({"frame_region": (3, 5, 20, 10)}, {}, [(2, 8, 3), (2, 9, 5), (2, 10, 22), (2, 11, 14)]),
        ({"frame_region": (3, 5, 20, 10)}, {"frame_orientation": 4}, [(2, 8, 5), (2, 9, 3), (2, 10, 14), (2, 11, 22)]),
        ({"frame_region": (3, 5, 20, 10)}, {"frame_orientation": 3}, [(2, 8, 3), (2, 9, 5), (2, 10, 22), (2, 11, 14)]),
        ({"masked": ((7, 9), (345, 259))}, {}, [(1, 11, 9), (1, 12, 7), (1, 13, 259), (1, 14, 345)]),
        ({"masked": ((7, 9),)}, {"swap": True}, [(1, 11, 7), (1, 12, 9)]),
        ({"polarity": "on"}, {}, [(1, 62, 1), (1, 63, 0)]),
        ({"polarity": "off"}, {}, [(1, 62, 1), (1, 63, 1)]),
        ({"skip": 1}, {}, [(1, 51, 1), (1, 52, 1)]),
        # in steps of 250 µs, one at least
        ({"activity_filter": 1_000}, {}, [(1, 31, 1), (1, 32, 4)]),
        ({"activity_filter": 1}, {}, [(1, 31, 1), (1, 32, 1)]),
        ({"activity_filter": 400}, {}, [(1, 31, 1), (1, 32, 2)]),
        ({"activity_filter": None}, {}, [(1, 31, 0)]),
        ({"refractory_filter": 740}, {}, [(1, 33, 1), (1, 34, 3)]),
        ({"activity_filter": None}, {"has": frozenset()}, []),
        ({"exposure": 1}, {}, [(2, 12, 30)]),
        ({"frame_interval": 3}, {}, [(2, 13, 90)]),
        ({"external": "rising"}, {}, [(4, 1, 1), (4, 2, 0), (4, 3, 0)]),
        ({"external": "falling"}, {}, [(4, 1, 0), (4, 2, 1), (4, 3, 0)]),
        ({"external": "both"}, {}, [(4, 1, 1), (4, 2, 1), (4, 3, 0)]),
        ({"packet_delay": 2}, {}, [(9, 1, 100)]),
        ({"region": (1, 0, 346, 1)}, {}, r"region \(1, 0, 346, 1\) is not within 346x260"),
        ({"region": (0, 1, 1, 260)}, {}, "is not within 346x260"),
        ({"masked": ((346, 0),)}, {}, "is not within 346x260"),
        ({"masked": ((0, 260),)}, {}, "is not within 346x260"),
        ({"masked": ((-1, 0),)}, {}, r"masked pixel \(-1, 0\) is not"),
        ({"masked": ((0, -1),)}, {}, r"masked pixel \(0, -1\) is not"),
        ({"region": (0, 0, 1, 1)}, {"has": frozenset()}, "this DAVIS346B can't send only the events of a region"),
        ({"masked": ((0, 0),)}, {"has": frozenset(), "chip": 77}, "this chip 77 can't mask pixels"),
        ({"skip": 1}, {"has": frozenset()}, "can't skip events"),
        ({"polarity": "on"}, {"has": frozenset()}, "can't send only one polarity"),
    ],
)
def test_what_settings_change(settings, facts, writes):
    if isinstance(writes, str):
        with pytest.raises(ValueError, match=writes):
            list(changes(replace(FACTS, **facts), CameraSettings(**settings)))
    else:
        assert list(changes(replace(FACTS, **facts), CameraSettings(**settings))) == writes


def test_defaults_of_the_parts_that_a_camera_has():
    """Everything that depends on its size, clocks and parts, of a camera with all of them."""
    facts = replace(FACTS, frame_size=(340, 250))
    result = {(module, parameter): value for module, parameter, value in defaults(facts)}
    assert [result[1, n] for n in range(11, 27)] == [260, 346] * 8
    assert [result[1, n] for n in (31, 32, 33, 34, 41, 42, 43, 44, 51, 52)] == [1, 8, 0, 1, 0, 0, 345, 259, 0, 5]
    assert [result[2, n] for n in (8, 9, 10, 11, 12, 13)] == [0, 0, 339, 249, 120_000, 1_200_000]
    assert [result[4, n] for n in (5, 11, 12, 13, 14, 15, 16)] == [1_000, 0, 1, 1_000, 500, 0, 0]
    assert (result[9, 1], result[3, 9]) == (50_000, 1)
    bare = dict.fromkeys((module, parameter) for module, parameter, _ in defaults(replace(facts, has=frozenset())))
    assert sorted(set(result) - set(bare)) == sorted(
        [(1, n) for n in (*range(11, 27), 31, 32, 33, 34, 41, 42, 43, 44, 51, 52, 61, 62, 63)]
        + [(5, 142), (2, 7)]
        + [(4, n) for n in range(11, 17)]
    )


@pytest.mark.parametrize(
    ("number", "kind", "message"),
    [
        (errno.EACCES, CameraError, "no permission to use the camera; on Linux, put this line into"),
        (errno.EBUSY, CameraError, "another program uses the camera"),
        (errno.ENODEV, Unplugged, "the camera was unplugged"),
        (errno.EIO, Unplugged, "the camera was unplugged"),
        (errno.EPIPE, CameraError, "the camera refused a request: Pipe error"),
    ],
)
def test_what_errors_of_usb_mean(number, kind, message):
    with pytest.raises(CameraError, match=message) as error, _translated_errors():
        raise usb.core.USBError("Pipe error", -9, number)
    assert type(error.value) is kind


def test_a_counter_of_64_bits_is_read_until_its_halves_fit(monkeypatch):
    with Davis.find(backend=Backend(SimulatedDavis(speed=0))) as davis:
        answers = iter([(83, 1), (84, 0xFFFFFFFF), (83, 2), (83, 2), (84, 5), (83, 2)])

        def get(module, parameter):
            expected, value = next(answers)
            assert (module, parameter) == (0, expected)
            return value

        monkeypatch.setattr(davis, "get", get)
        assert davis.dropped() == (2 << 32) + 5
        davis.facts = replace(davis.facts, has=frozenset())
        assert davis.dropped() is None


@pytest.mark.parametrize(
    ("registers", "options", "result"),
    [
        ({}, {}, None),
        ({(1, 0): 4_096, (1, 1): 1, (2, 0): 1, (2, 1): 4_096}, {}, None),
        (
            {(1, 0): 4_097},
            {},
            "camera SIM00001 returns implausible answers (4097x180 pixels, frames of 240x180): plug it in again",
        ),
        ({(1, 1): 0}, {}, "returns implausible answers (240x0 pixels, frames of 240x180)"),
        ({(2, 0): 0}, {}, "returns implausible answers (240x180 pixels, frames of 0x180)"),
        ({(2, 1): 4_097}, {}, "returns implausible answers (240x180 pixels, frames of 240x4097)"),
        ({(6, 3): 4_097}, {}, "returns implausible answers (clocks of 4097, 30 and 30 MHz)"),
        ({(6, 4): 0}, {}, "returns implausible answers (clocks of 90, 0 and 30 MHz)"),
        ({(6, 3): 4_096, (6, 7): 2}, {}, None),
        ({(6, 0): 19}, {}, "camera SIM00001 has logic 19, 18 is needed: update it"),
        ({}, {"firmware": 0x0104}, None),
        ({}, {"firmware": 5, "product": 0x841A}, "has firmware 5, at least 6 is needed"),
        ({}, {"firmware": 6, "product": 0x841A}, None),
    ],
)
def test_which_answers_of_a_camera_make_sense(registers, options, result):
    camera = SimulatedDavis(speed=0, registers=dict(DAVIS240C) | registers, **options)
    if result is None:
        with Davis.find(backend=Backend(camera)) as davis:
            assert davis.facts.board == ("FX3" if "product" in options else "FX2")
        return
    with pytest.raises(CameraError) as error:
        Davis.find(backend=Backend(camera))
    assert result in str(error.value)


def test_what_a_turned_camera_without_a_serial_number_is():
    registers = {(1, 2): 4, (2, 2): 5, (2, 0): 200, (2, 1): 100, (6, 6): 999, (3, 1): 3}
    camera = SimulatedDavis(speed=0, serial="", registers=dict(DAVIS240C) | registers)
    with Davis.find(backend=Backend(SimulatedDavis(speed=0, serial="A", unplugged=True), camera)) as davis:
        facts, decoder = davis.facts, davis.decoder()
        # of bus 1, address 2
        assert facts.serial == "TMP00258"
        assert (facts.width, facts.height, facts.swap, facts.frame_size) == (180, 240, True, (100, 200))
        assert (facts.frame_orientation, facts.inertial_flips) == (5, 3)
        assert facts.logic_clock == pytest.approx(89.91)
        assert math.isclose(facts.usb_clock, 29.97, rel_tol=1e-6)
        assert (decoder.width, decoder.height, decoder.swap, decoder.frame_size) == (180, 240, True, (100, 200))
        assert (decoder.frame_orientation, decoder.chip, decoder.inertial, decoder.inertial_flips) == (5, 2, 1, 3)
        assert decoder.steady
        about = davis.about()
        assert (about["camera"], about["serial"], about["biases"]["OnBn"]) == ("DAVIS240C", "TMP00258", [5, 255])
        with pytest.raises(CameraError, match="the camera refused a request"):
            davis.set(1, 64, 1)


def test_an_answer_that_is_too_short(monkeypatch):
    with Davis.find(backend=Backend(SimulatedDavis(speed=0))) as davis:
        monkeypatch.setattr(davis.device, "ctrl_transfer", lambda *_, **how: bytes(3))
        with pytest.raises(CameraError, match="the camera answered 3 bytes for register 1/2, not 4"):
            davis.get(1, 2)


@pytest.mark.parametrize(("serial", "closed"), [("A", "BC"), ("B", "AC"), (None, "ABC"), ("D", "ABC")])
def test_cameras_that_are_not_taken_are_closed(serial, closed):
    found = []
    cameras = [SimulatedDavis(speed=0, serial=name) for name in "ABC"]
    backend = Backend(*cameras, before=lambda camera, call: found.append(camera.serial) if call == "close" else None)
    if serial in ("A", "B"):
        with Davis.find(serial, backend=backend):
            assert "".join(found) == closed
        assert sorted(found) == ["A", "B", "C"]
        return
    with pytest.raises(CameraError, match="A, B, C"):
        Davis.find(serial, backend=backend)
    assert "".join(found) == closed


def test_what_is_left_is_read_after_the_end_of_reading():
    with Davis.find(backend=Backend(SimulatedDavis(speed=0))) as davis:
        assert davis.read() == b""
        davis.end_reading()
        assert davis._stream is None
        assert davis.read() == b""
        stream = davis._stream
        davis.read()
        assert davis._stream is stream
