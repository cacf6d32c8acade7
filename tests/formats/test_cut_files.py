"""Files that are cut, changed or replaced while they are read: an error, never the end of the process."""

import resource
import subprocess
import sys

import numpy as np
import pytest
from lookalikes import aedat4_bytes, evt2_bytes, evt3_bytes

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats import contents, ondisk

KINDS = (".dat", ".aedat", ".aedat1", ".aedat3", ".bin", ".aedat4", ".evt2.raw", ".evt3.raw")
every_kind = pytest.mark.parametrize("kind", KINDS)


def long_file(folder, kind):
    """A file beyond what is read to tell its format, and the events in it."""
    t = np.arange(40_000) * 100
    ev = Events(t, t // 100 % 128, t // 700 % 120, t // 100 % 2, (128, 128))
    path = folder / f"a{kind}"
    if kind == ".aedat4":
        path.write_bytes(aedat4_bytes(ev, 0, (128, 128)))
    elif kind.endswith(".raw"):
        make = evt2_bytes if "2" in kind else evt3_bytes
        path.write_bytes(make(ev, f"% evt {kind[4]}.0\n% geometry 128x128\n% end\n".encode()))
    else:
        nvsdata.write(ev, path)
    assert path.stat().st_size > contents.HEAD
    return path, ev


CUT = """
import os, sys
import nvsdata

def told(recording, start=None, stop=None):
    try:
        return str(len(recording.read(start, stop)))
    except nvsdata.FormatError as error:
        assert str(error).startswith(recording.path), error
        return "truncated" if "truncated" in str(error) else "changed" if "changed" in str(error) else str(error)

for path in sys.argv[1:]:
    size = os.path.getsize(path)
    between, before = (nvsdata.open(path, sensor_size=(128, 128)) for _ in range(2))
    window, whole = between.read(1_000_000, 1_500_000), before.read()
    sums = [int(events.x.sum()) for events in (window, whole)]
    os.truncate(path, 70_000)
    cut = told(between, 3_000_000, 3_100_000), told(before, 2_000_000, 3_999_000), told(before)
    # events own their memory
    assert sums == [int(events.x.sum()) for events in (window, whole)]
    os.truncate(path, size)
    print(*sums, *cut, told(between, 3_000_000, 3_100_000))
"""


def test_a_file_that_is_cut_is_an_error_and_events_outlive_it(tmp_path):
    made = [long_file(tmp_path, kind) for kind in KINDS]
    run = subprocess.run([sys.executable, "-c", CUT, *(path for path, _ in made)], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    for kind, (_, ev), line in zip(KINDS, made, run.stdout.splitlines(), strict=True):
        sums = [ev.window(1_000_000, 1_500_000).x.sum(dtype=int), ev.x.sum(dtype=int)]
        # AEDAT 4 is kept whole in memory after its first window
        cut, changed = ("1000", "1000") if kind == ".aedat4" else ("truncated", "changed")
        assert line == f"{sums[0]} {sums[1]} {cut} truncated truncated {changed}"


def test_a_cut_file_is_repaired_by_whom_opens_it_afterwards(tmp_path):
    path, ev = long_file(tmp_path, ".dat")
    with path.open("r+b") as file:
        file.truncate(70_003)
    whole = (70_003 - (path.read_bytes().index(b"\x0c\x08") + 2)) // 8
    assert nvsdata.read(path, strict=False) == ev[:whole]


@every_kind
def test_a_file_cut_within_a_read_is_told_with_the_byte(tmp_path, kind, monkeypatch):
    path, _ = long_file(tmp_path, kind)
    recording = nvsdata.open(path, sensor_size=(128, 128))
    fill = ondisk.OpenFile.fill

    def cut_first(self, at, target):
        with path.open("r+b") as other:
            other.truncate(66_000)
        return fill(self, at, target)

    monkeypatch.setattr(ondisk.OpenFile, "fill", cut_first)
    with pytest.raises(FormatError, match="truncated while it was read") as caught:
        recording.read()
    assert caught.value.offset == 66_000


@every_kind
def test_recordings_and_events_hold_no_descriptors(tmp_path, kind):
    path, ev = long_file(tmp_path, kind)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(80, soft), hard))
    try:
        recordings = [nvsdata.open(path, sensor_size=(128, 128)) for _ in range(120)]
        events = [recording.read(1_000, 20_000) for recording in recordings]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert all(len(some) == len(ev.window(1_000, 20_000)) for some in events)


