import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import aedat2_bytes, rows

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats.aedat import aedat1
from nvsdata.kernels.decode.clock import SILENT_US

CHIP = "#!AER-DAT2.0\r\n# AEChip: {}\r\n"


def slow_dvs128(raw: bytes):
    """Record by record, from the format's description; times unwrapped."""
    out, last = [], None
    for i in range(0, len(raw), 8):
        a, t = int.from_bytes(raw[i : i + 4], "big"), int.from_bytes(raw[i + 4 : i + 8], "big")
        last = t if last is None else last + (t - last + 2**31) % 2**32 - 2**31
        if not a & 0x80008000:
            out.append((last, 127 - (a >> 1 & 127), 127 - (a >> 8 & 127), 1 - (a & 1)))
    return sorted(out, key=lambda event: event[0])


@given(
    st.integers(0, 2**32 - 2),
    st.lists(st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 2**31 - 1) | st.integers(-90, 90)), max_size=200),
)
def test_any_dvs128_records_decode_as_the_description_says(tmp_path, first, records):
    time = []
    for _, step in records:
        last = time[-1] if time else first
        # no longer a silence over a wrap than a camera's
        wraps = (last + step) // 2**32 > last // 2**32
        time.append(max(last + (min(step, SILENT_US) if wraps else step), 0))
    raw = aedat2_bytes([address for address, _ in records], time, b"")
    header = CHIP.format("ch.unizh.ini.jaer.chip.retina.DVS128").encode() + b"#End Of ASCII Header\r\n"
    (tmp_path / "a.aedat").write_bytes(header + raw)
    assert list(rows(nvsdata.read(tmp_path / "a.aedat"))) == slow_dvs128(raw)


def test_davis_words_other_than_polarity_events_are_left_out(tmp_path):
    event = (170 << 22) | (200 << 12) | (1 << 11)
    words = [event, event | 1 << 31, event | 1 << 10, event & ~(1 << 11), 0xB0000C00]
    header = CHIP.format("eu.seebetter.ini.chips.davis.DAVIS240C").encode()
    (tmp_path / "a.aedat").write_bytes(aedat2_bytes(words, range(10, 15), header))
    assert list(rows(nvsdata.read(tmp_path / "a.aedat"))) == [(10, 39, 9, 1), (13, 39, 9, 0)]


CHIPS = [("DAVIS240C", 240, 180), ("Davis346blue", 346, 260), ("Davis346red", 346, 260)]


@pytest.mark.parametrize(("chip", "width", "height"), CHIPS)
def test_addresses_as_jaer_has_them_for_every_davis(tmp_path, chip, width, height):
    """Bits as its DavisChip and DavisBaseCamera (2026) take them apart: x is mirrored, y counts from the bottom."""
    places = [(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1), (200, 17)]
    words = [(height - 1 - y) << 22 | (width - 1 - x) << 12 | (n % 2) << 11 for n, (x, y) in enumerate(places)]
    header = CHIP.format(f"eu.seebetter.ini.chips.davis.{chip}").encode()
    (tmp_path / "a.aedat").write_bytes(aedat2_bytes(words, range(len(words)), header))
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert (recording.sensor_size, recording.size_is_guessed) == ((width, height), False)
    assert list(rows(nvsdata.read(tmp_path / "a.aedat"))) == [(n, x, y, n % 2) for n, (x, y) in enumerate(places)]


def test_without_a_chip_the_addresses_or_the_sensor_tell(tmp_path):
    davis = (170 << 22) | (200 << 12)
    (tmp_path / "davis.aedat").write_bytes(aedat2_bytes([davis], [5]))
    (tmp_path / "dvs.aedat").write_bytes(aedat2_bytes([0x0102], [5]))
    assert nvsdata.open(tmp_path / "davis.aedat").sensor_size == (240, 180)
    assert nvsdata.open(tmp_path / "dvs.aedat").sensor_size == (128, 128)
    assert nvsdata.open(tmp_path / "dvs.aedat").size_is_guessed
    assert not nvsdata.open(tmp_path / "dvs.aedat", sensor_size=(128, 128)).size_is_guessed
    assert nvsdata.open(tmp_path / "dvs.aedat", sensor_size=(240, 180)).layout == 1


