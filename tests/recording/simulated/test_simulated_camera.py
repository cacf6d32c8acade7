"""A simulated camera by itself: what it answers, and the words that it sends, by the decoder of real ones."""

import array
import errno
from itertools import pairwise

import numpy as np
import pytest
import usb.core

from nvsdata import Events
from nvsdata.recording.davis.stream import SPECIALS, DavisDecoder
from nvsdata.recording.simulated import camera as module
from nvsdata.recording.simulated.camera import SimulatedDavis, picture
from nvsdata.recording.simulated.scenes import Outlines

READ, WRITE, REGISTER, SEVERAL = 0xC0, 0x40, 0xBF, 0xC2
MUX, DVS, APS, IMU, EXTERNAL, CHIP, SYSTEM, USB = 0, 1, 2, 3, 4, 5, 6, 9


class Told:
    """Events, rows of time, x, y and polarity, and pulses, at times since the camera's clock was reset."""

    def __init__(self, rows=(), pulses=(), lag=0):
        self.rows, self.times, self.lag, self.asked = rows, pulses, lag, []

    def events(self, start, stop):
        self.asked.append((start - 1_000_000, stop - 1_000_000))
        rows = [row for row in self.rows if start <= row[0] + 1_000_000 < stop]
        t, x, y, p = np.array(rows, int).reshape(-1, 4).T
        return Events(t + 1_000_000, x, y, p, (240, 180))

    def pulses(self, start, stop):
        return [time + 1_000_000 for time in self.times if start <= time + 1_000_000 < stop]


@pytest.fixture
def host(monkeypatch):
    """The host's time, which stands still."""
    now = [1_000_000.0]
    monkeypatch.setattr(module, "host_time", lambda: now[0])
    return now


def write(camera, place, value):
    module, parameter = place
    camera.control(WRITE, REGISTER, module, parameter, value.to_bytes(4, "big"))


def running(scene, *off, on=(), **how):
    camera = SimulatedDavis(scene=scene, **{"speed": 0} | how)
    for place in ((MUX, 3), (USB, 0), (MUX, 1), (MUX, 0), (DVS, 3), (EXTERNAL, 0), *on):
        write(camera, place, int(place not in off))
    return camera


def sent(camera, size=1 << 20, reads=None):
    """What waits, as bytes; None if nothing does. `reads` limits how often it is read (default: to the end)."""
    buffer, found = array.array("B", bytes(size)), None
    while reads != 0:
        try:
            found = (found or b"") + bytes(buffer[: camera.bulk(buffer)])
        except usb.core.USBTimeoutError:
            break
        reads = reads and reads - 1
    return found


def decoded(data):
    ours = DavisDecoder(240, 180)
    events = ours.feed(data)
    assert not any(ours.error_counts.values())
    rows = list(zip(*(column.tolist() for column in events.columns), strict=True))
    specials = [(int(t), SPECIALS[int(kind)]) for t, kind in zip(ours.specials.t, ours.specials.kind, strict=True)]
    return rows, specials, ours


def test_events_pulses_and_the_clock_in_the_order_of_their_times(host):
    rows = [
        (0, 1, 2, 0),
        (5, 7, 3, 1),
        (5, 8, 3, 0),
        (10, 0, 0, 1),
        (40_000, 9, 3, 1),
        (40_000, 9, 179, 1),
        (70_001, 239, 179, 0),
    ]
    pulses = [10, 12, 32_768, 40_000, 70_000]
    camera = running(Told(rows, pulses))
    camera.advance(100_000)
    found, specials, ours = decoded(sent(camera))
    assert found == rows
    assert [t for t, kind in specials if kind == "external_pulse"] == pulses
    assert len(specials) == 5
    # the clock's wraps come without events, too
    assert ours.now == 3 * 32_768
    assert sent(camera) is None
    # one goes on where the other ended
    camera.scene.rows = [(100_000, 1, 1, 1), (131_072, 2, 2, 0)]
    camera.advance(50_000)
    assert [(t, x) for t, x, _, _ in decoded_after(ours, sent(camera))] == [(100_000, 1), (131_072, 2)]
    # what it caught up on at once is as long as a slice
    assert camera.scene.asked == list(pairwise((*range(0, 150_000, 20_000), 150_000)))


def decoded_after(decoder, data):
    return list(zip(*(column.tolist() for column in decoder.feed(data).columns), strict=True))


