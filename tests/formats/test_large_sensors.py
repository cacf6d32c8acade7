"""Sensors of 346x260 and 1280x720 in every format: read and written whole, or refused."""

import struct
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from lookalikes import aedat4_bytes, evt2_bytes, evt3_bytes, matlab_bytes, rows
from rosbag_files import content, types_of, write_bag
from wide import LARGE, corners

import nvsdata
from nvsdata import FormatError
from nvsdata.formats import FORMATS
from nvsdata.recording.davis.file import header
from nvsdata.recording.davis.stream import DavisDecoder


def davis_bytes(ev):
    """The words of a camera, each event with its time and row: the sensor's size is in the first line."""
    words = [0x0001]
    for t, x, y, p in rows(ev):
        words += [0x8000 | t, 0x1000 | y, (0x3000 if p else 0x2000) | x]
    decoder = DavisDecoder(*ev.sensor_size, swap=False, steady=True)
    return header(decoder, None, {}) + struct.pack(f"<{len(words)}H", *words)


def bag_bytes(way):
    """A function that makes the file of a bag."""

    def made(ev):
        pytest.importorskip("rosbags")
        types = types_of(way)
        message = types.events(ev.t, ev.x, ev.y, ev.p, ev.sensor_size)
        with TemporaryDirectory() as folder:
            return content(write_bag(Path(folder), types, [("/dvs/events", 0, message)])).read_bytes()

    return made


def npz_bytes(ev):
    file = BytesIO()
    np.savez(file, **ev.columns._asdict())
    return file.getvalue()


# sensors that files of a format can't hold; the largest that it does hold is in its description
TOO_LARGE = {"atis": LARGE, "aedat1": LARGE, "aedat2": ((1280, 720),)}
# formats that are only read, as others write them
MADE = {
    "davis": [davis_bytes],
    "aedat4": [lambda ev: aedat4_bytes(ev, size=ev.sensor_size)],
    "evt2": [
        lambda ev: evt2_bytes(ev, b"%% evt 2.0\n%% geometry %dx%d\n%% end\n" % ev.sensor_size),
        evt2_bytes,
    ],
    "evt3": [lambda ev: evt3_bytes(ev, b"%% evt 3.0\n%% geometry %dx%d\n%% end\n" % ev.sensor_size)],
    "matlab": [matlab_bytes],
    "npz": [npz_bytes],
    "rosbag": [bag_bytes("bag")],
    "rosbag2": [bag_bytes("mcap")],
}
large = pytest.mark.parametrize("size", LARGE, ids=lambda size: "{}x{}".format(*size))
every_format = pytest.mark.parametrize("name", sorted(FORMATS))


def written_by(name, folder):
    """A path for each extension with which files of a format are written."""
    paths = [folder / f"a{suffix}" for suffix in FORMATS[name].suffixes]
    # an extension that belongs to another format needs the name
    ours = [path for path in paths if path.suffix == ".raw" or nvsdata.formats.writer_of(path).name == name]
    return paths if name == "hdf5-gzip" else ours


@every_format
@large
def test_what_is_written_is_read_or_refused(tmp_path, name, size):
    ev = corners(size)
    if FORMATS[name].write is None:
        assert MADE[name]
        return
    for path in written_by(name, tmp_path):
        if size in TOO_LARGE.get(name, ()):
            with pytest.raises(ValueError, match=r"up to (\d+x\d+|x|255)|supports x up to 255 and y up to 239"):
                nvsdata.write(ev, path, format=name)
            assert not path.exists()
            continue
        nvsdata.write(ev, path, format=name)
        assert nvsdata.open(path).format == name.removesuffix("-gzip")
        check(path, ev)
    assert list(tmp_path.iterdir()) or size in TOO_LARGE[name]


@pytest.mark.parametrize("name", sorted(MADE))
@large
def test_what_others_write_is_read(tmp_path, name, size):
    ev = corners(size)
    for number, made in enumerate(MADE[name]):
        path = tmp_path / f"{number}{FORMATS[name].suffixes[0]}"
        path.write_bytes(made(ev))
        check(path, ev)


def check(path, ev):
    recording = nvsdata.open(path, sensor_size=ev.sensor_size)
    assert recording.read() == ev
    middle = int(ev.t[len(ev) // 2])
    assert recording.read(middle, middle + 500) == ev.window(middle, middle + 500)
    # a file that doesn't state its sensor is as large as its events need, and they reach into the last corner
    assert nvsdata.open(path).sensor_size == ev.sensor_size
    assert nvsdata.read(path) == ev
    width, height = ev.sensor_size
    with pytest.raises(FormatError, match="outside the sensor"):
        nvsdata.read(path, sensor_size=(width - 1, height))
    with pytest.raises(FormatError, match="outside the sensor"):
        nvsdata.read(path, sensor_size=(width, height - 1))
    repaired = nvsdata.open(path, sensor_size=(width, height - 1), strict=False).read()
    assert len(repaired) == np.count_nonzero(ev.y < height - 1)


@large
def test_a_file_of_each_format_becomes_every_other(tmp_path, size):
    ev = corners(size)
    kept = [path for name in FORMATS for path in (tmp_path / f"{name}{s}" for s in FORMATS[name].suffixes[:1])]
    kept = [p for p in kept if FORMATS[p.stem].write and size not in TOO_LARGE.get(p.stem, ())]
    for before, after in zip([None, *kept], kept, strict=False):
        nvsdata.write(ev if before is None else nvsdata.open(before, sensor_size=size), after, format=after.stem)
        assert nvsdata.read(after, sensor_size=size) == ev
