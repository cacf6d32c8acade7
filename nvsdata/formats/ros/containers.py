"""`Bag`: the topics of a ROS bag, and the reading of its messages.

rosbags parses indexes and definitions. Messages are read here, because chunks may expand only as far as the compressed
parts of other formats, and because a window reads only some messages of a topic. No file stays open.
"""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.contents import Allowance
from nvsdata.formats.ondisk import OnDisk
from nvsdata.formats.ros.chunks import INFLATE, Data, mcap_data, ros1_data
from nvsdata.formats.ros.index import BagBlock, Index, mcap_index, readers, ros1_index

CHUNKS = 4  # inflated chunks that are kept while messages are read: those of a topic may be interleaved


class Topic(NamedTuple):
    """A topic of a bag.

    Args:
        name: Its name.
        kind: Type of its messages, such as "sensor_msgs/msg/Imu".
        definition: Format and text of the definition of that type, as rosbags names them; no text if the bag has none.
        messages: int64 [N, 3], in the order of the bag's times: time in ns, number of the block, place in it.
    """

    name: str
    kind: str
    definition: tuple[str, str]
    messages: np.ndarray


class Bag:
    """The messages of a bag.

    Args:
        path: A `.bag`, `.mcap` or `.db3` file, or a folder with `metadata.yaml`.
        head: First bytes of the file, or of the folder's `metadata.yaml`.

    Raises:
        ImportError: rosbags isn't installed.
        FormatError: The bag is damaged, cut off, or compressed as entire files.
    """

    def __init__(self, path: str, head: bytes) -> None:
        self.path = path
        self.cdr = not head.startswith(b"#ROSBAG")
        with packaged(path):
            self._rosbags = readers()
        self._files: list[OnDisk] = []
        self._blocks: list[BagBlock] = []
        self._squeezed = False  # whether each message is compressed
        hint = "mcap recover, or ros2 bag reindex," if self.cdr else "rosbag reindex"
        with _readable(path, f"damaged or cut off ({hint} may restore it)"):
            found = self._of_ros2() if self.cdr else self._of_ros1()
            self.topics = [self._topic(name, parts) for name, parts in sorted(found.items())]

    def _of_ros1(self) -> dict[str, list[tuple[Any, np.ndarray]]]:
        self._files.append(OnDisk(self.path))
        with self._rosbags.Ros1(self.path) as reader:
            index = ros1_index(reader)
            self._blocks = index.blocks
            return _by_topic(reader.connections, index)

    def _of_ros2(self) -> dict[str, list[tuple[Any, np.ndarray]]]:
        found: dict[str, list[tuple[Any, np.ndarray]]] = {}
        with self._rosbags.Ros2(Path(self.path)) as reader:
            storages = getattr(reader.storage, "storages", [reader.storage])
            self._squeezed = reader.storage.metadata.compression_mode == "message"
            for storage in storages:
                number = len(self._files)
                self._files.append(OnDisk(str(storage.file)))
                is_mcap = hasattr(storage, "chunks")
                index = mcap_index(storage, number, len(self._blocks)) if is_mcap else self._sqlite_index(storage)
                self._blocks += index.blocks
                for name, parts in _by_topic(storage.connections, index).items():
                    found.setdefault(name, []).extend(parts)
        return found

    def _sqlite_index(self, storage: Any) -> Index:
        """Return the index of a database: one block, in which the places of messages are their numbers."""
        block, query = len(self._blocks), "SELECT timestamp, id FROM messages WHERE topic_id = ?"
        _check_pages(storage.file)
        with _database(storage.file) as database:
            rows = {one.id: database.execute(query, (one.id,)).fetchall() for one in storage.connections}
        messages = {topic: [(time, block, number) for time, number in found] for topic, found in rows.items()}
        return Index([BagBlock(len(self._files) - 1, 0, 0, None, 0, "sqlite")], messages)

    def _topic(self, name: str, parts: list[tuple[Any, np.ndarray]]) -> Topic:
        kinds = {connection.msgtype for connection, _ in parts}
        if len(kinds) > 1:
            raise ValueError(f"messages of several types on {name}: {', '.join(sorted(kinds))}")
        stated = next((c.msgdef for c, _ in parts if c.msgdef.data), parts[0][0].msgdef)
        messages = np.concatenate([rows for _, rows in parts])
        order = np.lexsort((messages[:, 2], messages[:, 1], messages[:, 0]))
        return Topic(name, kinds.pop(), (stated.format.name, stated.data), messages[order])

    def check_definition(self, topic: Topic, known: str) -> None:
        """Raise FormatError if the bag states another definition of a topic's messages than `known`."""
        if not topic.definition[1]:
            return
        with _readable(self.path, f"{topic.name} has a damaged definition of {topic.kind}"):
            stated = self._stated_types(topic)
            for name, (_, fields) in self._rosbags.from_msg(known, topic.kind).items():
                if name in stated and list(map(tuple, stated[name][1])) != list(map(tuple, fields)):
                    raise FormatError(self.path, f"{topic.name}: its definition of {name} isn't the public one")

    def _stated_types(self, topic: Topic) -> dict[str, Any]:
        form, text = topic.definition
        if form != "IDL":
            return dict(self._rosbags.from_msg(text, topic.kind))
        # several definitions are separated by a line, before a line with the name of each
        parts = (part.partition("\n")[2] if part.startswith("IDL: ") else part for part in text.split("=" * 80 + "\n"))
        return {name: found for part in parts if part.strip() for name, found in self._rosbags.from_idl(part).items()}

    def read(self, messages: np.ndarray) -> Iterator[Callable[[], Data]]:
        """Yield a function for each of some messages, rows of `Topic.messages`, that returns its bytes.

        The function is to be called before the next one is yielded. It raises FormatError for damage.
        """
        reading = _Reading(self)
        try:
            for _, block, place in messages.tolist():
                yield partial(reading.message, block, place)
        finally:
            reading.close()