def test_time_passes_by_the_host_s_clock_its_own_speed_and_what_is_known(host):
    camera = running(Told([(t, 1, 1, 1) for t in range(0, 30_000, 100)], [9_000], lag=3_000), speed=1.5)
    host[0] += 3_000 + 2_600
    # 3,900 µs of its time: it isn't looked at more often than each 4 ms
    assert sent(camera) is None
    host[0] += 3_400
    rows, specials, _ = decoded(sent(camera))
    assert camera.scene.asked == [(0, 6_000)]
    assert [t for t, *_ in rows] == list(range(0, 9_000, 150))
    assert specials == []
    host[0] += 4_000
    assert camera.control(READ, REGISTER, DVS, 3, array.array("B", bytes(4))) == 4
    _, specials, _ = decoded(sent(camera))
    assert specials == [(13_500, "external_pulse")]


@pytest.mark.parametrize("off", [(MUX, 3), (USB, 0), (MUX, 1), (MUX, 0)])
def test_it_sends_nothing_unless_all_of_it_runs(host, off):
    camera = running(Told([(5, 1, 1, 1)]), off)
    camera.advance(50_000)
    assert sent(camera) is None
    write(camera, off, 1)
    camera.advance(50_000)
    # its time begins then, and stops again
    assert decoded(sent(camera))[0] == [(5, 1, 1, 1)]
    write(camera, off, 0)
    camera.advance(50_000)
    assert sent(camera) is None


def test_what_is_switched_off_is_not_sent(host):
    scene = Told([(5, 1, 1, 1)], [7])
    for off, found in (((DVS, 3), None), ((EXTERNAL, 0), ([(5, 1, 1, 1)], []))):
        camera = running(scene, off)
        camera.advance(20_000)
        data = sent(camera)
        assert data is found or decoded(data)[:2] == found
    stalled = running(scene)
    stalled.stalled = True
    stalled.advance(20_000)
    assert sent(stalled) is None


def test_a_reset_of_the_clock_is_the_first_that_is_sent(host):
    camera = running(Told([(5, 1, 1, 1)]))
    camera.advance(20_000)
    write(camera, (MUX, 2), 1)
    write(camera, (MUX, 2), 0)
    assert sent(camera) == b"\1\0"
    camera.advance(20_000)
    rows, _, _ = decoded(sent(camera))
    assert rows == [(5, 1, 1, 1)]


def test_samples_come_each_tenth_of_a_second(host):
    camera = running(Told(), on=[(IMU, 4)])
    found = []
    for step in (100_000, 1, 99_999, 1, 1, 30_000):
        camera.advance(step)
        ours = DavisDecoder(240, 180)
        ours.feed(sent(camera) or b"")
        found.append(ours.samples.t.size)
        if ours.samples.t.size:
            assert ours.samples.acceleration.tolist() == [[0, -1, 0]]
            assert ours.samples.rotation.tolist() == [[0, 0, 0]]
            assert ours.samples.temperature.tolist() == [25]
    # it looks at its scene no more often than each 4 ms
    assert found == [0, 0, 1, 0, 0, 0]


def test_frames_come_as_often_as_they_are_asked_for(host):
    camera = running(Told(), on=[(APS, 4)])
    for place, value in (((APS, 13), 30 * 20_000), ((APS, 8), 10), ((APS, 9), 20), ((APS, 10), 12), ((APS, 11), 23)):
        write(camera, place, value)
    ours, frames = DavisDecoder(240, 180), []
    for step in (19_999, 4_000, 10_000, 15_000):
        camera.advance(step)
        ours.feed(sent(camera) or b"")
        frames.append([(frame.x, frame.y) for frame in ours.frames])
        for frame in ours.frames:
            assert (frame.pixels >> 6).tolist() == picture([10, 20, 12, 23]).tolist()
    assert frames == [[], [(10, 20)], [], [(10, 20)]]
    assert picture([10, 20, 12, 23]).tolist() == [[60, 62, 64], [62, 64, 66], [64, 66, 68], [66, 68, 70]]


def test_a_busy_computer_loses_nothing(host):
    """Ten seconds pass between two reads, at 200,000 events/s: more than a real camera could keep."""
    scene = Outlines(noise=0)
    camera = running(scene, speed=1)
    host[0] += 10e6
    ours, count, least = DavisDecoder(240, 180), 0, []
    while block := sent(camera, reads=1):
        least.append(len(block))
        count += len(ours.feed(block))
    began = 1_000_000
    slices = range(began, began + 10_000_000, module.SLICE)
    assert count == sum(len(scene.events(start, start + module.SLICE)) for start in slices) > 1_900_000
    assert camera.registers[MUX, 84] == 0
    # it never keeps more than a slice
    assert max(least) < 8 * 0.03 * 200_000
    # and what it was switched off for isn't missing
    host[0] += 1e6
    write(camera, (DVS, 3), 0)
    for place in ((MUX, 0), (MUX, 1), (USB, 0), (MUX, 3)):
        write(camera, place, 0)
    assert len(ours.feed(sent(camera))) == pytest.approx(200_000, rel=0.02)


