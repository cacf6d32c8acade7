"""Epochs of the samples of a dataset, for random numbers that depend on them."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch.utils.data import get_worker_info

from nvsdata.common.memory import SharedArray

PASSES = 64  # number of passes whose epochs are stored, for loaders that are read at the same time
MAIN = -1  # key of the main process; base seeds are not negative


class Epochs:
    """Epochs of the samples that a dataset returns, set by the user or counted; shared by all workers of a loader.

    Each pass over the data is an epoch. A worker recognizes a new pass by the base seed of the loader's iterator.
    Persistent workers keep that seed, and the main process has none. In both, an epoch begins with the first sample
    that is read a second time.

    Args:
        count: number of samples.
    """

    def __init__(self, count: int) -> None:
        # of each sample: 1 + the epoch in which it was last read
        self._given = SharedArray(count, np.int64)
        # 1 + the epoch that was set, 0 if none was; number of epochs begun; then base seed and epoch of the last passes
        self._state = SharedArray(2 + 2 * PASSES, np.int64)

    def set(self, epoch: int) -> None:
        """Use this epoch for all samples until the next call."""
        self._state.values[0] = epoch + 1

    def of(self, index: int) -> int:
        """Return the epoch of a sample that is about to be read."""
        if self._state.values[0]:
            return int(self._state.values[0]) - 1
        # read before the passes: workers that begin a pass at the same moment then write the same values
        begun = int(self._state.values[1])
        epoch = self._of_pass()
        if epoch < 0 or self._given.values[index] == epoch + 1:
            epoch = begun
            self._begin(epoch)
        self._given.values[index] = epoch + 1
        return epoch

    def state_dict(self) -> dict[str, Any]:
        """Return the epoch, whether it was set, and (without workers) bits of the samples of it that were read."""
        state: dict[str, Any] = {"samples": self._given.values.size, "set": bool(self._state.values[0]), "read": None}
        if state["set"]:
            return state | {"epoch": int(self._state.values[0]) - 1}
        begun = int(self._state.values[1])
        epoch = self._of_pass()
        if epoch >= 0 and get_worker_info() is None:
            # workers are left out, because they have read more samples than their loader has returned
            state["read"] = torch.from_numpy(np.packbits(self._given.values == epoch + 1))
        return state | {"epoch": epoch if epoch >= 0 else begun}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue the epoch of a state. ValueError if the state is of another number of samples."""
        given, epoch, read = self._given.values, state["epoch"], state["read"]
        if state["samples"] != given.size:
            raise ValueError(f"the state is of {state['samples']} samples, not of {given.size}")
        self._state.values[0] = epoch + 1 if state["set"] else 0
        if state["set"]:
            return
        given[given > epoch] = 0
        if read is not None:
            given[np.unpackbits(read.cpu().numpy(), count=given.size) > 0] = epoch + 1
        keys = self._state.values[2::2]
        keys[keys == _pass()] = 0
        if read is None and get_worker_info() is None:
            # of workers, which begin this epoch
            self._state.values[1] = epoch
        else:
            self._begin(epoch)

    def _of_pass(self) -> int:
        """Return the epoch of the pass in progress, -1 if there is none."""
        keys, epochs = self._state.values[2::2], self._state.values[3::2]
        return int(epochs[keys == _pass()].max(initial=-1))

    def _begin(self, epoch: int) -> None:
        """Store that the pass in progress is an epoch."""
        at = 2 + 2 * (epoch % PASSES)
        self._state.values[at : at + 2] = _pass(), epoch
        self._state.values[1] = epoch + 1


def _pass() -> int:
    """Return a number of the pass in progress: the base seed that its workers share."""
    worker = get_worker_info()
    return MAIN if worker is None else worker.seed - worker.id