class _Reading:
    """The open files and inflated chunks of one pass over messages of a bag."""

    def __init__(self, bag: Bag) -> None:
        self._bag, self._chunks = bag, dict[int, Data]()
        self._databases: dict[int, Any] = {}
        self._left = Allowance(sum(file.size for file in bag._files))

    def close(self) -> None:
        for database in self._databases.values():
            database.close()

    def message(self, number: int, place: int) -> Data:
        """Return the bytes of the message at a place of a block."""
        block = self._bag._blocks[number]
        with _readable(self._bag.path, f"a damaged message in block {number}"):
            if block.compression == "sqlite":
                data: Data = self._row(block.file, place)
            else:
                chunk = self._chunk(number, block)
                data = mcap_data(chunk, place) if self._bag.cdr else ros1_data(chunk, place)
            return self._inflated(data, "zstd", None) if self._bag._squeezed else data

    def _row(self, file: int, number: int) -> bytes:
        if file not in self._databases:
            self._bag._files[file].check()
            self._databases[file] = _connected(self._bag._files[file].path)
        row = self._databases[file].execute("SELECT data FROM messages WHERE id = ?", (number,)).fetchone()
        if row is None or not isinstance(row[0], bytes):
            raise ValueError(f"no data in row {number}")
        return row[0]

    def _chunk(self, number: int, block: BagBlock) -> Data:
        if number not in self._chunks:
            packed = np.empty(block.packed, np.uint8)
            if block.at + block.packed > self._bag._files[block.file].size:
                raise ValueError(f"cut off: a chunk ends at byte {block.at + block.packed}")
            with self._bag._files[block.file].opened() as file:
                file.fill(block.at, packed)
            chunk = self._inflated(packed.data, block.compression, block.size)
            if block.checksum and zlib.crc32(chunk) != block.checksum:
                raise ValueError("its checksum is wrong")
            while len(self._chunks) >= CHUNKS:
                self._chunks.pop(next(iter(self._chunks)))
            self._chunks[number] = memoryview(chunk)
        return self._chunks[number]

    def _inflated(self, packed: Data, compression: str, size: int | None) -> Data:
        """Return the decompressed bytes. ValueError unless they are `size` bytes and at most what the file may have."""
        if compression in ("", "none"):
            return packed
        if compression not in INFLATE:
            raise ValueError(f"unknown compression {compression[:40]!r}")
        most = self._left.of(len(packed))
        if size is not None and size > most:
            raise ValueError(f"expands to {size} bytes, too far: {self._left.reason}")
        inflated = INFLATE[compression](packed, most + 1)
        self._left.take(len(inflated))
        if size is not None and len(inflated) != size:
            raise ValueError(f"expands to {len(inflated)} bytes in place of {size}")
        return inflated


def _by_topic(connections: Sequence[Any], index: Index) -> dict[str, list[tuple[Any, np.ndarray]]]:
    found: dict[str, list[tuple[Any, np.ndarray]]] = {}
    for one in connections:
        rows = np.array(index.messages.get(one.id, ()), np.int64).reshape(-1, 3)
        found.setdefault(one.topic, []).append((one, rows))
    return found


def _check_pages(path: Path) -> None:
    """Raise ValueError if a database states more pages than its file has: SQLite reads the others without an error."""
    with path.open("rb") as file:
        head = file.read(32)
    size, pages = struct.unpack_from(">H", head, 16)[0], struct.unpack_from(">I", head, 28)[0]
    if pages * (size if size > 1 else 1 << 16) > path.stat().st_size:
        raise ValueError(f"cut off: {pages} pages of {size} bytes in {path.stat().st_size}")


def _connected(path: str | Path) -> Any:
    where = quote(str(Path(path).absolute()))
    return sqlite3.connect(f"file:{where}?mode=ro&immutable=1", uri=True)


@contextmanager
def _database(path: str | Path) -> Iterator[Any]:
    database = _connected(path)
    try:
        yield database
    finally:
        database.close()


@contextmanager
def packaged(path: str) -> Iterator[None]:
    """Turn the ImportError of a block into one that says how to install rosbags."""
    try:
        yield
    except ImportError as error:
        reason = f"{path}: ROS bags need the package rosbags: pip install 'nvsdata[ros]'"
        raise ImportError(reason) from error


@contextmanager
def _readable(path: str, what: str) -> Iterator[None]:
    """Turn any error of a block into a FormatError: rosbags and decompressors raise errors of many kinds for damage."""
    try:
        yield
    except (FormatError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:
        reason = str(error) if str(error) else type(error).__name__
        raise FormatError(path, f"{what}: {reason}") from error
