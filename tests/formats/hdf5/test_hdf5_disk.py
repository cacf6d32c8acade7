"""The file that the HDF5 library writes to: it behaves as one in memory, whatever the disk does."""

import io
from contextlib import nullcontext

import numpy as np
import pytest

from nvsdata.formats.hdf5.disk import _Disk


class Full:
    """A file that raises from its n-th call to write or truncate on; before, it writes at most 5 bytes at a time."""

    def __init__(self, file, calls):
        self.file, self.left = file, calls

    def __getattr__(self, name):
        return getattr(self.file, name)

    def counted(self):
        self.left -= 1
        if self.left < 0:
            raise OSError("full")

    def write(self, data):
        self.counted()
        return self.file.write(data[:5])

    def truncate(self, size):
        self.counted()
        return self.file.truncate(size)


@pytest.mark.parametrize("calls", [0, 1, 7, 40, 10_000])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_written_is_read_also_after_an_error(tmp_path, seed, calls):
    rng = np.random.default_rng(seed)
    disk, memory = _Disk(tmp_path / "a"), io.BytesIO()
    disk._file = Full(disk._file, calls)
    end = 0
    for _ in range(120):
        what = rng.integers(4)
        if what == 0:
            data = rng.bytes(int(rng.integers(0, 12)))
            assert disk.write(data) == memory.write(data) == len(data)
            end = max(end, memory.tell()) if data else end
        elif what == 1:
            room = bytearray(int(rng.integers(0, 20)))
            other = bytearray(len(room))
            assert disk.readinto(room) == memory.readinto(other)
            assert room == other
        elif what == 2:
            place, whence = int(rng.integers(0, 40)), int(rng.integers(3))
            if whence == 2:
                place = -min(place, end)
            elif whence == 1:
                place = min(place, 3)
            assert disk.seek(place, whence) == memory.seek(place, whence)
        else:
            # the library only ever lets the file grow
            size = end + int(rng.integers(0, 6))
            where = memory.tell()
            memory.seek(end)
            memory.write(bytes(size - end))
            memory.seek(where)
            assert disk.truncate(size) == size
            end = size
        assert disk.tell() == memory.tell()
        if calls == 10_000:
            disk.check()
    with pytest.raises(OSError, match="full") if calls < 10_000 else nullcontext():
        disk.check()
    disk.close()
    if calls == 10_000:
        assert (tmp_path / "a").read_bytes() == memory.getvalue()


def test_a_disk_without_arguments(tmp_path):
    with _Disk(tmp_path / "a") as disk:
        assert (disk.readable(), disk.writable(), disk.seekable()) == (True, True, True)
        disk.write(b"abcdef")
        assert disk.seek(2) == 2
        assert disk.truncate() == 2
        assert disk.seek(0, io.SEEK_END) == 2
        assert disk.write(np.arange(3, dtype="<u2")) == 6
    assert disk.closed
    assert (tmp_path / "a").read_bytes() == b"ab\0\0\1\0\2\0"


def test_an_error_of_closing_is_kept_unless_there_was_one(tmp_path):
    class Lost(io.BytesIO):
        def close(self):
            raise OSError("lost")

    for earlier in (None, OSError("earlier")):
        disk = _Disk(tmp_path / "a")
        disk._file.close()
        disk._file, disk._error = Lost(), earlier
        disk.close()
        with pytest.raises(OSError, match="lost" if earlier is None else "earlier"):
            disk.check()
        disk.close()
