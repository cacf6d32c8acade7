"""Frames and inertial samples of AEDAT 2.0 word by word."""

import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.data.samples import Frame, Inertial, Piece
from nvsdata.formats import records
from nvsdata.formats.aedat.aedat2 import Aedat2Recording
from nvsdata.formats.aedat.aedat2_samples import Scales

HEAD = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End Of ASCII Header\r\n"
BESIDE, INERTIAL, AFTER = 1 << 31, 3 << 10, 1 << 10


def opened(tmp_path, words, head=HEAD):
    (tmp_path / "a.aedat").write_bytes(head + np.array(words, ">u4").tobytes())
    return nvsdata.open(tmp_path / "a.aedat")


def words_of(tmp_path, piece):
    """(address, time) of the records that a piece becomes."""
    nvsdata.write(piece, tmp_path / "b.aedat")
    body = (tmp_path / "b.aedat").read_bytes().partition(b"#End Of ASCII Header\r\n")[2]
    return [tuple(word) for word in np.frombuffer(body, ">u4").reshape(-1, 2).tolist()]


def slow_samples(words, g=8.0, degrees=1000.0):
    """Word by word: seven that follow each other among those of samples, numbered from 0, are one."""
    mine = [
        (word >> 28 & 7, word >> 12 & 0xFFFF, t) for word, t in words if word & BESIDE and word & INERTIAL == INERTIAL
    ]
    found = []
    for n in range(len(mine) - 6):
        seven = mine[n : n + 7]
        if [code for code, _, _ in seven] == [*range(7)]:
            signed = [value - (1 << 16) * (value >> 15) for _, value, _ in seven]
            acceleration = [value * g / 32768 for value in signed[:3]]
            rotation = [value * degrees / 32768 for value in signed[4:]]
            found.append((seven[0][2], acceleration, rotation, signed[3] / 340 + 35))
    return found


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("block", [1, 5, 64])
def test_samples_are_seven_words_whatever_lies_between(tmp_path, monkeypatch, seed, block):
    monkeypatch.setattr(Aedat2Recording, "block", block)
    monkeypatch.setattr(records, "PIECE", 8 * block)
    rng = np.random.default_rng(seed)
    words, code = [], seed % 7
    for t in range(300):
        kind = rng.integers(12)
        value = int(rng.integers(1 << 16)) << 12
        if kind == 0:
            words.append((int(rng.integers(180)) << 22 | int(rng.integers(240)) << 12, t))
        elif kind == 1:
            words.append((BESIDE | AFTER | value & 0xFFFFF, t))
        elif kind > 2 or rng.integers(3):
            words.append((BESIDE | INERTIAL | code << 28 | value, t))
            code = (code + 1) % 7
        else:
            code = int(rng.integers(8))
    found, expected = opened(tmp_path, words).inertial(), slow_samples(words)
    assert len(expected) > 5
    assert found.t.tolist() == [t for t, *_ in expected]
    for column, values in zip(found[1:], zip(*(rest for _, *rest in expected), strict=True), strict=True):
        assert column.dtype == np.float32
        assert column == pytest.approx(np.array(values, np.float32), rel=1e-6, abs=1e-5)


def one_sample(values):
    return [(BESIDE | INERTIAL | code << 28 | (value & 0xFFFF) << 12, 10 + code) for code, value in enumerate(values)]


@pytest.mark.parametrize(
    ("lines", "g", "degrees"),
    [
        ((), 8, 1000),
        (('#<entry key="ImuAccelScale" value="ImuAccelScaleG2"/>',), 2, 1000),
        (('#<entry key="ImuGyroScale" value="GyroFullScaleDegPerSec250"/>',), 8, 250),
        (('# a="b" key="ImuAccelScale" value="ImuAccelScaleG16"/>',), 16, 1000),
        (('#<entry key="ImuAccelScale" value="ImuAccelScaleG0"/>',), 8, 1000),
        (('#<entry key="ImuAccelScale" value="ImuAccelScaleG1"/>',), 1, 1000),
        (Scales(2.0, 2000.0).lines, 2, 2000),
    ],
)
def test_the_header_states_the_scales(tmp_path, lines, g, degrees):
    head = HEAD.replace(b"#End", "".join(f"{line}\r\n" for line in lines).encode() + b"#End")
    values = [32767, -32768, 1, -340, 2, -16384, 8192]
    found = opened(tmp_path, one_sample(values), head).inertial()
    assert found.t.tolist() == [10]
    assert found.acceleration[0] == pytest.approx(np.array(values[:3]) * g / 32768)
    assert found.temperature == pytest.approx([34.0])
    assert found.rotation[0] == pytest.approx(np.array(values[4:]) * degrees / 32768)


