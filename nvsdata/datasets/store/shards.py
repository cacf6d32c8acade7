"""Shards: files that together have the recordings of a store, joined by an index file (`docs/dev/store.md`)."""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate, pairwise
from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.datasets.damage import OUT_OF
from nvsdata.datasets.store.file import LocalFile, StoreFile, filled
from nvsdata.datasets.store.index import BEGIN, Shard, index_place
from nvsdata.remote.file import RemoteFile
from nvsdata.remote.url import Url

MOST_OPEN = 512  # shards of a store that a process has open at a time; many systems allow 1,024 files


def shard_path(path: Path, shard: tuple[int, int] | None) -> Path:
    """Return the file of shard (i, n) of the store `path`, such as a-2-of-8.nvs of a.nvs; None returns `path`."""
    return path if shard is None else path.with_name("{}-{}-of-{}{}".format(path.stem, *shard, path.suffix))


def shard_places(path: Path | Url, shards: list[Shard]) -> list[Path] | list[Url]:
    """Return paths or URLs of the shards of an index file, in order."""
    if isinstance(path, Url):
        return [path.sibling(shard.file) for shard in shards]
    # absolute, because shards are opened later, when the current folder may be another one
    folder = path.absolute().parent
    if path.is_symlink() and not (folder / shards[0].file).exists():
        folder = path.resolve().parent
    return [folder / shard.file for shard in shards]


class Shards:
    """The records of a joined store, in files that are opened when they are first read.

    Args:
        path: path or URL of the index file. Shards are next to it or, if it is a link, next to its target.
        shards: the shards, in order.
    """

    def __init__(self, path: Path | Url, shards: list[Shard]) -> None:
        self._places = shard_places(path, shards)
        self._paths, self._heads = list(map(str, self._places)), [shard.head for shard in shards]
        # places of the shards' first records, as if all records were in one file
        self.begins = list(accumulate((shard.bytes for shard in shards), initial=BEGIN))
        self._open: dict[int, StoreFile] = {}

    def where(self, place: int) -> tuple[str, int]:
        """Return the path of the shard with a place of the joined store, and the place within it."""
        number = self._number(place)
        return self._paths[number], place - self.begins[number] + BEGIN

    def read(self, place: int, raw: np.ndarray) -> None:
        """Fill `raw` with the bytes from a place on. FormatError if the shard is missing, or another one."""
        if not raw.size:
            return  # the end of a shard's last record is the place of the next shard
        number = self._number(place)
        # a local reference: another thread may drop the file from `_open` meanwhile
        file = self._file(number)
        file.fill(place - self.begins[number] + BEGIN, raw)

    def drop(self, place: int, size: int) -> bool:
        """Forget bytes that are damaged; return whether reading them again may return others."""
        number = self._number(place)
        return self._file(number).drop(place - self.begins[number] + BEGIN, size)

    def blocks(self, places: np.ndarray, size: int) -> np.ndarray:
        """Return the number of the block of `size` bytes of each place, int64. Blocks of different files differ."""
        begins = np.array(self.begins)
        file = np.searchsorted(begins, places, "right") - 1
        before = np.cumsum((np.diff(begins) + BEGIN) // size + 1)
        numbers: np.ndarray = (places - begins[file] + BEGIN) // size + np.append(0, before)[file]
        return numbers

    def lost(self) -> dict[tuple[int, int], FormatError]:
        """Return the errors of shards that can't be read, by the places (begin, end) of their records."""
        errors = {}
        for number, places in enumerate(pairwise(self.begins)):
            try:
                self._file(number)
            except FormatError as error:
                errors[places] = error
        return errors

    def _number(self, place: int) -> int:
        return bisect_right(self.begins, place) - 1

    def _file(self, number: int) -> StoreFile:
        return self._open.get(number) or self._opened(number)

    def _opened(self, number: int) -> StoreFile:
        path = self._paths[number]
        try:
            file = self._store_file(number)
            fault = self._fault(file, self._heads[number])
        except FileNotFoundError:
            raise FormatError(path, "this shard of the store is missing: copy or pack it again") from None
        except OSError as error:
            if error.errno in OUT_OF:
                raise
            raise FormatError(path, f"this shard of the store can't be opened: {error.strerror}") from None
        if fault:
            file.close()
            raise FormatError(path, fault)
        # other threads may add and drop files at the same time
        file = self._open.setdefault(number, file)
        for old in list(self._open)[:-MOST_OPEN]:
            self._open.pop(old, None)
        return file

    def _fault(self, file: StoreFile, check: int) -> str:
        """Return why a file isn't the shard whose first bytes have this checksum; empty if it is."""
        head = np.empty(BEGIN, np.uint8)
        try:
            if filled(file, 0, head, check):
                # the end of a remote file isn't read
                index_place(head.tobytes(), file.size if isinstance(file, LocalFile) else None)
                return ""
        except FormatError:
            pass  # it is too short
        except ValueError as error:
            return str(error)
        return "isn't the shard that was joined, or is damaged: copy it again, or join again"

    def _store_file(self, number: int) -> StoreFile:
        place = self._places[number]
        if isinstance(place, Url):
            # the index of the shard, at the end of the file, isn't read
            size = self.begins[number + 1] - self.begins[number] + BEGIN
            return RemoteFile(place, size, self._heads[number].to_bytes(4, "little"))
        return LocalFile(place)

    def close(self) -> None:
        """Close all files."""
        while self._open:
            self._open.popitem()[1].close()
