"""Names in a packed store's index: bytes, each followed by a zero byte.

In all functions, `raw` uint8 has the names, and `ends` uint32 [N] the places of their zero bytes.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def name_table(raw: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Return a hash table for `find_name`, uint32; None if two names are equal. O(bytes)."""
    slots = np.empty(1 << (2 * ends.size).bit_length(), np.uint32)
    return slots if _native.enter_names(raw, ends, slots) else None


def find_name(raw: np.ndarray, ends: np.ndarray, slots: np.ndarray, name: bytes) -> int:
    """Return the number of a name, of which `slots` is the table; -1 if there is no such name. O(1)."""
    number: int = _native.find_name(raw, ends, slots, np.frombuffer(name, np.uint8))
    return number


def folders_of_names(raw: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the folder of each name, uint32 [N], and the number of a name in each folder, int64 [F]. O(bytes).

    The folder of a name is what precedes its last slash. Folders are numbered in the order of their first names.
    """
    folders = np.empty(ends.size, np.uint32)
    count = _native.folders_of_names(raw, ends, folders)
    return folders, np.searchsorted(np.maximum.accumulate(folders), np.arange(count, dtype=np.uint32))


def sort_names(raw: np.ndarray, ends: np.ndarray, numbers: np.ndarray, *, by_file: bool) -> None:
    """Sort numbers of names, uint32 [M], in place: by file name, then by folder; otherwise by the whole name."""
    _native.sort_names(raw, ends, by_file, numbers)
