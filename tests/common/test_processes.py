import multiprocessing
import operator
import os
import signal
import time

import pytest
from processes_of_others import another_process, answer

from nvsdata.common import processes


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_a_process_answers_however_it_starts(monkeypatch, method):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} on this system")
    monkeypatch.setattr(processes, "get_all_start_methods", lambda: [method])
    process, connection = processes.connected_process(answer, operator.neg, "nvsdata.data.events")
    connection.send(5)
    assert connection.recv() == -5
    process.join()
    with pytest.raises(EOFError):
        connection.recv()


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_workers_end_with_the_process_that_started_them(method):
    code = f"""
        import time
        from nvsdata.common import processes
        from processes_of_others import answer
        processes.get_all_start_methods = lambda: [{method!r}]
        if __name__ == "__main__":
            made = [processes.connected_process(answer, time.sleep, "nvsdata.data.events") for _ in range(2)]
            for _, connection in made:
                connection.send(600)
            print(*(process.pid for process, _ in made), flush=True)
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


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_ctrl_c_ends_no_worker_that_still_imports():
    code = """
        from nvsdata.common import processes
        from processes_of_others import answer, blocked
        if __name__ == "__main__":
            _, connection = processes.connected_process(answer, blocked, "nvsdata.data.events")
            connection.send(())
            print(connection.recv(), blocked(()), flush=True)
    """
    with another_process(code) as (_, line):
        assert line == "True False\n"


def _runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