def test_a_scene_that_takes_longer_than_it_lasts_holds_no_request_up(host):
    class Slow(Told):
        def events(self, start, stop):
            assert len(self.asked) < 60, "it sees what happens while it looks, and so on without end"
            host[0] += 2 * (stop - start)
            return super().events(start, stop)

    camera = running(Slow(), speed=1)
    host[0] += 1e6
    write(camera, (MUX, 0), 0)
    assert camera.scene.asked[-1][1] == 1_000_000 == 50 * module.SLICE


def test_an_hour_s_pause_is_not_caught_up_on(host):
    camera = running(Outlines(rate=20_000, noise=0), speed=1)
    host[0] += 3_600e6
    assert len(decoded(sent(camera))[0]) == pytest.approx(30 * 20_000, rel=0.02)
    assert camera.registers[MUX, 84] == pytest.approx(3_570 * 20_000, rel=0.1)


def test_what_finds_no_room_is_dropped_and_counted(host):
    camera = running(Told([(n, n, 1, 1) for n in range(10)]), room=80)
    camera.advance(20_000)
    assert len(decoded(sent(camera))[0]) == 10
    camera.scene.rows = [(20_000 + n, n, 1, 1) for n in range(11)]
    camera.advance(20_000)
    # its clock isn't
    rows, _, ours = decoded(sent(camera))
    assert (rows, ours.now) == ([], 32_768)
    assert camera.registers[MUX, 84] == 11
    camera.lossy, camera.scene.rows = 1.0, [(40_000, 1, 1, 1)]
    camera.advance(30_000)
    assert decoded(sent(camera))[0] == []
    assert camera.registers[MUX, 84] == 12
    camera.registers[MUX, 84] = 0xFFFFFFFF
    camera.scene.rows = [(70_000, 1, 1, 1), (70_000, 2, 1, 1)]
    camera.advance(30_000)
    sent(camera)
    assert camera.registers[MUX, 84] == 1


def test_words_are_read_whole(host):
    camera = running(Told([(5, 7, 3, 1)]))
    camera.advance(20_000)
    whole = [sent(camera, size, reads=1) for size in (5, 3, 3, 2)]
    assert [part and len(part) for part in whole] == [4, 2, None, None]
    assert whole[0] + whole[1] == np.array([0x8005, 0x1003, 0x3007], "<u2").tobytes()


@pytest.mark.parametrize(
    ("module", "first", "last"),
    [(MUX, 0, 5), (DVS, 3, 63), (APS, 4, 13), (IMU, 2, 10), (EXTERNAL, 0, 16), (CHIP, 0, 144), (USB, 0, 1)],
)
def test_which_registers_there_are(module, first, last):
    camera = SimulatedDavis(scene=Told(), speed=0)
    answer = array.array("B", bytes(4))
    for parameter in (first, last):
        write(camera, (module, parameter), 0x01020300 + parameter)
        assert camera.control(READ, REGISTER, module, parameter, answer) == 4
        assert answer.tolist() == [1, 2, 3, parameter]
        assert camera.log[-1] == (READ, REGISTER, module, parameter, bytes(answer))
    for parameter in (last + 1, *([first - 1] if first else [])):
        with pytest.raises(usb.core.USBError, match="Pipe") as refused:
            write(camera, (module, parameter), 1)
        assert refused.value.errno == errno.EPIPE


@pytest.mark.parametrize(
    ("kind", "request_", "value", "data"),
    [
        (READ, REGISTER, MUX, bytes(3)),
        (READ, SEVERAL, MUX, bytes(4)),
        (READ, REGISTER, 7, bytes(4)),
        (WRITE, REGISTER, MUX, bytes(5)),
        (WRITE, REGISTER, 8, bytes(4)),
        (WRITE, SEVERAL, 1, bytes(5)),
        (WRITE, SEVERAL, 2, bytes(6)),
        (WRITE, SEVERAL, 1, bytes([8, 0, 0, 0, 0, 1])),
        (0, REGISTER, MUX, bytes(4)),
    ],
)
def test_what_it_does_not_know_stalls(kind, request_, value, data):
    camera = SimulatedDavis(scene=Told(), speed=0)
    with pytest.raises(usb.core.USBError) as refused:
        camera.control(kind, request_, value, 0, array.array("B", data))
    assert refused.value.errno == errno.EPIPE
    assert camera.log == []


def test_several_registers_at_once():
    camera = SimulatedDavis(scene=Told(), speed=0)
    data = bytes([DVS, 5, 1, 2, 3, 4, CHIP, 9, 0, 0, 0, 7])
    assert camera.control(WRITE, SEVERAL, 2, 0, data) == 12
    assert (camera.registers[DVS, 5], camera.registers[CHIP, 9]) == (0x01020304, 7)
