import subprocess
import sys
import threading
import time

import pytest
from clips import moving_square, write_video

from nvsdata.common import prefetch as module
from nvsdata.common.prefetch import DEPTH, in_one_thread, prefetch, stay_in_one_thread


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


@pytest.mark.parametrize("worth", [0, 10])
def test_whatever_ends_the_making_comes_through(worth):
    def ended():
        yield 1
        raise KeyboardInterrupt

    found = prefetch(ended(), worth)
    assert next(found) == 1
    with pytest.raises(KeyboardInterrupt):
        next(found)


def test_a_process_may_be_told_to_stay_in_one_thread(monkeypatch):
    monkeypatch.setattr(module, "_alone", False)
    assert not in_one_thread()
    stay_in_one_thread()
    assert in_one_thread()
    here = threading.current_thread().name
    assert list(prefetch(makers([0] * 20))) == [here] * 20
    assert list(prefetch(makers([0.002] * 12), worth=0.001)) == [here] * 12


def test_so_many_are_made_ahead_and_no_more():
    made = []
    line = module._Queue(made.append(n) or n for n in range(3 * DEPTH))
    maker = threading.Thread(target=line.fill)
    maker.start()
    deadline = time.monotonic() + 30
    while len(made) < DEPTH:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    time.sleep(0.02)
    assert made == list(range(DEPTH))
    assert line.take() == made[:DEPTH]
    line.stop()
    maker.join()
    assert len(made) <= 2 * DEPTH


def test_what_was_made_is_taken_before_the_end_is_told():
    line = module._Queue(iter([1, 2, 3]))
    line.fill()
    assert line.take() == [1, 2, 3]
    assert line.take() == []


class Camera:
    """Items that can be closed."""

    def __init__(self, items):
        self.items, self.closed = iter(items), 0

    def __iter__(self):
        return self

    def __next__(self):
        return next(self.items)

    def close(self):
        self.closed += 1


@pytest.mark.parametrize("worth", [0, 10])
def test_what_can_be_closed_is_closed_at_the_end(worth):
    camera = Camera(range(20))
    assert list(prefetch(camera, worth)) == list(range(20))
    assert camera.closed == 1
    camera = Camera(range(20))
    next(left := prefetch(camera, worth))
    left.close()
    assert camera.closed == 1
    assert list(prefetch(iter(range(20)), worth)) == list(range(20))


def test_an_item_is_taken_before_the_next_is_there():
    taken, waited = threading.Event(), []

    def slow():
        for n in range(3):
            yield n
            waited.append(taken.wait(10))
            taken.clear()

    found = []
    for item in prefetch(slow()):
        found.append(item)
        taken.set()
    assert found == [0, 1, 2]
    assert waited == [True] * 3


def test_a_process_ends_well_in_the_middle_of_a_video(tmp_path):
    path = write_video(tmp_path / "a.avi", moving_square(200, (320, 240)))
    code = f"from nvsdata.video.frames import frames_of; left = frames_of({str(path)!r}); next(left)"
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
        assert (done.returncode, done.stderr) == (0, "")


def test_the_end_of_the_process_is_not_taken_for_that_of_the_items(tmp_path):
    code = f"""
import threading, time
from nvsdata.common.prefetch import prefetch

def slow():
    while True:
        time.sleep(2)
        yield 0

def take(items):
    for _ in items:
        pass
    open({str(tmp_path / "whole")!r}, "w").close()

for items in (slow(), iter(lambda: time.sleep(0.01), 1)):
    threading.Thread(target=take, args=(prefetch(items),), daemon=True).start()
time.sleep(0.5)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "whole").exists()
