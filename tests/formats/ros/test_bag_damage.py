"""Damaged, cut and hostile ROS bags raise a FormatError that names the file, and nothing else."""

import shutil
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbag_files import EPOCH, EVENTS, WAYS, Raw, content, some, types_of, write_bag

import nvsdata
from nvsdata import FormatError
from nvsdata.cli import main
from nvsdata.formats import contents
from nvsdata.formats.ros.chunks import INFLATE
from nvsdata.formats.ros.containers import Bag

pytest.importorskip("rosbags")
every_way = pytest.mark.parametrize("way", WAYS)
KINDS = [
    ("bag", None),
    ("bag", "bz2"),
    ("bag", "lz4"),
    ("mcap", None),
    ("mcap", "storage"),
    ("db3", None),
    ("db3", "message"),
]
every_kind = pytest.mark.parametrize(("way", "compression"), KINDS)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A bag of each kind."""
    folder = tmp_path_factory.mktemp("bags")
    made = {}
    for way, compression in KINDS:
        types = types_of(way)
        made[way, compression] = write_bag(folder, types, some(types), compression=compression, name=f"a{compression}")
    return made


def copied(path, folder):
    target = folder / path.name
    (shutil.copytree if path.is_dir() else shutil.copy)(path, target)
    return target


def read_all(path, strict):
    """The number of events of a bag of which everything is read; None if that raises a FormatError."""
    try:
        recording = nvsdata.open(path, strict=strict)
        recording.read(EPOCH + 5_000, EPOCH + 7_000)
        list(recording.frames()), recording.inertial(), recording.triggers()
        return len(recording.read())
    except FormatError as error:
        message = str(error)
    assert str(path) in message
    assert "\n" not in message
    return None


@every_kind
@pytest.mark.parametrize("part", [0.0, 0.001, 0.05, 0.3, 0.6, 0.9, 0.99, 0.9999])
def test_cut_bags(tmp_path, bags, way, compression, part):
    path = copied(bags[way, compression], tmp_path)
    data = content(path).read_bytes()
    content(path).write_bytes(data[: int(part * len(data))])
    assert read_all(path, strict=True) is None
    read_all(path, strict=False)


@every_kind
@settings(max_examples=40)
@given(
    places=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=3),
    strict=st.booleans(),
)
def test_altered_bytes_raise_a_format_error_or_none(tmp_path_factory, bags, way, compression, places, strict):
    path = copied(bags[way, compression], tmp_path_factory.mktemp("a"))
    data = bytearray(content(path).read_bytes())
    for place, value in places:
        data[int(place * len(data))] = value
    content(path).write_bytes(data)
    read_all(path, strict)


@settings(max_examples=30)
@given(place=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255))
def test_altered_metadata(tmp_path_factory, bags, place, value):
    path = copied(bags["db3", None], tmp_path_factory.mktemp("a"))
    data = bytearray((path / "metadata.yaml").read_bytes())
    data[int(place * len(data))] = value
    (path / "metadata.yaml").write_bytes(data)
    read_all(path, strict=True)


@every_way
@settings(max_examples=20)
@given(cut=st.integers(1, 400), places=st.lists(st.tuples(st.integers(0, 60), st.integers(0, 255)), max_size=3))
def test_altered_messages(tmp_path_factory, way, cut, places):
    types = types_of(way)
    messages = some(types, count=3, each=5)
    for k in (1, 3, 4):
        topic, time, message = messages[k]
        raw = bytearray(types.raw(message))
        for place, value in places:
            raw[place % len(raw)] = value
        messages[k] = topic, time, Raw(message.__msgtype__, raw[: max(len(raw) - cut, 0)] if k == 1 else raw)
    path = write_bag(tmp_path_factory.mktemp("a"), types, messages)
    read_all(path, strict=True)
    found = read_all(path, strict=False)
    assert found is None or found >= 5


@pytest.mark.parametrize(("way", "compression"), [("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage")])
def test_a_damaged_chunk(tmp_path, way, compression):
    """The other chunks are read if not `strict`."""
    types, rng = types_of(way), np.random.default_rng(1)
    words = rng.integers(0, 1 << 32, (40, 10_000)) & 0x3FF0000FFFFF | 5 << 48
    packets = [types.packet(np.sort(part).astype("<u8").tobytes(), (1024, 8), "mono") for part in words]
    path = write_bag(tmp_path, types, [("/e", k, packet) for k, packet in enumerate(packets)], compression=compression)
    data = bytearray(content(path).read_bytes())
    if way == "mcap":
        # rosbags states no checksums
        for block in Bag(str(path), b"")._blocks:
            chunk = INFLATE["zstd"](bytes(data[block.at : block.at + block.packed]), block.size + 1)
            struct.pack_into("<I", data, block.at - 20, zlib.crc32(chunk))
        content(path).write_bytes(data)
        assert len(nvsdata.read(path)) == 400_000
    middle = len(data) // 2
    data[middle : middle + 99] = bytes(99)
    content(path).write_bytes(data)
    with pytest.raises(FormatError, match=r"/e, message \d+: a damaged message in block \d: "):
        nvsdata.read(path)
    recording = nvsdata.open(path, strict=False)
    lost = 40 - len(recording.read()) // 10_000
    assert 0 < lost < 30
    assert recording.repairs["damaged messages of events, left out"] == lost


def test_a_large_metadata_file_with_a_hidden_compression(tmp_path):
    types = types_of("db3")
    path = write_bag(tmp_path, types, some(types), compression="file")
    metadata = path / "metadata.yaml"
    stated = metadata.read_text()
    assert "  compression_mode: file\n" in stated
    first, rest = stated.split("\n", 1)
    hidden = rest.replace("  compression_mode: file\n", '  "compression_mode" : "FI\\x4cE"\n')
    metadata.write_text(f"{first}\n#{' ' * 70_000}\n{hidden}")
    with pytest.raises(FormatError, match="its files are compressed as a whole"):
        nvsdata.open(path)
    metadata.write_text(stated + "#" * (1 << 22))
    with pytest.raises(FormatError, match=r"metadata.yaml has more than 4194304 bytes"):
        nvsdata.open(path)


@every_way
def test_a_message_that_states_more_than_it_has(tmp_path, way):
    types = types_of(way)
    messages = some(types, count=5)
    raw = types.raw(messages[2][2])
    messages[2] = "/dvs/events", 2, Raw(EVENTS[0], raw[:-40])
    path = write_bag(tmp_path, types, messages)
    with pytest.raises(FormatError, match=r"/dvs/events, message 2: damaged: states \d+ bytes of data, \d+ are there"):
        nvsdata.read(path)
    recording = nvsdata.open(path, strict=False)
    assert len(recording.read()) == 4 * 30
    assert recording.repairs == {"damaged messages of events, left out": 1}
    assert main(["convert", "--repair", str(path), str(tmp_path / "b.npy")]) == 0


@pytest.mark.parametrize(
    ("way", "compression"), [("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage"), ("db3", "message")]
)
def test_chunks_that_expand_too_far(tmp_path, monkeypatch, way, compression):
    types = types_of(way)
    message = types.packet(bytes(3_000_000), (4, 4), "evt3")
    path = write_bag(tmp_path, types, [("/e", 1, message)], compression=compression)
    assert len(nvsdata.read(path)) == 0
    monkeypatch.setattr(contents, "ALWAYS", 1 << 20)
    with pytest.raises(FormatError, match="too far"):
        nvsdata.read(path)


def test_a_folder_whose_files_are_compressed(tmp_path):
    types = types_of("db3")
    path = write_bag(tmp_path, types, some(types), compression="file")
    with pytest.raises(FormatError, match="its files are compressed as a whole: `ros2 bag convert`"):
        nvsdata.open(path)


def test_a_compressed_message_without_its_metadata(tmp_path, bags):
    with pytest.raises(FormatError, match=r"compressed: open the bag's folder"):
        nvsdata.open(content(bags["db3", "message"]))
