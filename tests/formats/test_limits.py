"""What files of each format can hold, at the very bounds, and their headers byte by byte."""

import numpy as np
import pytest

import nvsdata
from nvsdata import Events, FormatError

WRAP, SILENT = 2**32, 5 * 60 * 1_000_000
CLOCKED = {".dat": "Prophesee .dat", ".aedat": "AEDAT 2.0", ".aedat1": "AEDAT 1.0"}


def at(times, size=(8, 8), x=1, y=2):
    return Events(times, np.full(len(times), x), np.full(len(times), y), np.ones(len(times), int), size)


FIT = (
    [0, 0],
    [WRAP - 2],
    [0, 2**31 - 1],
    [7, 2**31 + 6],
    [5, 5 + SILENT + 1],
    [WRAP - 9, WRAP - 9 + SILENT],
    [WRAP - 2, WRAP - 1, WRAP],
    [WRAP - 1 - SILENT, WRAP - 1],
    [WRAP - SILENT - 2, WRAP - 1],
)
UNFIT = (
    [-1, 5],
    [WRAP - 1],
    [WRAP + 5],
    [0, 2**31],
    [WRAP - 9, WRAP - 8 + SILENT],
    [WRAP - SILENT - 1, WRAP],
    [0, 9, WRAP - SILENT - 1, WRAP],
)


@pytest.mark.parametrize("suffix", CLOCKED)
@pytest.mark.parametrize("parts", [1, 2])
def test_times_that_a_reader_unwraps(tmp_path, suffix, parts):
    path = tmp_path / f"a{suffix}"
    for times in FIT:
        pieces = [at(times)] if parts == 1 else [at([time]) for time in times]
        assert nvsdata.write(iter(pieces), path) == len(times)
        assert nvsdata.read(path).t.tolist() == times
    path.unlink()
    gaps = "gaps below 2^31 µs only, of at most 5 minutes where its counter wraps"
    only = f"supports a first time in [0, 2^32 - 1) µs and {gaps}"
    for times in UNFIT:
        pieces = [at(times)] if parts == 1 else [at([time]) for time in times]
        with pytest.raises(ValueError, match=r"2\^32 - 1") as caught:
            nvsdata.write(iter(pieces), path)
        assert str(caught.value) == f"{CLOCKED[suffix]} {only}"
    assert not list(tmp_path.iterdir())


CAMERAS = (
    ((128, 128), "ch.unizh.ini.jaer.chip.retina.DVS128"),
    ((1, 128), "ch.unizh.ini.jaer.chip.retina.DVS128"),
    ((129, 1), "eu.seebetter.ini.chips.davis.DAVIS240C"),
    ((1, 129), "eu.seebetter.ini.chips.davis.DAVIS240C"),
    ((240, 180), "eu.seebetter.ini.chips.davis.DAVIS240C"),
    ((241, 1), "eu.seebetter.ini.chips.davis.Davis346red"),
    ((1, 181), "eu.seebetter.ini.chips.davis.Davis346red"),
    ((346, 260), "eu.seebetter.ini.chips.davis.Davis346red"),
)


@pytest.mark.parametrize(("size", "camera"), CAMERAS)
def test_the_header_of_aedat_2_names_the_smallest_camera(tmp_path, size, camera):
    ev = at([1_000, 2_000], size, size[0] - 1, size[1] - 1)
    nvsdata.write(ev, tmp_path / "a.aedat")
    lines, body = (tmp_path / "a.aedat").read_bytes().split(b"#End Of ASCII Header\r\n")
    scales = (
        b'#<entry key="ImuAccelScale" value="ImuAccelScaleG4"/>',
        b'#<entry key="ImuGyroScale" value="GyroFullScaleDegPerSec500"/>',
    )
    assert lines.split(b"\r\n") == [
        b"#!AER-DAT2.0",
        b"# Written by nvsdata",
        b"# Timestamps tick is 1 us",
        b"# AEChip: " + camera.encode(),
        b"# nvsdata sensor %dx%d" % size,
        *(() if "DVS128" in camera else scales),
        b"# nvsdata time                 1000 to                 2000 us",
        b"",
    ]
    assert len(body) == 16
    assert list(nvsdata.read(tmp_path / "a.aedat").columns[1]) == [size[0] - 1] * 2
    assert list(nvsdata.read(tmp_path / "a.aedat").columns[2]) == [size[1] - 1] * 2
    assert nvsdata.open(tmp_path / "a.aedat").sensor_size == size


@pytest.mark.parametrize(
    ("stated", "reason"),
    [
        (b"999x128", "states a sensor of 999x128, more than the 346x260 of its chip"),
        (b"0x12", "invalid sensor size"),
    ],
)
def test_a_sensor_that_its_chip_has_no_room_for_is_refused(tmp_path, stated, reason):
    nvsdata.write(at([1_000, 2_000], (320, 240), 319, 239), tmp_path / "a.aedat")
    assert nvsdata.open(tmp_path / "a.aedat").sensor_size == (320, 240)
    raw = (tmp_path / "a.aedat").read_bytes().replace(b"320x240", stated)
    (tmp_path / "a.aedat").write_bytes(raw)
    with pytest.raises(nvsdata.FormatError, match=reason):
        nvsdata.open(tmp_path / "a.aedat")


