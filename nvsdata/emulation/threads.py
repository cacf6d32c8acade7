"""Steps of a pipeline in threads: decoding, emulating and writing overlap, for each lets go of Python's lock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
DEPTH = 3  # items that are made before they are asked for


def ahead(items: Iterator[Item], depth: int = DEPTH) -> Iterator[Item]:
    """The same items, made up to `depth` ahead in a thread of their own; errors come where their item would."""
    end = object()
    with ThreadPoolExecutor(1, "nvsdata-ahead") as pool:
        waiting: deque[Future[Item | object]] = deque(pool.submit(next, items, end) for _ in range(depth))
        try:
            while (item := waiting.popleft().result()) is not end:
                waiting.append(pool.submit(next, items, end))
                yield item  # type: ignore[misc]
        finally:
            for future in waiting:
                future.cancel()
            pool.shutdown()
            if hasattr(items, "close"):
                items.close()