def test_an_unknown_camera_is_named(tmp_path):
    (tmp_path / "a.aedat").write_bytes(CHIP.format("some.Cochlea").encode() + bytes(8))
    with pytest.raises(FormatError, match="COCHLEA"):
        nvsdata.open(tmp_path / "a.aedat")


def test_a_first_record_that_begins_like_a_header_line(tmp_path):
    # y = 140 on a DAVIS puts 0x23, the byte of '#', first
    address = 0x23 << 24 | 17 << 12
    header = CHIP.format("x.DAVIS240C").encode()
    (tmp_path / "a.aedat").write_bytes(aedat2_bytes([address] * 3, [7, 10, 2_571], header))
    assert nvsdata.read(tmp_path / "a.aedat").t.tolist() == [7, 10, 2_571]


def test_aedat_1_has_addresses_of_two_bytes(tmp_path):
    record = (5 << 8 | 3 << 1 | 1).to_bytes(2, "big") + (77).to_bytes(4, "big")
    (tmp_path / "a.aedat").write_bytes(b"#!AER-DAT1.0\r\n" + record * 2)
    assert list(rows(nvsdata.read(tmp_path / "a.aedat"))) == [(77, 124, 122, 0)] * 2


@pytest.mark.parametrize("suffix", ["aedat", "aedat1"])
@given(first=st.integers(0, 2**32 - 2), gap=st.integers(0, SILENT_US))
def test_times_go_round_through_the_wrap(tmp_path, suffix, first, gap):
    t = first + gap * np.arange(6)
    ev = Events(t, [1, 2, 3, 4, 5, 6], [6, 5, 4, 3, 2, 1], [0, 1, 0, 1, 0, 1], (128, 128))
    nvsdata.write(ev, tmp_path / f"a.{suffix}")
    assert nvsdata.read(tmp_path / f"a.{suffix}") == ev
    assert nvsdata.read(tmp_path / f"a.{suffix}", int(t[2]), int(t[5])) == ev.window(int(t[2]), int(t[5]))


@pytest.mark.parametrize("size", [(128, 128), (240, 180), (346, 260)])
def test_each_camera_goes_round(tmp_path, size):
    rng = np.random.default_rng(0)
    ev = Events(
        np.arange(500) * 9, rng.integers(0, size[0], 500), rng.integers(0, size[1], 500), rng.integers(0, 2, 500), size
    )
    nvsdata.write(ev, tmp_path / "a.aedat")
    assert nvsdata.read(tmp_path / "a.aedat") == ev


def test_aedat_1_is_written_in_six_bytes_for_a_dvs128_alone(tmp_path):
    path = tmp_path / "a.aedat1"
    nvsdata.write(Events([77, 80], [124, 0], [122, 0], [0, 1], (128, 128)), path)
    assert path.read_bytes().split(b"Header\r\n")[1] == bytes([5, 7, 0, 0, 0, 77, 0x7F, 0xFE, 0, 0, 0, 80])
    assert nvsdata.open(path).format == "aedat1"
    with pytest.raises(ValueError, match=r"AEDAT 1\.0 is written for sensors up to 128x128, not 129x4"):
        nvsdata.write(Events([], [], [], [], (129, 4)), path)


