"""Batches of several epochs that can begin at any step."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from operator import index
from typing import Generic, TypeVar

from torch.utils.data import Sampler

from nvsdata.common.validation import whole

AT_ONCE = 4_096  # samples whose order is computed at a time
K = TypeVar("K", bound=tuple[object, ...])


class ResumableBatches(Sampler[list[K]], Generic[K]):
    """A `batch_sampler` of the keys of several epochs, one epoch after the other.

    A batch depends on the arguments, its epoch and its step only, and is computed when it is needed. `SeededBatches`
    and `SequenceBatches` have these methods.

    Args:
        batch_size: Samples per batch, of all processes together.
        first: First epoch.
        last: The epoch after the last one.
        start: Number of steps of the first epoch to leave out.
        seed: Seed of the random orders.
        part: (rank, count) of this process among `count` processes that divide each batch, in order of rank.
    """

    def __init__(self, batch_size: int, first: int, last: int, start: int, seed: int, part: tuple[int, int]) -> None:
        self.batch_size, self.first, self.last, self.start, self.seed = map(
            index, (batch_size, first, last, start, seed)
        )
        self.rank, self.count = map(index, part)
        for name, least in (("batch_size", 1), ("first", 0), ("start", 0), ("rank", 0)):
            whole(name, getattr(self, name), least)
        if self.rank >= self.count:
            raise ValueError(f"part must be (rank, count) with rank < count, not {part}")
        self._next = self.first, self.start
        self._resumed: tuple[int, int] | None = None
        self._latest: object = None

    @property
    @abstractmethod
    def steps(self) -> int:
        """Steps per epoch of this process."""

    @abstractmethod
    def _batches(self, epoch: int, steps: range) -> list[list[K]]:
        """Return this process's keys of several steps."""

    def __len__(self) -> int:
        epoch, step = self._begin
        return max(self.steps * (self.last - epoch) - min(step, self.steps), 0)

    @property
    def _begin(self) -> tuple[int, int]:
        """Epoch and step at which the next iteration begins."""
        return self._resumed or (self.first, self.start)

    def set_epoch(self, epoch: int) -> None:
        """Iterate over this epoch only from now on, from its first step.

        Lightning calls it before each epoch, and needs it because its epochs are passes over the loader.
        """
        whole("epoch", epoch, 0)
        self.first, self.last, self.start, self._resumed = epoch, epoch + 1, 0, None

    @property
    def sampler(self) -> ResumableBatches[K]:
        """Itself: Lightning calls `set_epoch` of a batch sampler's sampler."""
        return self

    def state_dict(self) -> dict[str, int]:
        """Return epoch and step of the next batch of the latest iteration.

        torchdata's `StatefulDataLoader` calls it.
        """
        epoch, step = self._next
        return {"epoch": epoch, "step": step}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Begin the next iteration at the batch of a state. It reaches to the end of that epoch, or to `last`.

        Raises:
            ValueError: An epoch has fewer steps.
        """
        epoch, step = state["epoch"], state["step"]
        if not 0 <= step <= self.steps:
            raise ValueError(f"the state is of step {step}, and an epoch has {self.steps}: of another batch size?")
        self._resumed = self._next = epoch, step
        self.last = max(self.last, epoch + 1)

    def __iter__(self) -> Iterator[list[K]]:
        # not a generator: `set_epoch` must not move an iteration that has begun
        self._next, self._resumed, self._latest = self._begin, None, object()
        return self._iterated(*self._next, self.last, self._latest)

    def _iterated(self, first: int, start: int, last: int, iteration: object) -> Iterator[list[K]]:
        # the order of several steps is computed at a time, because each call takes 0.3 ms
        several = max(AT_ONCE // self.batch_size, 1)
        for epoch in range(first, last):
            for begin in range(start if epoch == first else 0, self.steps, several):
                steps = range(begin, min(begin + several, self.steps))
                for step, batch in zip(steps, self._batches(epoch, steps), strict=True):
                    if iteration is self._latest:
                        self._next = epoch, step + 1
                    yield batch

    def batch(self, epoch: int, step: int) -> list[K]:
        """Return this process's keys of a step. IndexError if an epoch has no such step."""
        if not 0 <= step < self.steps:
            raise IndexError(f"step {step} of an epoch of {self.steps} steps")
        return self._batches(index(epoch), range(step, step + 1))[0]

    def _check_start(self, steps: int) -> None:
        if self.start > steps:
            raise ValueError(f"start must be at most {steps}, the steps of an epoch, not {self.start}")

    def _check_parts(self) -> None:
        if self.batch_size % self.count:
            raise ValueError(f"{self.count} processes can't have equal parts of a batch of {self.batch_size}")
