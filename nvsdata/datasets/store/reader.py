"""Packed stores, opened for reading. `docs/dev/store.md` describes the layout of their files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.data.events import EVER, Columns, Events, bounds_of, check_window
from nvsdata.data.recording import Recording
from nvsdata.datasets.source import Listing
from nvsdata.datasets.store import index
from nvsdata.datasets.store.record import BLOCK, HEAD, BlockError, Head, events_of, head_of
from nvsdata.formats.ondisk import read_into
from nvsdata.kernels.decode.blocks import blocks_between, crc32c

OTHER_TIMES = "its head has other times than its events: pack it again"
AT_ONCE = 1 << 16  # bytes of a recording that are read together with its head


def _head_size(raw: np.ndarray) -> int:
    """Return the bytes of head and table of a record, as its first bytes state them."""
    return HEAD.size + BLOCK.itemsize * int(HEAD.unpack_from(raw.data)[1])


class Store:
    """A packed store, opened for reading: a `Source` of recordings and side files.

    Each block of events is verified whenever it is read: FormatError if its checksum fails. Pickling is cheap: only the
    path is sent to workers, and each process opens the file itself.

    Args:
        path: the file.

    Attributes:
        dataset: `info.name` of the dataset.
        split: the split that was packed.
        fold: the fold that was packed.
        names: names of the recordings, by number.
        left_out: recordings that couldn't be packed, name to reason.

    Raises:
        FormatError: the file is not a store, is truncated, is of another version, or its index fails its checksum.
    """

    def __init__(self, path: Path) -> None:
        self.root, self.path = path, str(path)
        self._file = path.open("rb", buffering=0)
        self._handle = self._file.fileno()
        size = os.fstat(self._handle).st_size
        try:
            place, length, check = index.index_place(self._file.read(index.BEGIN), size)
            raw = self._bytes(place, length)
            if crc32c(raw) != check:
                raise ValueError("its index fails its checksum: pack it again")
            found = index.unpacked_index(raw.tobytes())
            if found["place"][-1] != place:
                raise ValueError("its index contradicts itself: pack it again")
        except ValueError as error:
            self._file.close()
            raise error if isinstance(error, FormatError) else FormatError(path, str(error)) from None
        self.dataset, self.split, self.fold = found["dataset"], found["split"], found["fold"]
        self.left_out = dict(zip(found["left_out"], found["reason"], strict=True))
        self.names, self._folders = found["name"], found["folder"]
        # a list, because reading a number from an array takes longer
        self._place, self._sizes = found["place"].tolist(), found["bytes"]
        self._checks = found["check"].tolist()
        self._number = {name: i for i, name in enumerate(self.names)}
        self._files = {name: i for i, name in enumerate(found["file_name"])}
        self._file_end, self._file_data = found["file_end"], found["file_data"]

    def __reduce__(self) -> tuple[type, tuple[Path]]:
        return type(self), (self.root,)

    def listing(self) -> Listing:
        """Return the packed folders and recordings, including those left out, and the side files."""
        found: Listing = {folder: [] for folder in self._folders}
        for name in (*self.names, *self.left_out, *self._files):
            folder, _, file = name.rpartition("/")
            found.setdefault(folder or ".", []).append(file)
        return {folder: sorted(found[folder]) for folder in sorted(found)}

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> StoredRecording:
        """Return a recording; FormatError if it was left out. `strict` has no effect: only intact files are packed."""
        if name in self.left_out:
            raise FormatError(self.root, f"{shown(name)} was left out when it was packed: {self.left_out[name]}")
        return StoredRecording(self, self._number[name], sensor_size)

    def data(self, name: str) -> bytes:
        """Return the bytes of a side file."""
        i = self._files[name]
        begin = self._file_end[i - 1] if i else 0
        return bytes(self._file_data[begin : self._file_end[i]])

    def size(self, name: str) -> int:
        """Return the size in bytes of the file that was packed."""
        if name in self._files:
            return len(self.data(name))
        return int(self._sizes[self._number[name]])

    def content(self, name: str) -> tuple[int, ...]:
        """Return the stamp, which doesn't depend on the name."""
        return self.stamp(name)

    def stamp(self, name: str) -> tuple[int, ...]:
        """Return the checksum of the recording's head and table of blocks, and the size of its record in bytes."""
        number = self._number[name]
        return self._checks[number], self._place[number + 1] - self._place[number]

    def settled(self, name: str, at: int) -> bool:
        """Return True, because a store doesn't change."""
        return True

    def head(self, number: int) -> tuple[Head, np.ndarray]:
        """Return the head of a recording, and the first bytes of its record. FormatError if it is damaged."""
        place = self._place[number]
        room = self._place[number + 1] - place
        raw = self._bytes(place, min(room, AT_ONCE))
        try:
            if raw.size < room and raw.size < (size := _head_size(raw)) <= room:
                raw = self._bytes(place, size)
            head = head_of(raw, room)
            if head.check != self._checks[number]:
                raise ValueError("a recording isn't that of the index: the store has changed since it was opened")
            return head, raw
        except ValueError as error:
            raise FormatError(f"{self.path}:{self.names[number]}", str(error), offset=place) from None

    def read(self, number: int, head: Head, raw: np.ndarray, start: int, stop: int) -> Columns:
        """Return a recording's events with start <= t < stop (µs). FormatError if they are damaged.

        `head` and `raw` are those of `head`.
        """
        first, last, begin, end, most = blocks_between(head.table, head.span[0], start, stop)
        place, begin, end = self._place[number], head.bytes + begin, head.bytes + end
        blocks = raw[begin:end] if end <= raw.size else self._bytes(place + begin, end - begin)
        try:
            columns = events_of(head, first, last, blocks, start, stop, most)
        except BlockError as error:
            raise error.in_file(f"{self.path}:{self.names[number]}", head, place) from None
        if start <= head.span[1] < stop and (not columns.t.size or columns.t[-1] != head.span[1]):
            raise FormatError(f"{self.path}:{self.names[number]}", OTHER_TIMES, offset=place)
        return columns

    def _bytes(self, place: int, size: int) -> np.ndarray:
        """Return bytes of the file. They are read and not memory-mapped, because a file may be cut meanwhile."""
        raw = np.empty(size, np.uint8)
        read_into(self._handle, self.path, place, raw)
        return raw

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def fault(self, name: str) -> str:
        """Return why the events of a recording can't be read; empty if they are intact."""
        number = self._number[name]
        try:
            head, raw = self.head(number)
            self.read(number, head, raw, *EVER)
        except FormatError as error:
            return error.reason
        return ""


