"""Streams of messages of one type, and windows of them by the times in the messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.ros.containers import Bag, Topic
from nvsdata.kernels.decode.clock import BACK_US

Item = TypeVar("Item")


class TopicMessages(Generic[Item]):
    """The messages of a topic, decoded one by one.

    Times may fall by `BACK_US` at most. So a message whose times are later than a window by more, or earlier by more,
    shows that all messages after it, or before it, are outside the window. Times of the bag only order the messages:
    they may have another clock.

    Args:
        bag: The bag.
        topic: The topic.
        unpack: Decodes a message: its bytes, and whether they are CDR. It raises any error for damage.
        bounds: Returns the lowest and the highest time in µs of a decoded message; None if it has no times.
        strict: Whether damage raises a FormatError. Otherwise damaged messages are left out.

    Attributes:
        damaged: Number of messages that the last pass left out.
    """

    def __init__(
        self,
        bag: Bag,
        topic: Topic,
        unpack: Callable[[bytes | memoryview, bool], Item],
        bounds: Callable[[Item], tuple[int, int] | None],
        strict: bool,
    ) -> None:
        self.bag, self.topic, self.strict = bag, topic, strict
        self._unpack, self._bounds = unpack, bounds
        self._known: dict[int, tuple[int, int] | None] = {}
        self.damaged = 0

    def __len__(self) -> int:
        return len(self.topic.messages)

    def items(self, numbers: range | list[int] | None = None) -> Iterator[Item]:
        """Yield the decoded messages of these numbers (default: all)."""
        self.damaged = 0
        numbers = range(len(self)) if numbers is None else numbers
        rows = self.topic.messages[np.fromiter(numbers, np.int64)]
        for number, fetch in zip(numbers, self.bag.read(rows), strict=True):
            try:
                item = self._item(number, fetch)
            except FormatError:
                if self.strict:
                    raise
                self.damaged += 1
            else:
                yield item

    def _item(self, number: int, fetch: Callable[[], bytes | memoryview]) -> Item:
        with self._named(number):
            return self._unpack(fetch(), self.bag.cdr)

    @contextmanager
    def _named(self, number: int) -> Iterator[None]:
        """Turn any error of a block into a FormatError that names a message."""
        where = f"{self.topic.name}, message {number}"
        try:
            yield
        except FormatError as error:
            raise FormatError(self.bag.path, f"{where}: {error.reason}") from error
        except NotImplementedError as error:
            raise FormatError(self.bag.path, f"{where}: nvsdata doesn't read {error}") from error
        except Exception as error:  # struct, numpy and OpenCV raise errors of many kinds
            raise FormatError(self.bag.path, f"{where}: damaged: {error}") from error

    def bounds(self, number: int) -> tuple[int, int] | None:
        """Return the lowest and the highest time in µs of a message; None if it has no times."""
        self._learn([number])
        return self._known[number]

    def _learn(self, numbers: Iterable[int]) -> None:
        """Read the times of messages that aren't known yet, in one pass."""
        unknown = [number for number in numbers if number not in self._known]
        for number, fetch in zip(unknown, self.bag.read(self.topic.messages[unknown]), strict=True):
            item = self._item(number, fetch)
            with self._named(number):
                self._known[number] = self._bounds(item)

    def within(self, start: int, stop: int) -> list[int]:
        """Return the numbers of the messages that have times at or after `start` and before `stop` (µs).

        It reads these messages, those of 2 `BACK_US` around them, and some 2 log N of the N messages.
        """
        lo = self._first(lambda bounds: bounds[1] >= start - BACK_US, 0)
        hi = self._first(lambda bounds: bounds[0] >= stop + BACK_US, lo)
        self._learn(range(lo, hi))
        found = ((number, self._known[number]) for number in range(lo, hi))
        return [number for number, ends in found if ends is not None and ends[1] >= start and ends[0] < stop]

    def _first(self, reached: Callable[[tuple[int, int]], bool], lo: int) -> int:
        """Return, by bisection, a message from `lo` on that has `reached` a time, after one that hasn't."""
        hi = len(self)
        while lo < hi:
            at = middle = (lo + hi) // 2
            while at < hi and self.bounds(at) is None:
                at += 1
            if at == hi or reached(self.bounds(at) or (0, 0)):
                hi = middle
            else:
                lo = at + 1
        return hi


def nearest_topic(topics: list[Topic], name: str) -> Topic | None:
    """Return the topic that shares the most leading parts of its name with the topic `name`; the first if several do.

    None if there are no topics.
    """

    def shared(topic: Topic) -> int:
        count = 0
        for a, b in zip(topic.name.split("/"), name.split("/"), strict=False):
            if a != b:
                break
            count += 1
        return count

    return max(topics, key=shared, default=None)
