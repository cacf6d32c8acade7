"""Names of a store's records, which are decoded only when they are needed."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from typing import Any, Protocol, overload

import numpy as np

from nvsdata.kernels.decode.names import find_name, folders_of_names, name_table, sort_names

MOST_BYTES = 1 << 32  # of names, so that 4 bytes say where each ends
AT_ONCE = 1 << 16  # names that are decoded together


class Names(Sequence[str]):
    """Names by number, as texts of a store's index. They are kept as bytes, and found by a hash table.

    Args:
        raw: the names, uint8: UTF-8, each followed by a zero byte.

    Raises:
        ValueError: two names are equal, one isn't UTF-8, the last one has no end, or all together have more than 4 GiB.
    """

    def __init__(self, raw: np.ndarray) -> None:
        if raw.size and raw[-1]:
            raise ValueError("its index has a text without an end")
        if raw.size > MOST_BYTES:
            raise ValueError(f"its index has {raw.size} bytes of names")
        self._raw, self._ends = raw, np.flatnonzero(raw == 0).astype(np.uint32)
        slots = name_table(raw, self._ends)
        if slots is None:
            raise ValueError("its index contradicts itself: pack it again")
        self._slots = slots
        for _ in self._pieces():
            pass  # a name that isn't UTF-8 raises an error now, not when it is needed
        self._last = (0, "")

    def __len__(self) -> int:
        return int(self._ends.size)

    @overload
    def __getitem__(self, index: int) -> str: ...

    @overload
    def __getitem__(self, index: slice) -> list[str]: ...

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[number] for number in range(len(self))[index]]
        number = range(len(self))[index]
        begin = int(self._ends[number - 1]) + 1 if number else 0
        name = str(self._raw[begin : self._ends[number]].data, "utf-8", "surrogatepass")
        # a sample's name is usually looked up next
        self._last = number, name
        return name

    def __iter__(self) -> Iterator[str]:
        for piece in self._pieces():
            yield from piece.split("\0")

    def _pieces(self) -> Iterator[str]:
        begin = 0
        for last in range(AT_ONCE - 1, len(self) + AT_ONCE - 1, AT_ONCE):
            end = int(self._ends[min(last, len(self) - 1)])
            yield str(self._raw[begin:end].data, "utf-8", "surrogatepass")
            begin = end + 1

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and all(map(operator.eq, self, other))

    __hash__ = None  # type: ignore[assignment]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._find(name) >= 0

    def number(self, name: str) -> int:
        """Return the number of a name. KeyError if there is no such name."""
        number, last = self._last
        if last != name or not last:
            number = self._find(name)
        if number < 0:
            raise KeyError(name)
        return number

    def _find(self, name: str) -> int:
        return find_name(self._raw, self._ends, self._slots, name.encode("utf-8", "surrogatepass"))

    def folders(self) -> tuple[np.ndarray, list[str]]:
        """Return the number of each name's folder, uint32 [N], and the folders ("." for none)."""
        numbers, members = folders_of_names(self._raw, self._ends)
        return numbers, [self[member].rpartition("/")[0] or "." for member in members.tolist()]

    def sort(self, numbers: np.ndarray, *, by_file: bool) -> None:
        """Sort numbers of names, uint32, in place: by file name, then by folder; otherwise by path."""
        sort_names(self._raw, self._ends, numbers, by_file=by_file)


class NamedRecords(Protocol):
    """A store."""

    names: Names


class PackedRecordings:
    """The `Recordings` of a store. Pickling is cheap: only the store's path is sent to workers."""

    def __init__(self, store: NamedRecords) -> None:
        self._store = store
        folder, self.folders = store.names.folders()
        self.folder = folder.astype(np.min_scalar_type(len(self.folders)))

    def __reduce__(self) -> tuple[type, tuple[NamedRecords]]:
        return type(self), (self._store,)

    @property
    def names(self) -> Names:
        """Their paths below the root."""
        return self._store.names

    def sort(self, numbers: np.ndarray, *, by_file: bool) -> None:
        """Sort numbers of recordings, uint32, in place: by file name, then by folder; otherwise by path."""
        self.names.sort(numbers, by_file=by_file)