class StoredRecording(Recording):
    """A recording in a store; if `sensor_size` is None, it has the size with which it was packed."""

    def __init__(self, store: Store, number: int, sensor_size: tuple[int, int] | None) -> None:
        self._store, self._number = store, number
        self._head, self._raw = store.head(number)
        self._size = self._head.size if sensor_size is None else sensor_size
        self.repairs = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._store, self._number, self._size)

    @property
    def path(self) -> str:  # type: ignore[override]
        """Path of the recording: the path of the store, a colon, and the recording's name."""
        return f"{self._store.path}:{self._store.names[self._number]}"

    @property
    def format(self) -> str:  # type: ignore[override]
        """Format of the file from which the recording was packed."""
        return self._head.format

    @property
    def sensor_size(self) -> tuple[int, int]:
        return self._size

    @property
    def span(self) -> tuple[int, int]:
        return self._head.span

    @property
    def start(self) -> int:
        begin = self._head.time[0]
        return self.span[0] if begin is None else begin

    @property
    def end(self) -> int:
        end = self._head.time[1]
        return self.span[1] if end is None else end

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        check_window(start, stop)
        first = EVER[0] if start is None else min(max(start, EVER[0]), EVER[1])
        last = EVER[1] if stop is None else min(max(stop, EVER[0]), EVER[1])
        columns = self._store.read(self._number, self._head, self._raw, first, last)
        width, height = self._size
        smaller = width < self._head.size[0] or height < self._head.size[1]
        if smaller and columns.x.size and (columns.x.max() >= width or columns.y.max() >= height):
            raise FormatError(self.path, f"coordinates outside the sensor of {width}x{height}")
        return Events.trusted(columns, self._size, *bounds_of(start, stop, *self._head.time))

    def frames(self, start: int | None = None, stop: int | None = None) -> NoReturn:
        raise FormatError(self.path, "a packed store contains only events, no frames")

    def inertial(self, start: int | None = None, stop: int | None = None) -> NoReturn:
        raise FormatError(self.path, "a packed store contains only events, no inertial samples")
