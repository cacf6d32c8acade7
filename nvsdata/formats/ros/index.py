"""Indexes of ROS bags by rosbags: the blocks of a file, and the time and place of each message."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from urllib.parse import quote

from nvsdata.formats.contents import MOST_HEADER

MOST_RECORD = 1 << 31  # bytes of a record of MCAP outside chunks
Row = tuple[int, int, int]


class BagBlock(NamedTuple):
    """A part of a file that is read at once: a chunk, a message of MCAP outside chunks, or a database.

    Args:
        file: Number of the file.
        at: Byte offset.
        packed: Bytes in the file.
        size: Bytes after decompression; None if unknown.
        checksum: CRC-32 of the decompressed bytes; 0 if unknown.
        compression: "", "none", "lz4", "bz2", "zstd" or "sqlite".
    """

    file: int
    at: int
    packed: int
    size: int | None
    checksum: int
    compression: str


class Index(NamedTuple):
    """The blocks of a file, and the messages of each connection: time in ns, number of the block, place in it."""

    blocks: list[BagBlock]
    messages: dict[int, list[Row]]


def readers() -> SimpleNamespace:
    """Return rosbags' readers, changed so that they only read indexes, and its parsers of definitions.

    ImportError if rosbags isn't installed.
    """
    from rosbags.rosbag1 import Reader as Ros1
    from rosbags.rosbag2 import reader as ros2
    from rosbags.rosbag2.errors import ReaderError
    from rosbags.rosbag2.storage_mcap import McapReader
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
    from rosbags.typesys import get_types_from_idl, get_types_from_msg
    from ruamel.yaml import YAML

    def existing(path: Path) -> Path:
        if not path.is_file():
            raise ReaderError(f"{path.name} isn't a file")
        return path

    class Mcap(McapReader):
        """An MCAP file with a summary. A pass over a file without one would inflate chunks of any size."""

        def __init__(self, path: Path) -> None:
            super().__init__(path)
            self.file = existing(path)

        def meta_scan(self) -> None:
            raise ReaderError("it has no summary: `mcap recover` writes a file with one")

    class Sqlite3(Sqlite3Reader):
        """A database, whose name may have characters that mean something in a URI."""

        def __init__(self, path: Path) -> None:
            super().__init__(Path(quote(str(path.absolute()))))
            self.file = existing(path)

    plugins: dict[str, Any] = {"mcap": Mcap, "sqlite3": Sqlite3}

    class BagFolder(ros2.DirectoryReader):
        """A folder, whose files must not be compressed as a whole: rosbags would inflate them to any size."""

        STORAGE_PLUGINS = plugins

        def open(self) -> None:
            metadata = existing(Path(str(self.path)) / "metadata.yaml")
            if metadata.stat().st_size > MOST_HEADER:
                raise ReaderError(f"its metadata.yaml has more than {MOST_HEADER} bytes")
            facts = YAML(typ="safe").load(metadata.read_text())["rosbag2_bagfile_information"]
            if str(facts.get("compression_mode", "")).lower() == "file":
                raise ReaderError("its files are compressed as a whole: `ros2 bag convert` writes a bag without that")
            super().open()

    class Ros2(ros2.Reader):
        STORAGE_PLUGINS = {"dir": BagFolder, ".mcap": Mcap, ".db3": Sqlite3}  # noqa: RUF012  as in the base class

    return SimpleNamespace(Ros1=Ros1, Ros2=Ros2, from_msg=get_types_from_msg, from_idl=get_types_from_idl)


def ros1_index(reader: Any) -> Index:
    """Return the index of an open bag of ROS 1."""
    from rosbags.rosbag1.reader import decompressors

    names = {function: name for name, function in decompressors.items()}
    numbers = {at: number for number, at in enumerate(reader.chunks)}
    chunks = reader.chunks.values()
    blocks = [BagBlock(0, one.datapos, one.datasize, None, 0, names[one.decompressor]) for one in chunks]
    messages = {
        connection: [(entry.time, numbers[entry.chunk_pos], entry.offset) for entry in entries]
        for connection, entries in reader.indexes.items()
    }
    return Index(blocks, messages)


def mcap_index(storage: Any, file: int, first: int) -> Index:
    """Return the index of an open MCAP file, the file number `file` of a bag. Its blocks are numbered from `first`."""
    index = Index([], {})
    if not storage.chunks:
        _walk(storage, index, file, first)
    for number, chunk in enumerate(storage.chunks, first):
        at = chunk.chunk_start_offset
        storage.bio.seek(at + 33)
        (checksum,) = struct.unpack("<I", storage.bio.read(4))
        begin = at + 49 + len(chunk.compression)
        index.blocks.append(
            BagBlock(file, begin, chunk.compressed_size, chunk.uncompressed_size, checksum, chunk.compression)
        )
        if chunk.message_end_time and not chunk.message_index_offsets:
            raise ValueError("a chunk without an index of its messages: `mcap recover` writes a file with one")
        for channel, place in chunk.message_index_offsets.items():
            index.messages.setdefault(channel, []).extend(_entries(storage, place, channel, number))
    return index


def _entries(storage: Any, at: int, channel: int, block: int) -> list[Row]:
    """Return the messages of a channel in a chunk, from the chunk's message index at byte `at`."""
    storage.bio.seek(at)
    kind, size, found, length = struct.unpack("<BQHI", storage.bio.read(15))
    if kind != 7 or found != channel or length % 16 or length + 6 > size:
        raise ValueError(f"no index of messages at byte {at}")
    data = storage.bio.read(length)
    if len(data) < length:
        raise ValueError(f"an index of {length} bytes, {len(data)} are there")
    return [(time, block, place) for time, place in struct.iter_unpack("<QQ", data)]


def _walk(storage: Any, index: Index, file: int, first: int) -> None:
    """Fill the index of an MCAP file without chunks: each message is a block."""
    at = storage.data_start
    while at < storage.data_end:
        storage.bio.seek(at)
        kind, size = struct.unpack("<BQ", storage.bio.read(9))
        if size > min(MOST_RECORD, storage.data_end - at - 9):
            raise ValueError(f"a record of {size} bytes at byte {at}")
        if kind == 6:
            raise ValueError("chunks that its summary doesn't list: `mcap recover` writes a file with an index")
        if kind == 5:
            channel, _, time = struct.unpack("<HIQ", storage.bio.read(14))
            index.messages.setdefault(channel, []).append((time, first + len(index.blocks), 0))
            index.blocks.append(BagBlock(file, at, size + 9, None, 0, ""))
        at += size + 9
