"""Counts that all workers of a loader keep together."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
import torch


class Shared:
    """`count` numbers of a type, 0 at first, in memory that processes share which are forked or spawned later.

    Memory of the system's without a name: it takes no descriptor, of which each process has a thousand or so. Only what
    is sent to a spawned process moves to torch's, which has one.
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