@pytest.mark.parametrize(
    ("name", "options", "sizes", "reason"),
    [
        ("a.aedat", {}, [(347, 1), (1, 261)], "AEDAT 2.0 is written for sensors up to 346x260, not {}x{}"),
        ("a.aedat1", {}, [(129, 1), (1, 129)], "AEDAT 1.0 is written for sensors up to 128x128, not {}x{}"),
        ("a.dat", {}, [(16_385, 1), (1, 16_385)], "Prophesee .dat supports coordinates up to 16383 only"),
        *(
            ("a.raw", {"format": f"evt{n}"}, [(2_049, 1), (1, 2_049)], f"EVT {n} supports coordinates up to 2047 only")
            for n in ("2", "3", "2.1")
        ),
    ],
)
def test_sensors_that_are_too_large(tmp_path, name, options, sizes, reason):
    for width, height in sizes:
        with pytest.raises(ValueError, match="up to") as caught:
            nvsdata.write(Events.empty((width, height)), tmp_path / name, **options)
        said = str(caught.value).replace("EVT 2.0", "EVT 2").replace("EVT 3.0", "EVT 3")
        assert said == reason.format(width, height)
        inside = (width - (width > 1), height - (height > 1))
        ev = at([1], inside, inside[0] - 1, inside[1] - 1)
        nvsdata.write(ev, tmp_path / name, **options)
        assert nvsdata.read(tmp_path / name, sensor_size=inside) == ev


EVT = {
    "evt2": (b"% evt 2.0\n% format EVT2;height=5;width=7\n", 2**51),
    "evt2.1": (b"% evt 2.1\n% format EVT21;height=5;width=7;endianness=legacy\n", 2**51),
    "evt3": (b"% evt 3.0\n% format EVT3;height=5;width=7\n", 2**40),
}


@pytest.mark.parametrize("kind", EVT)
def test_headers_and_times_of_evt(tmp_path, kind):
    begin, limit = EVT[kind]
    nvsdata.write(at([1_000, 2_000], (7, 5)), tmp_path / "a.raw", format=kind)
    time = b"% nvsdata time                 1000 to                 2000 us\n"
    assert (tmp_path / "a.raw").read_bytes().startswith(begin + b"% geometry 7x5\n" + time + b"% end\n")
    for times in ([-1], [limit], [0, limit]):
        with pytest.raises(ValueError, match=rf"^times from {times[0]} to {times[-1]} µs: EVT [23]\.[01] supports"):
            nvsdata.write(at(times), tmp_path / "b.raw", format=kind)


def test_headers_of_aedat_1_and_3_and_dat(tmp_path):
    time = "nvsdata time                   -3 to                    9 us"
    ev = Events([0, 9], [1, 2], [3, 4], [0, 1], (7, 5), start=-3)
    heads = {
        ".aedat1": "#!AER-DAT1.0\r\n# Written by nvsdata\r\n# Timestamps tick is 1 us\r\n"
        "# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n# nvsdata sensor 7x5\r\n"
        f"# {time}\r\n#End Of ASCII Header\r\n",
        ".aedat3": f"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: nvsdata-7x5\r\n# {time}\r\n#!END-HEADER\r\n",
        ".dat": f"% Data file containing CD events.\n% {time}\n% Version 2\n% Width 7\n% Height 5\n\x0c\x08",
        ".txt": f"# nvsdata events: x y t p, sorted, sensor 7x5\n# {time}\n1 3 0 0\n2 4 9 1\n",
    }
    for suffix, head in heads.items():
        nvsdata.write(ev, tmp_path / f"a{suffix}")
        raw = (tmp_path / f"a{suffix}").read_bytes()
        assert raw[: len(head)] == head.encode()
        assert nvsdata.read(tmp_path / f"a{suffix}", sensor_size=(7, 5)) == ev


@pytest.mark.parametrize(
    ("size", "source"),
    [
        ((128, 128), b"DVS128"),
        ((240, 180), b"DAVIS240"),
        ((346, 260), b"DAVIS346"),
        ((640, 480), b"DVXPLORER"),
        ((240, 181), b"nvsdata-240x181"),
    ],
)
def test_aedat_3_names_its_source(tmp_path, size, source):
    nvsdata.write(at([1], size), tmp_path / "a.aedat3")
    assert b"\r\n#Source 1: " + source + b"\r\n" in (tmp_path / "a.aedat3").read_bytes()
    assert nvsdata.open(tmp_path / "a.aedat3").sensor_size == size