@pytest.mark.parametrize("kind", [".dat", ".aedat", ".bin"])
def test_another_file_in_its_place_is_told(tmp_path, kind):
    path, ev = long_file(tmp_path, kind)
    recording = nvsdata.open(path, sensor_size=(128, 128))
    recording.read(1_000, 2_000)
    nvsdata.write(ev[5_000:], path)
    with pytest.raises(FormatError, match=r"truncated|changed"):
        recording.read(1_000_000, 2_000_000)
    assert nvsdata.read(path, sensor_size=(128, 128)) == ev[5_000:]


SIZES = {
    ".dat": (b"% Version 2\n% Width {w}\n% Height {h}\n\x00\x08", bytes(8)),
    ".raw": (b"% evt 3.0\n% geometry {w}x{h}\n% end\n", b"\x00\x80\x00\x60\x00\x00\x00\x20"),
    ".evt2.raw": (b"% evt 2.0\n% Width {w}\n% Height {h}\n% end\n", b"\x00\x00\x00\x80" + bytes(4)),
    ".aedat3": (b"#!AER-DAT3.1\r\n#Source 1: nvsdata-{w}x{h}\r\n#!END-HEADER\r\n", b""),
}


@pytest.mark.parametrize("kind", SIZES)
@pytest.mark.parametrize(("width", "height"), [(0, 5), (5, 0), (32768, 5), (5, 10**9), (10**20, 5)])
def test_sizes_in_headers_are_checked_as_sensor_size_is(tmp_path, kind, width, height):
    header, body = SIZES[kind]
    path = tmp_path / f"a{kind}"
    text = [str(side) if side < 10**12 else "1" + 5_000 * "0" for side in (width, height)]
    path.write_bytes(header.replace(b"{w}", text[0].encode()).replace(b"{h}", text[1].encode()) + body)
    with pytest.raises(FormatError, match="the header states an invalid sensor size") as caught:
        nvsdata.open(path)
    assert str(path) in str(caught.value)
    assert nvsdata.read(path, sensor_size=(8, 8)).sensor_size == (8, 8)
    path.write_bytes(header.replace(b"{w}", b"32767").replace(b"{h}", b"1") + body)
    assert nvsdata.read(path).sensor_size == (32767, 1)


def test_the_size_in_aedat_4_is_checked_as_sensor_size_is(tmp_path):
    ev = Events([1, 2], [5, 6], [5, 5], [0, 1])
    (tmp_path / "a.aedat4").write_bytes(aedat4_bytes(ev, size=(0, 240)))
    with pytest.raises(FormatError, match="the header states an invalid sensor size"):
        nvsdata.open(tmp_path / "a.aedat4")


@pytest.mark.parametrize("time", [2**62, -(2**62), 2**63 - 1])
def test_times_that_no_events_can_hold_are_refused_or_dropped(tmp_path, time):
    ev = Events([1, 5, 9], [1, 2, 3], [1, 2, 3], [0, 1, 1], (320, 240))
    raw = bytearray(aedat4_bytes(ev))
    at = raw.index((5).to_bytes(8, "little") + b"\x02\x00\x02\x00")
    raw[at : at + 8] = time.to_bytes(8, "little", signed=True)
    (tmp_path / "a.aedat4").write_bytes(raw)
    with pytest.raises(FormatError, match=r"event 1: a time at or beyond 2\^62"):
        nvsdata.read(tmp_path / "a.aedat4")
    repaired = nvsdata.open(tmp_path / "a.aedat4", strict=False)
    assert repaired.read().t.tolist() == [1, 9]
    assert repaired.repairs == {"events at or beyond 2^62 µs, dropped": 1}