@pytest.mark.parametrize("header", [b"", b"# This is a raw AE data file\r\n# sep 2006\r\n"])
def test_a_file_that_names_no_version_is_aedat_1(tmp_path, header):
    rng = np.random.default_rng(0)
    x, y, p = rng.integers(0, 128, 400), rng.integers(0, 128, 400), rng.integers(0, 2, 400)
    ev = Events(np.arange(400) * 9 + 2**32 - 1_000, x, y, p, (128, 128))  # the counter wraps
    nvsdata.write(ev[:100], tmp_path / "head.aedat1")
    nvsdata.write(ev, tmp_path / "a.aedat1")
    for name, events in (("head", ev[:100]), ("a", ev)):
        records = (tmp_path / f"{name}.aedat1").read_bytes().split(b"Header\r\n")[1]
        (tmp_path / "old.aedat").write_bytes(header + records)
        recording = nvsdata.open(tmp_path / "old.aedat")
        assert recording.format == "aedat1"
        assert recording.read() == events
        (tmp_path / "old.aedat").write_bytes((header + records)[:-4])
        with pytest.raises(FormatError, match="truncated: 2 bytes are left over, but a record has 6"):
            nvsdata.open(tmp_path / "old.aedat")
        assert nvsdata.read(tmp_path / "old.aedat", strict=False) == events[:-1]


def timed(times):
    """AEDAT 1.0 records at these times."""
    return b"".join(b"\1\2" + time.to_bytes(4, "big") for time in times)


@pytest.mark.parametrize(
    ("head", "seems"),
    [
        (timed(range(16)), True),
        (timed(range(16)) + b"\0\0\0", True),
        (timed(range(15)) + bytes(5), False),
        (b"# a\r\n" + timed(range(16)), True),
        (b"#!AER\r\n" + timed(range(16)), False),
        (timed([5] * 16), False),
        (timed([5] * 15 + [6]), True),
        (timed([5] * 8 + [4] + [5] * 8), False),
        (timed([0] * 15 + [2**31 - 1]), True),
        (timed([0] * 15 + [2**31]), False),
        (timed([2**32 - 1] * 15 + [3]), True),
        (timed([*range(255), 0]), False),
        (timed([*range(256), 0]), True),
        (b"# a\r\n" + timed([*range(255), 0]), False),
        (b"# a\r\n" + timed([*range(256), 0]), True),
    ],
)
def test_what_begins_with_records_whose_times_rise_seems_to_be_aedat_1(head, seems):
    assert aedat1.looks_like(head, len(head)) is seems


@pytest.mark.parametrize(
    "content", [bytes(600), b"#!AER-DAT7.0\r\n" + bytes(range(96)), np.arange(150, 0, -1).tobytes()]
)
def test_what_only_ends_in_aedat_is_none(tmp_path, content):
    (tmp_path / "a.aedat").write_bytes(content)
    with pytest.raises(
        FormatError,
        match="byte 0: the extension means aedat2, but the file doesn't begin like one",
    ):
        nvsdata.open(tmp_path / "a.aedat")


@pytest.mark.parametrize(
    ("t", "size"),
    [
        ([2**32 - 1], (128, 128)),
        ([2**32], (128, 128)),
        ([0, 2**31], (128, 128)),
        ([2**32 - 9, 2**32 - 9 + SILENT_US + 1], (128, 128)),
        ([0], (347, 260)),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, t, size):
    with pytest.raises(ValueError, match=r"AEDAT 2\.0"):
        nvsdata.write(Events(t, [1] * len(t), [1] * len(t), [1] * len(t), size), tmp_path / "a.aedat")


def test_a_torn_record_is_named_or_cut(tmp_path):
    (tmp_path / "a.aedat").write_bytes(aedat2_bytes([2, 4], [5, 6])[:-3])
    with pytest.raises(FormatError, match="byte 22: truncated: 5 bytes"):
        nvsdata.open(tmp_path / "a.aedat")
    recording = nvsdata.open(tmp_path / "a.aedat", strict=False)
    assert len(recording.read()) == 1
    assert recording.repairs == {"bytes of a torn record, cut off": 5}


def test_real_files(shared_samples):
    boxes = nvsdata.read(shared_samples / "davis240c_IMU_translBoxes.aedat")
    found = list(rows(boxes))
    assert len(found) == 162_771
    assert (found[0], found[-1]) == ((294976755, 83, 143, 0), (297049406, 6, 139, 0))
    digit = shared_samples / "mnist_0_scale04_0001.aedat"
    raw = digit.read_bytes()
    assert list(rows(nvsdata.read(digit))) == slow_dvs128(raw[216:])