NOTHING = Events([0, 1_000], [0, 1], [0, 1], [1, 0], (240, 180))


def test_a_sample_becomes_seven_words(tmp_path):
    acceleration, rotation = [[1.0, -4.0, 4.0]], [[250.0, -600.0, 0.0077]]
    sample = Inertial(np.array([77]), *(np.array(v, np.float32) for v in (acceleration, rotation, [36.0])))
    words = words_of(tmp_path, Piece.of_camera(NOTHING, (), sample))
    assert [t for _, t in words] == [0, *[77] * 7, 1_000]
    assert words[1:8] == [(word, 77) for word, _ in one_sample([8192, -32768, 32767, 340, 16384, -32768, 1])]


def test_a_frame_becomes_two_words_a_pixel(tmp_path):
    pixels = np.array([[0, 64, 65_535], [640, 63, 1_280]], np.uint16)
    words = words_of(tmp_path, Piece.of_camera(NOTHING, (Frame(10, 20, 500, 900, 7, 3, pixels),)))
    assert len(words) == 2 + 2 * 6
    # column by column, from the top; before the exposure all readings are the largest, after it light takes from them
    places = [BESIDE | (179 - 3 - y) << 22 | (7 + x) << 12 for x in range(3) for y in range(2)]
    before = [(place | 1023, 10 if k == 0 else 20) for k, place in enumerate(places)]
    light = [int(pixels[y, x]) >> 6 for x in range(3) for y in range(2)]
    after = [(place | AFTER | 1023 - light[k], 900 if k == 5 else 500) for k, place in enumerate(places)]
    assert words[1:-1] == before + after
    (found,) = nvsdata.open(tmp_path / "b.aedat").frames()
    assert (found.start, found.exposure_start, found.exposure_end, found.end, found.x, found.y) == (
        10,
        20,
        500,
        900,
        7,
        3,
    )
    assert found.pixels.tolist() == (pixels >> 6 << 6).tolist()


def test_a_frame_that_began_before_what_is_written_begins_there(tmp_path):
    first = Piece.of_camera(NOTHING.window(0, 1), ())
    late = Piece.of_camera(NOTHING.window(1, None), (Frame(-9, -8, 500, 900, 0, 0, np.zeros((1, 2), np.uint16)),))
    nvsdata.write(iter([first, late]), tmp_path / "b.aedat")
    (found,) = nvsdata.open(tmp_path / "b.aedat").frames()
    assert (found.start, found.exposure_start, found.exposure_end, found.end) == (0, 0, 500, 900)


def picture(words, light, first, x=0):
    """Words of a whole frame of one row of pixels."""
    for k in range(len(light)):
        words.append((BESIDE | 179 << 22 | x + k << 12 | 1000, first + k))
    for k, reading in enumerate(light):
        words.append((BESIDE | 179 << 22 | x + k << 12 | AFTER | 1000 - reading, first + 50 + k))


@pytest.mark.parametrize(
    ("sizes", "kept"),
    [
        ((2,), (2,)),
        ((2, 3), (3,)),
        ((3, 3), (3, 3)),
        ((3, 2), (3, 2)),
        ((2, 3, 1), (3, 1)),
        ((1, 1, 3), (1, 1, 3)),
        ((), ()),
    ],
)
def test_a_first_frame_smaller_than_the_second_is_the_rest_of_one(tmp_path, sizes, kept):
    words = []
    for n, size in enumerate(sizes):
        picture(words, range(5, 5 + size), 100 * n)
    frames = list(opened(tmp_path, words).frames())
    assert [frame.pixels.size for frame in frames] == list(kept)
    for frame in frames:
        assert (frame.pixels.ravel() >> 6).tolist() == [*range(5, 5 + frame.pixels.size)]


def test_a_dvs128_has_neither(tmp_path):
    nvsdata.write(Events([1], [1], [1], [1], (128, 128)), tmp_path / "c.aedat")
    found = nvsdata.open(tmp_path / "c.aedat")
    assert (list(found.frames()), found.inertial().t.size) == ([], 0)
