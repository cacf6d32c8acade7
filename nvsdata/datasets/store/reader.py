"""Packed stores, opened for reading. `docs/dev/store.md` describes the layout of their files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.data.events import EVER, Columns, Events, bounds_of, check_window
from nvsdata.data.recording import Recording
from nvsdata.datasets.source import Listing
from nvsdata.datasets.store.file import AGAIN
from nvsdata.datasets.store.index import Precomputing
from nvsdata.datasets.store.names import Names, PackedRecordings
from nvsdata.datasets.store.opened import opened_index
from nvsdata.datasets.store.record import BLOCK, HEAD, BlockError, Head, events_of, head_of
from nvsdata.datasets.store.sample import SAMPLE_HEAD, sample_of, used_bytes
from nvsdata.datasets.store.shards import Shards
from nvsdata.kernels.decode.blocks import blocks_between
from nvsdata.remote.url import Url

OTHER_TIMES = "its head has other times than its events: pack it again"
DAMAGED = "the store is damaged, pack the recording again"
AT_ONCE = 1 << 16  # bytes of a recording that are read together with its head


def _head_size(raw: np.ndarray) -> int:
    """Return the bytes of head and table of a record, as its first bytes state them."""
    return HEAD.size + BLOCK.itemsize * int(HEAD.unpack_from(raw.data)[1])


class Store:
    """A packed store, or the index file of joined shards, opened for reading: a `Source` of recordings and side files.

    Each block of events is verified whenever it is read: FormatError if its checksum fails. Pickling is cheap: only the
    path is sent to workers, and each process opens the file itself.

    Args:
        path: path or URL of the file.

    Attributes:
        dataset: `info.name` of the dataset.
        split: the split that was packed.
        fold: the fold that was packed.
        shard: if the store is a shard that belongs with others, (i, n) and a hash of the dataset's recordings.
        precomputed: if the store has precomputed samples in place of recordings, how they were made.
        samples: of such a store, the part of the recording, label and position of each sample.
        names: names of the recordings, or of samples, by number.
        left_out: recordings that couldn't be packed, name to reason.

    Raises:
        FormatError: the file is not a store, is truncated, is of another version, or its index fails its checksum.
        OSError: a remote file can't be read.
    """

    shard: tuple[int, int, str] | None = None
    precomputed: Precomputing | None = None
    names: Names
    _sizes: Sequence[int] | np.ndarray
    _file_data: bytes
    _shards: Shards | None = None

    def __init__(self, path: Path | Url) -> None:
        self.root, self.path = path, str(path)
        self._file, found = opened_index(path)
        self._shards = Shards(path, found["shards"]) if found["shards"] else None
        self.dataset, self.split, self.fold = found["dataset"], found["split"], found["fold"]
        self.shard, self.precomputed = found["shard"], found["precomputed"]
        self.samples = list(zip(found["part"], found["label"].tolist(), found["position"].tolist(), strict=True))
        self.left_out = dict(zip(found["left_out"], found["reason"], strict=True))
        self.names, self._folders = found["name"], found["folder"]
        self._begins = found["place"]
        # reading a number from an array takes longer
        self._place, self._sizes, self._checks = (memoryview(found[name]) for name in ("place", "bytes", "check"))
        self._files = {name: i for i, name in enumerate(found["file_name"])}
        self._file_end, self._file_data = found["file_end"], found["file_data"]

    def __reduce__(self) -> tuple[type, tuple[Path | Url]]:
        return type(self), (self.root,)

    def listing(self) -> Listing:
        """Return the packed folders and recordings, including those left out, and the side files."""
        found: Listing = {folder: [] for folder in self._folders}
        for name in (*self.names, *self.left_out, *self._files):
            folder, _, file = name.rpartition("/")
            found.setdefault(folder or ".", []).append(file)
        return {folder: sorted(found[folder]) for folder in sorted(found)}

    def recordings(self) -> PackedRecordings | None:
        """Return the recordings; None if some were left out, which the dataset's class must see, too."""
        return None if self.left_out else PackedRecordings(self)

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> StoredRecording:
        """Return a recording; FormatError if it was left out. `strict` has no effect: only intact files are packed."""
        if name in self.left_out:
            raise FormatError(self.path, f"{shown(name)} was left out when it was packed: {self.left_out[name]}")
        return StoredRecording(self, self.names.number(name), sensor_size)

    def data(self, name: str) -> bytes:
        """Return the bytes of a side file."""
        i = self._files[name]
        begin = self._file_end[i - 1] if i else 0
        return self._file_data[begin : self._file_end[i]]

    def size(self, name: str) -> int:
        """Return the size in bytes of the file that was packed."""
        if name in self._files:
            return len(self.data(name))
        return int(self._sizes[self.names.number(name)])

    def content(self, name: str) -> tuple[int, ...]:
        """Return the stamp, which doesn't depend on the name."""
        return self.stamp(name)

    def stamp(self, name: str) -> tuple[int, ...]:
        """Return the checksum of the recording's head and table of blocks, and the size of its record in bytes."""
        number = self.names.number(name)
        return self._checks[number], self._place[number + 1] - self._place[number]

    def settled(self, name: str, at: int) -> bool:
        """Return True, because a store doesn't change."""
        return True

    @property
    def holds_no_records(self) -> bool:
        """True for the index file of joined shards."""
        return self._shards is not None

    def extent(self, number: int) -> tuple[int, int]:
        """Return the first byte of a record, and its end; of joined shards, as if all records were in one file."""
        return self._place[number], self._place[number + 1]

    def head(self, number: int) -> tuple[Head, np.ndarray]:
        """Return the head of a recording, and the first bytes of its record. FormatError if it is damaged."""
        place = self._place[number]
        room = self._place[number + 1] - place
        for _ in range(AGAIN):
            try:
                return self._head(number, place, room)
            except FormatError:
                if not self._drop(place, room):
                    raise
        return self._head(number, place, room)

    def _head(self, number: int, place: int, room: int) -> tuple[Head, np.ndarray]:
        raw = self._bytes(place, min(room, AT_ONCE))
        try:
            if raw.size < room and raw.size < (size := _head_size(raw)) <= room:
                raw = self._bytes(place, size)
            head = head_of(raw, room)
            if head.check != self._checks[number]:
                raise ValueError("a recording isn't that of the index: the store has changed since it was opened")
            return head, raw
        except ValueError as error:
            raise self._error(number, str(error)) from None

    def read(self, number: int, head: Head, raw: np.ndarray, start: int, stop: int) -> Columns:
        """Return a recording's events with start <= t < stop (µs). FormatError if they are damaged.

        `head` and `raw` are those of `head`.
        """
        first, last, begin, end, most = blocks_between(head.table, head.span[0], start, stop)
        place, begin, end = self._place[number], head.bytes + begin, head.bytes + end
        blocks = raw[begin:end] if end <= raw.size else self._bytes(place + begin, end - begin)
        for left in range(AGAIN, -1, -1):
            try:
                columns = events_of(head, first, last, blocks, start, stop, most)
                break
            except BlockError as error:
                if not (left and self._drop(place + begin, end - begin)):
                    raise self._error(number, f"{error}: {DAMAGED}", error.at(head)) from None
                blocks = self._bytes(place + begin, end - begin)
        if start <= head.span[1] < stop and (not columns.t.size or columns.t[-1] != head.span[1]):
            raise self._error(number, OTHER_TIMES)
        return columns

    def sample(self, name: str) -> Any:
        """Return a precomputed sample. FormatError if its record is damaged."""
        number = self.names.number(name)
        place, end = self.extent(number)
        for _ in range(AGAIN):
            try:
                return self._sample(number, place, end)
            except FormatError:
                if not self._drop(place, end - place):
                    raise
        return self._sample(number, place, end)

    def _sample(self, number: int, place: int, end: int) -> Any:
        try:
            return sample_of(self._bytes(place, end - place), self._checks[number])
        except ValueError as error:
            raise error if isinstance(error, FormatError) else self._error(number, str(error)) from None

    def _error(self, number: int, reason: str, at: int = 0) -> FormatError:
        """Return the error of a recording whose record has a fault `at` bytes from its beginning."""
        path, place = self.path, self._place[number]
        if self._shards is not None:
            path, place = self._shards.where(place)
        return FormatError(f"{path}:{self.names[number]}", reason, offset=place + at)

    def _bytes(self, place: int, size: int) -> np.ndarray:
        """Return bytes of the store. They are read and not memory-mapped, because a file may be cut meanwhile."""
        raw = np.empty(size, np.uint8)
        if self._file.closed:
            raise ValueError("I/O operation on closed file")
        if self._shards is None:
            self._file.fill(place, raw)
        else:
            self._shards.read(place, raw)
        return raw

    def blocks(self, names: Sequence[str], size: int) -> np.ndarray | None:
        """Return the number of the block of `size` bytes in which the record of each name begins, int64."""
        places = self._begins[[self.names.number(name) for name in names]]
        return places // size if self._shards is None else self._shards.blocks(places, size)

    def _drop(self, place: int, size: int) -> bool:
        """Forget bytes that are damaged; return whether reading them again may return others."""
        return self._file.drop(place, size) if self._shards is None else self._shards.drop(place, size)

    def close(self) -> None:
        """Close the file, and those of shards; a read after that raises ValueError."""
        self._file.close()
        if self._shards is not None:
            self._shards.close()

    def fault(self, name: str) -> str:
        """Return why the events of a recording, or a sample, can't be read; empty if they are intact."""
        number = self.names.number(name)
        place, end = self.extent(number)
        try:
            if self.precomputed is not None:
                self.sample(name)
                used = used_bytes(self._bytes(place, SAMPLE_HEAD))
            else:
                head, raw = self.head(number)
                self.read(number, head, raw, *EVER)
                used = head.bytes + int(head.blocks["bytes"].sum())
            rest = self._bytes(place + used, end - place - used)
        except FormatError as error:
            return error.reason
        # no checksum has the bytes that fill a record up, and reading skips them
        return "the bytes that fill its record up aren't zero" if rest.any() else ""

    def lost(self) -> dict[str, tuple[str, set[str]]]:
        """Return the shards that can't be read: path to reason and names of the recordings."""
        if self._shards is None:
            return {}
        # every shard begins with a record
        return {
            error.path: (error.reason, {*self.names[slice(*np.searchsorted(self._begins, places))]})
            for places, error in self._shards.lost().items()
        }


class StoredRecording(Recording):
    """A recording in a store; if `sensor_size` is None, it has the size with which it was packed."""

    def __init__(self, store: Store, number: int, sensor_size: tuple[int, int] | None) -> None:
        self._store, self._number = store, number
        self._head, self._raw = store.head(number)
        self._size = self._head.size if sensor_size is None else sensor_size
        self._guessed = self._head.guessed and sensor_size is None
        self.repairs = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._store, self._number, None if self._guessed else self._size)

    @property
    def size_is_guessed(self) -> bool:
        """True if neither the packed file nor the caller states `sensor_size`."""
        return self._guessed

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
