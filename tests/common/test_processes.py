import multiprocessing
import operator
import os
import signal
import time

import pytest
from processes_of_others import another_process

from nvsdata.common import processes


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_a_pool_works_however_its_processes_start(monkeypatch, method):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} on this system")
    monkeypatch.setattr(processes, "get_all_start_methods", lambda: [method])
    with processes.process_pool(2, "nvsdata.data.events") as workers:
        assert list(workers.map(operator.neg, range(5))) == [0, -1, -2, -3, -4]


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_workers_end_with_the_process_that_started_them(method):
    code = f"""
        import os, time
        from nvsdata.common import processes
        processes.get_all_start_methods = lambda: [{method!r}]
        if __name__ == "__main__":
            pool = processes.process_pool(2, "nvsdata.data.events")
            pids = set()
            while len(pids) < 2:
                pids |= set(pool.map(eval, ['__import__("time").sleep(0.2) or __import__("os").getpid()'] * 2))
            futures = [pool.submit(time.sleep, 600) for _ in range(2)]
            print(*pids, flush=True)
            time.sleep(600)
    """
    with another_process(code) as (process, line):
        pids = [int(word) for word in line.split()]
        process.send_signal(signal.SIGKILL)
        process.wait()
        deadline = time.monotonic() + 20
        while any(_runs(pid) for pid in pids):
            assert time.monotonic() < deadline, "a worker outlives its parent"
            time.sleep(0.05)


def _runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
