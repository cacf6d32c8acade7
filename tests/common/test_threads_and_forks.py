"""A fork waits for threads in native code, and they for it."""

import os
import threading
import time

import pytest

from nvsdata.common import forks
from nvsdata.common.forks import forkless

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork"),
    pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning"),
]


class Held:
    """A thread within native code, which holds a lock of it."""

    def __init__(self, seconds):
        self.lock, self.inside, self._seconds = threading.Lock(), threading.Event(), seconds
        self.thread = threading.Thread(target=self._hold, daemon=True)
        self.thread.start()
        self.inside.wait(10)

    def _hold(self):
        with forkless(), self.lock:
            self.inside.set()
            time.sleep(self._seconds)


def in_child(work):
    """What a forked process finds; None if it hangs."""
    child = os.fork()
    if not child:
        os._exit(7 if work() else 8)
    for _ in range(500):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 7
        time.sleep(0.01)
    os.kill(child, 9)
    os.waitpid(child, 0)
    return None


def test_a_child_gets_no_lock_that_is_held():
    held = Held(0.3)
    assert in_child(lambda: held.lock.acquire(timeout=1))
    # it had left when the fork went through
    assert not held.lock.locked()


def test_a_child_and_its_parent_can_go_on():
    def enters():
        with forkless():
            return True

    Held(0.05)
    assert in_child(enters)
    assert enters()


def test_a_fork_by_who_is_inside_waits_for_nobody():
    began = time.monotonic()
    with forkless():
        assert in_child(lambda: True)
    assert time.monotonic() - began < forks.PATIENCE


def test_a_fork_waits_no_longer_than_its_patience(monkeypatch):
    monkeypatch.setattr(forks, "PATIENCE", 0.05)
    held = Held(5)
    assert in_child(lambda: not held.lock.acquire(timeout=0.01))


def test_threads_wait_while_a_process_forks(monkeypatch):
    monkeypatch.setattr(forks._gate, "forks", 1)
    entered = threading.Event()

    def enter():
        with forkless():
            entered.set()

    thread = threading.Thread(target=enter, daemon=True)
    thread.start()
    assert not entered.wait(0.1)
    forks._in_parent()
    assert entered.wait(10)
    assert forks._gate.forks == 0
