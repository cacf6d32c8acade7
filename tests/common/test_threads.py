"""A thread that ends with its block, whatever ends the block."""

import threading
import time

import pytest

from nvsdata.common.threads import during_block


def test_work_runs_during_the_block_and_ends_with_it():
    began, seen = threading.Event(), []

    def work(ended):
        began.set()
        ended.wait()
        seen.append(threading.current_thread())

    def block():
        with during_block(work, "some-name"):
            assert began.wait(60)
            assert not seen
            raise KeyError

    with pytest.raises(KeyError):
        block()
    (thread,) = seen
    assert (thread.name, thread.daemon, thread.is_alive()) == ("some-name", True, False)


def test_work_may_end_before_its_block():
    with during_block(lambda ended: None, "some-name"):
        while any(thread.name == "some-name" for thread in threading.enumerate()):
            time.sleep(0.001)


def test_work_that_hangs_is_not_waited_for_longer_than_is_said():
    release, threads = threading.Event(), []

    def work(ended):
        threads.append(threading.current_thread())
        release.wait()

    with during_block(work, "some-name", 0.01):
        pass
    (thread,) = threads
    assert thread.is_alive()
    release.set()
    thread.join()
