import multiprocessing
import subprocess
import sys

import pytest

# a module that numba imports at a process's first call of a kernel
LOADED_LATE = "numba.cpython.charseq"
SCRIPT = f"""
import multiprocessing, sys
import nvsdata.kernels.compiling

def look(pipe):
    pipe.send({LOADED_LATE!r} in sys.modules)

assert {LOADED_LATE!r} not in sys.modules
here, there = multiprocessing.get_context("fork").Pipe()
process = multiprocessing.get_context("fork").Process(target=look, args=(there,))
process.start()
print(here.recv())
process.join()
"""


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
def test_what_numba_loads_at_its_first_call_is_loaded_before_a_fork():
    found = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert found.stdout == "True\n"
