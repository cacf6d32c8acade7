import threading
import time

import pytest

from nvsdata.common.prefetch import DEPTH, prefetch


def makers(costs):
    """Names of the threads in which items are made that take so many seconds of the processor."""
    for cost in costs:
        end = time.thread_time() + cost
        while time.thread_time() < end:
            pass
        yield threading.current_thread().name


def test_items_are_made_in_a_thread_of_their_own():
    assert list(prefetch(makers([0] * 20))) == ["nvsdata-ahead"] * 20


def test_no_thread_is_made_for_items_that_take_no_time():
    here = threading.current_thread().name
    assert list(prefetch(makers([0.004, 0] * 12), worth=0.002)) == [here] * 24


def test_a_thread_takes_over_once_it_is_worth_it():
    here = threading.current_thread().name
    found = list(prefetch(makers([0] * 3 + [0.004] * 15), worth=0.002))
    assert found == [here] * (3 + DEPTH) + ["nvsdata-ahead"] * (15 - DEPTH)


@pytest.mark.parametrize("worth", [0, 10])
def test_an_error_comes_where_its_item_would(worth):
    def broken():
        yield from range(5)
        raise OSError("no more")

    found = []
    with pytest.raises(OSError, match="no more"):  # noqa: PT012  what came before counts
        for item in prefetch(broken(), worth):
            found.append(item)
    assert found == list(range(5))


@pytest.mark.parametrize("worth", [0, 10])
def test_leaving_early_closes_what_makes_the_items(worth):
    closed = []

    def endless():
        try:
            while True:
                yield 1
        finally:
            closed.append(True)

    before = threading.active_count()
    items = prefetch(endless(), worth)
    next(items)
    items.close()
    assert closed
    assert threading.active_count() == before
