"""Counts shared by all workers of a loader."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
import torch


class Shared:
    """`count` numbers of a type, 0 at first, in memory shared with processes that are forked or spawned later.

    The memory is an anonymous mapping, which needs no file descriptor (a process may have about a thousand). Only
    when it is sent to a spawned process does it move to torch's shared memory, which needs one.
    """

    def __init__(self, count: int, kind: Any) -> None:
        room = mmap.mmap(-1, max(count * np.dtype(kind).itemsize, 1))
        self.values: np.ndarray = np.frombuffer(room, kind, count)
        self._sent: torch.Tensor | None = None

    def __getstate__(self) -> torch.Tensor:
        if self._sent is None:
            self._sent = torch.from_numpy(self.values.copy()).share_memory_()  # type: ignore[no-untyped-call]
            self.values = self._sent.numpy()
        return self._sent

    def __setstate__(self, sent: torch.Tensor) -> None:
        self._sent, self.values = sent, sent.numpy()
