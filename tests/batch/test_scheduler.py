"""Work on many items by several processes, and by a cluster."""

import multiprocessing
import os
import signal
import threading
import time
from functools import partial

import pytest

from nvsdata.batch.scheduler import AHEAD, as_done, in_order, in_shard


def halved(number):
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number // 2


def halved_unless_first(number, *, folder):
    """As `halved`, but the process is killed the first time that a number divisible by 10 comes."""
    mark = folder / str(number)
    if number % 10 == 0 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return halved(number)


def failing(number, *, folder):
    with (folder / "calls").open("a") as file:
        file.write("x")
    raise TypeError("impossible")


def killed(number):
    os._exit(9)


def killed_by_last(number):
    return killed(number) if number == 1 else number


def large(number):
    return bytes(10_000_000 + number)


def large_unless_killed(number, *, folder):
    """As `large`, but the process is killed while it sends the result, the first time that every third number comes."""
    mark = folder / str(number)
    if number % 3 == 0 and not mark.exists():
        mark.touch()
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGKILL)).start()
        return bytes(10**9)
    return large(number)


def unsendable(number):
    return lambda: number


class Opened:
    """A function that counts how often it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __setstate__(self, state):
        self.__dict__ = state
        with self.path.open("a") as file:
            file.write("x")

    __module__ = "test_scheduler"

    def __call__(self, number):
        return number


@pytest.mark.parametrize("processes", [1, 2])
def test_results_are_in_the_order_of_the_items_or_complete(processes):
    even = list(range(0, 60, 2))
    assert list(in_order(halved, even, processes)) == list(range(30))
    assert sorted(as_done(halved, even, processes)) == list(range(30))


def test_a_cluster_gives_the_same_results(cluster):
    even = list(range(0, 200, 2))
    address = cluster.scheduler_address
    assert list(in_order(halved, even, scheduler=address)) == list(range(100))
    assert sorted(as_done(halved, even, scheduler=address)) == list(range(100))
    with pytest.raises(ValueError, match="3 is odd"):
        list(in_order(halved, [0, 3, 4], scheduler=address))
    assert list(in_order(halved, [], scheduler=address)) == []


def test_a_cluster_does_not_repeat_an_item_that_fails(cluster, tmp_path):
    with pytest.raises(TypeError, match="impossible"):
        list(in_order(partial(failing, folder=tmp_path), [1], scheduler=cluster.scheduler_address))
    assert (tmp_path / "calls").read_text() == "x"


@pytest.mark.parametrize("run", [in_order, as_done])
def test_items_of_a_process_that_is_killed_are_done_again(run, tmp_path, capsys):
    even = list(range(0, 60, 2))
    found = list(run(partial(halved_unless_first, folder=tmp_path), even, 2))
    assert sorted(found) == list(range(30))
    assert run is as_done or found == list(range(30))
    assert len(list(tmp_path.iterdir())) == 6
    assert "a worker process was killed (out of memory?): its item is done again\n" in capsys.readouterr().err


@pytest.mark.parametrize("run", [in_order, as_done])
def test_a_process_that_is_killed_while_it_sends_blocks_no_other(run, tmp_path):
    # a pipe has 64 kB, so a result of 10 MB is sent while its process lives
    found = list(run(partial(large_unless_killed, folder=tmp_path), range(12), 2))
    assert sorted(map(len, found)) == [10_000_000 + number for number in range(12)]
    assert len(list(tmp_path.iterdir())) == 4


def test_a_run_ends_while_results_are_sent():
    others = set(multiprocessing.active_children())
    results = in_order(large, range(100), 2)
    assert len(next(results)) == 10_000_000
    began = set(multiprocessing.active_children()) - others
    time.sleep(0.2)
    results.close()
    assert len(began) == 2
    assert not any(child.is_alive() for child in began)


def test_errors_of_processes_are_shown_with_their_traceback():
    with pytest.raises(ValueError, match="3 is odd") as raised:
        list(in_order(halved, [0, 3, 4], 2))
    assert 'raise ValueError(f"{number} is odd")' in str(raised.value.__cause__)
    with pytest.raises(RuntimeError, match="can't be sent to another process"):
        list(in_order(unsendable, [1, 2], 2))


def test_a_number_of_processes_that_is_none():
    with pytest.raises(ValueError, match="processes must be at least 1, not 0"):
        list(in_order(halved, [0, 2], 0))


@pytest.mark.parametrize("run", [in_order, as_done])
def test_an_item_that_kills_every_process_ends_the_run(run):
    with pytest.raises(OSError, match="ended at once: does the script"):
        list(run(killed, [1, 2, 3], 2))
    results = run(killed_by_last, [2, 2, 2, 1], 2)
    assert [next(results) for _ in range(3)] == [2, 2, 2]
    with pytest.raises(OSError, match="were killed"):
        next(results)


def test_each_process_gets_the_function_once(tmp_path):
    work = Opened(tmp_path / "count")
    assert list(in_order(work, range(100), 2)) == list(range(100))
    assert len((tmp_path / "count").read_text()) == 2


@pytest.mark.parametrize("where", ["processes", "cluster"])
def test_items_are_taken_only_as_they_are_needed(where, request):
    taken = []

    class Items(list):
        def __iter__(self):
            for item in super().__iter__():
                taken.append(item)
                yield item

    at = {"scheduler": request.getfixturevalue("cluster").scheduler_address} if where == "cluster" else {"processes": 2}
    results = in_order(halved, Items(range(0, 400, 2)), **at)
    assert next(results) == 0
    assert len(taken) <= 2 * AHEAD + 1
    results.close()


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


def test_shards_have_every_nth_item():
    assert in_shard("abcde", None) == "abcde"
    assert [in_shard("abcde", (i, 2)) for i in (1, 2)] == ["ace", "bd"]


@pytest.mark.parametrize(
    "shard", [(0, 2), (3, 2), (True, 2), (1, True), (1.0, 2), (1, 2.5), ("1", 2), (1,), (1, 2, 2), 1]
)
def test_impossible_shards(shard):
    with pytest.raises(ValueError, match="shard must be"):
        in_shard("abcde", shard)
