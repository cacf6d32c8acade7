import multiprocessing
import operator

import pytest

from nvsdata import processes


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_a_pool_works_however_its_processes_start(monkeypatch, method):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} on this system")
    monkeypatch.setattr(processes, "get_all_start_methods", lambda: [method])
    with processes.pool(2, "nvsdata.events") as workers:
        assert list(workers.map(operator.neg, range(5))) == [0, -1, -2, -3, -4]
