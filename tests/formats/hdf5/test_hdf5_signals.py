"""Signals that arrive while the HDF5 library writes: the command ends by them, not by an error of the library's."""

import os
import signal

import numpy as np
import pytest

from nvsdata.common.signals import Ended, ending_by_signals
from nvsdata.formats.hdf5 import disk as hdf5_disk

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")


@pytest.mark.parametrize("method", ["write", "seek", "truncate"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_within_a_call_of_the_library_ends_the_writing(tmp_path, monkeypatch, method, number):
    sent = []

    real = getattr(hdf5_disk._Disk, method)

    def hit(self, *given):
        if not sent:
            sent.append(number)
            signal.raise_signal(number)
        return real(self, *given)

    monkeypatch.setattr(hdf5_disk._Disk, method, hit)
    monkeypatch.setattr(hdf5_disk, "_CALLED_BY_LIBRARY", {hit.__code__, *hdf5_disk._CALLED_BY_LIBRARY})

    def write():
        with ending_by_signals(), hdf5_disk.created(tmp_path / "a.h5") as (file, disk):
            for k in range(50):
                file.create_dataset(f"{k}", data=np.arange(10_000))
                disk.check()

    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    with pytest.raises(KeyboardInterrupt) as ended:
        write()
    assert sent == [number]
    assert (number == signal.SIGINT) or (isinstance(ended.value, Ended) and ended.value.number == number)
    assert {one: signal.getsignal(one) for one in before} == before