def test_packets_of_aedat_3_byte_by_byte(tmp_path):
    ev = Events([5, 2**31 - 1, 2**31, 2**31 + 7], [1, 2, 3, 32_766], [4, 5, 6, 32_766], [1, 0, 1, 1])
    nvsdata.write(ev, tmp_path / "a.aedat3")
    body = (tmp_path / "a.aedat3").read_bytes().partition(b"#!END-HEADER\r\n")[2]
    words = np.frombuffer(body, "<u4").tolist()

    def header(overflow):
        # type and source, size, where the time is, overflow, room, number, valid
        return [1 | 1 << 16, 8, 4, overflow, 2, 2, 2]

    assert words == [
        *header(0),
        *(1 << 17 | 4 << 2 | 1 << 1 | 1, 5),
        *(2 << 17 | 5 << 2 | 1, 2**31 - 1),
        *header(1),
        *(3 << 17 | 6 << 2 | 1 << 1 | 1, 0),
        *(32_766 << 17 | 32_766 << 2 | 1 << 1 | 1, 7),
    ]


@pytest.mark.parametrize("count", [8_191, 8_192, 8_193, 16_384])
def test_packets_of_aedat_3_hold_8192_events(tmp_path, count):
    nvsdata.write(at(np.arange(count)), tmp_path / "a.aedat3")
    numbers = nvsdata.open(tmp_path / "a.aedat3").packets[:, 1].tolist()
    assert numbers == [8_192] * (count // 8_192) + [count % 8_192] * (count % 8_192 > 0)


def test_words_of_dat_byte_by_byte(tmp_path):
    nvsdata.write(Events([5, 9], [3, 16_383], [7, 16_383], [0, 1]), tmp_path / "a.dat")
    body = (tmp_path / "a.dat").read_bytes().partition(b"\x0c\x08")[2]
    assert np.frombuffer(body, "<u4").tolist() == [5, 3 | 7 << 14, 9, 16_383 | 16_383 << 14 | 1 << 28]


def test_bounds_of_atis(tmp_path):
    path = tmp_path / "a.bin"
    for ev in (at([0, 2**33 - 1], (256, 240), 255, 239), at([2**33 - 1], (256, 256), 0, 0)):
        nvsdata.write(ev, path)
        assert nvsdata.read(path, sensor_size=ev.sensor_size) == ev
    for times in ([-1, 0], [0, 2**33]):
        with pytest.raises(ValueError, match=r"^ATIS \.bin supports times from 0 to 8589934591 µs only$"):
            nvsdata.write(at(times), path)
    for x, y in ((256, 1), (1, 240)):
        with pytest.raises(ValueError, match=r"^ATIS \.bin supports x up to 255 and y up to 239 only$"):
            nvsdata.write(at([1], (300, 300), x, y), path)


@pytest.mark.parametrize("suffix", [".h5", ".txt", ".npy"])
def test_times_below_2_to_the_62_are_written_and_others_named(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    times = [1 - 2**62, 2**62 - 1]
    nvsdata.write(at(times), path)
    assert nvsdata.read(path).t.tolist() == times
    for wrong in ([-(2**62), 5], [5, 2**62]):
        columns = at([0, 1]).columns._replace(t=np.array(wrong))
        with pytest.raises(ValueError, match="times from") as caught:
            nvsdata.write(Events.trusted(columns, (8, 8)), path)
        assert str(caught.value) == f"times from {wrong[0]} to {wrong[1]} µs: files support times below 2^62 only"


@pytest.mark.parametrize("suffix", [".txt", ".aedat", ".dat", ".aedat3"])
@pytest.mark.parametrize(("first", "last", "fine"), [(10, 99, True), (11, 99, False), (10, 98, False), (9, 100, True)])
def test_stated_times_hold_the_first_and_last_event_or_not(tmp_path, suffix, first, last, fine):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(at([10, 99]), path)
    stated, now = (f"nvsdata time {a:>20} to {b:>20} us".encode() for a, b in ((10, 99), (first, last)))
    path.write_bytes(path.read_bytes().replace(stated, now))
    recording = nvsdata.open(path, strict=False)
    assert (recording.read().start, recording.read().end) == ((first, last) if fine else (10, 99))
    left_out = {"times of start and end that don't contain the events, left out": 1}
    assert recording.repairs == ({} if fine else left_out)
    if fine:
        assert (nvsdata.read(path).start, nvsdata.read(path).end) == (first, last)
    else:
        with pytest.raises(
            FormatError, match=f"events at 10 to 99 µs, outside the time that it states: {first} to {last} µs"
        ):
            nvsdata.read(path)


@pytest.mark.parametrize(
    ("first", "last", "fine"),
    [(5, 5, True), (6, 5, False), (1 - 2**62, 2**62 - 1, True), (-(2**62), 5, False), (5, 2**62, False)],
)
def test_stated_times_make_sense_or_not(tmp_path, first, last, fine):
    head = "# nvsdata events: x y t p, sorted, sensor 5x5\n"
    (tmp_path / "a.txt").write_text(f"{head}# nvsdata time {first} to {last} us\n")
    recording = nvsdata.open(tmp_path / "a.txt", strict=False)
    left_out = {"invalid times of start and end, left out": 1}
    assert recording.repairs == ({} if fine else left_out)
    if fine:
        strict = nvsdata.open(tmp_path / "a.txt")
        assert (strict.start, strict.end) == (first, last)
    else:
        with pytest.raises(FormatError, match=f"states invalid times of start and end: {first} to {last} µs"):
            nvsdata.open(tmp_path / "a.txt")
