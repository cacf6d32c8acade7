"""Work on many items by several processes."""

import multiprocessing
import time

import pytest

from nvsdata.batch.scheduler import as_done, in_order


def halved(number):
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number // 2


@pytest.mark.parametrize("processes", [1, 2])
def test_results_are_in_the_order_of_the_items_or_complete(processes):
    even = list(range(0, 60, 2))
    assert list(in_order(halved, even, processes)) == list(range(30))
    assert sorted(as_done(halved, even, processes)) == list(range(30))


def test_an_error_ends_no_process_of_the_caller():
    context = multiprocessing.get_context("spawn")
    other = context.Process(target=time.sleep, args=(60,))
    other.start()
    try:
        with pytest.raises(ValueError, match="3 is odd"):
            list(in_order(halved, [0, 3, 4], 2))
        assert other.is_alive()
    finally:
        other.kill()
        other.join()
