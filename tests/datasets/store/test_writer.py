"""Packing: what goes into the store, and what becomes of it when the disk is full, a run is killed, or two at once."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import trees
from disks import PAGE, file_limit, small_disk
from distributions import check_same

import nvsdata
from nvsdata import NMNIST, EventFolder, Events, FormatError
from nvsdata.cli import main
from nvsdata.common.locks import OutputInUse, locked
from nvsdata.datasets import ASLDVS, MNISTDVS, DVS128Gesture
from nvsdata.datasets.store import part
from nvsdata.datasets.store.part import JOURNAL
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.writer import pack


@pytest.fixture
def digits(home):
    return home(trees.nmnist())


def animals(root):
    return trees.put(
        root, {f"{name}/{i}.bin": trees.atis(trees.some(i + ord(name[0]))) for name in ("ant", "cat") for i in range(3)}
    )


@pytest.mark.parametrize("bee", [{}, {"0.bin": b""}, {"0.bin": b"abc", "1.bin": b""}])
def test_a_class_without_a_usable_recording_stays_a_class(tmp_path, bee):
    root = trees.put(animals(tmp_path / "data"), {f"bee/{name}": data for name, data in bee.items()})
    (root / "bee").mkdir(exist_ok=True)
    (root / "dog").mkdir()
    report = pack(EventFolder(root), tmp_path / "a.h5")
    store = EventFolder(tmp_path / "a.h5")
    assert store.classes == EventFolder(root).classes == ["ant", "bee", "cat", "dog"]
    assert store.targets == [0, 0, 0, 2, 2, 2]
    assert store.source.left_out == report.skipped
    assert set(report.skipped) == {f"bee/{name}" for name in bee} == set(store.skipped)
    assert all("truncated" in why or why == "no events" for why in report.skipped.values())
    if bee:
        assert f"left out: {len(bee)}" in repr(store)
        with pytest.raises(FormatError, match=r"bee/0\.bin was left out when it was packed"):
            store.open_recording("bee/0.bin")
    # and so does a store of the store
    again = pack(store, tmp_path / "b.h5")
    assert set(again.skipped) == set(report.skipped)
    assert EventFolder(tmp_path / "b.h5").classes == store.classes
    check_same(EventFolder(tmp_path / "b.h5"), store)


def test_a_store_knows_when_recordings_begin_and_end(tmp_path):
    (tmp_path / "data/a").mkdir(parents=True)
    given = [
        Events([50, 60], [1, 2], [3, 4], [0, 1], (9, 9), start=0, end=1000),
        Events([50, 60], [1, 2], [3, 4], [0, 1], (9, 9)),
    ]
    for i, events in enumerate(given):
        nvsdata.write(events, tmp_path / f"data/a/{i}.h5")
    folder = EventFolder(tmp_path / "data")
    pack(folder, tmp_path / "a.h5")
    store = EventFolder(tmp_path / "a.h5")
    for i in range(2):
        one, other = folder.recording(i), store.recording(i)
        assert (one.start, one.end, one.span) == (other.start, other.end, other.span)
        for window in ((None, None), (10, None), (None, 55), (55, 58)):
            a, b = one.read(*window), other.read(*window)
            assert a == b
            assert (a.start, a.end) == (b.start, b.end)


def test_a_store_says_that_it_holds_events_alone(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    recording = NMNIST(tmp_path / "a.h5").recording(0)
    for ask in (recording.frames, recording.inertial):
        with pytest.raises(FormatError, match="a packed store contains only events"):
            ask()


def test_recordings_of_other_splits_do_not_travel_as_side_files(digits, tmp_path):
    pack(NMNIST(digits), tmp_path / "a.h5")
    assert sum(map(len, Store(tmp_path / "a.h5").listing().values())) == 30
    check_same(NMNIST(digits), NMNIST(tmp_path / "a.h5"))


def test_the_whole_of_a_dataset_has_what_options_leave_out(home, tmp_path):
    root = home(trees.mnistdvs())
    pack(MNISTDVS.complete(root), tmp_path / "a.h5")
    for scale in (4, 16, None):
        check_same(MNISTDVS(root, scale=scale), MNISTDVS(tmp_path / "a.h5", scale=scale))


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names must be text there")
def test_odd_names_of_files(tmp_path):
    names = ["a b", "a\nb", os.fsdecode(b"\xff\xfe"), "\u00e4", "\u2603"]
    events = {name: trees.some(i) for i, name in enumerate(names)}
    root = trees.put(tmp_path / "data", {f"c\nd/{name}.bin": trees.atis(ev) for name, ev in events.items()})
    trees.put(root, {"x\udc80/1.bin": trees.atis(trees.some(9)), "x\udc80/broken\n.bin": b"abc"})
    folder = EventFolder(root, sensor_size=(34, 34))
    report = pack(folder, tmp_path / "a.h5")
    store = EventFolder(tmp_path / "a.h5")
    assert store.classes == folder.classes == ["c\nd", "x\udc80"]
    assert list(report.skipped) == ["x\udc80/broken\n.bin"] == store.skipped
    assert "\n" not in report.skipped["x\udc80/broken\n.bin"]
    assert {store.samples[i].stem: store[i][0] for i in range(5)} == events


def test_an_existing_file_is_not_replaced(digits, tmp_path):
    (tmp_path / "a.h5").write_text("mine")
    with pytest.raises(FileExistsError, match="--overwrite"):
        pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert (tmp_path / "a.h5").read_text() == "mine"
    pack(NMNIST(digits, "all"), tmp_path / "a.h5", overwrite=True)
    assert len(NMNIST(tmp_path / "a.h5")) == 30


def test_a_second_process_is_sent_away(digits, tmp_path):
    with locked(tmp_path / "a.h5"), pytest.raises(OutputInUse, match="is being written by process"):
        pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert not (tmp_path / ".a.h5.part").exists()


def stopped(dataset, out, monkeypatch):
    """Pack until all is in the parts, and no further."""

    def stops(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("nvsdata.datasets.store.writer._assemble", stops)
        with pytest.raises(KeyboardInterrupt):
            pack(dataset, out)


def test_what_another_dataset_left_is_not_gone_on_with(home, tmp_path, monkeypatch):
    one, other = tmp_path / "one", tmp_path / "other"
    trees.put(one, trees.nmnist())
    trees.put(other, {name: trees.atis(trees.some(i)) for i, name in enumerate(trees.nmnist())})
    stopped(NMNIST(one, "all"), tmp_path / "a.h5", monkeypatch)
    pack(NMNIST(other, "all"), tmp_path / "a.h5")
    check_same(NMNIST(other, "all"), NMNIST(tmp_path / "a.h5", "all"))


def test_a_file_that_changed_since_is_packed_anew(digits, tmp_path, monkeypatch):
    stopped(NMNIST(digits, "all"), tmp_path / "a.h5", monkeypatch)
    changed = digits / "Train/4/00002.bin"
    changed.write_bytes(trees.atis(trees.some(999)))
    os.utime(changed, ns=(1, 1))
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    check_same(NMNIST(digits, "all"), NMNIST(tmp_path / "a.h5", "all"))


@pytest.mark.parametrize("column", ["t", "x", "y", "p"])
@pytest.mark.parametrize("keep", [0, 1_000, -1])
def test_events_that_never_reached_the_disk_are_packed_anew(digits, tmp_path, monkeypatch, column, keep):
    """As after a power cut: the journal has lines of events that the column lacks, or has zeros for."""
    stopped(NMNIST(digits, "all"), tmp_path / "a.h5", monkeypatch)
    raw = tmp_path / ".a.h5.part" / column
    data = raw.read_bytes()
    raw.write_bytes(data[:keep] + bytes(len(data) // 2 - keep) if keep >= 0 else data[:-1])
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    check_same(NMNIST(digits, "all"), NMNIST(tmp_path / "a.h5", "all"))


def test_events_lost_between_packing_and_assembling_are_noticed(digits, tmp_path, monkeypatch):
    from nvsdata.datasets.store import writer as packing

    def loses(part, *rest):
        with (part.folder / "x").open("r+b") as file:
            file.write(b"\x1f\x1e\x1d")
        return assemble(part, *rest)

    assemble = packing._assemble
    with monkeypatch.context() as patch:
        patch.setattr(packing, "_assemble", loses)
        with pytest.raises(OSError, match=r"lost events of Test/0/00001\.bin: pack again"):
            pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    check_same(NMNIST(digits, "all"), NMNIST(tmp_path / "a.h5", "all"))


def test_what_cannot_be_read_back_is_not_put_in_place(digits, tmp_path, monkeypatch):
    monkeypatch.setattr(Store, "fault", lambda self, name: "torn" if name == "Test/3/00002.bin" else "")
    with pytest.raises(OSError, match=r"Test/3/00002\.bin can't be read back"):
        pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert [path.name for path in tmp_path.glob("*a.h5*")] == [".a.h5.part"]


def tried(dataset, out, whole, compress=False):
    """Whether packing went well: the store is whole then, and not there otherwise."""
    try:
        pack(dataset, out, compress=compress)
    except OSError:
        assert not out.exists()
        shutil.rmtree(out.with_name(f".{out.name}.part"), ignore_errors=True)
        gc.collect()  # an error's traceback holds on to the parts, which takes room
        return False
    assert Store(out).names == whole.names
    assert not any(Store(out).fault(name) for name in whole.names)
    assert not list(out.parent.glob(".*"))
    out.unlink()
    return True


@pytest.mark.parametrize("compress", [False, True])
def test_a_disk_that_is_full(tmp_path, compress):
    root = animals(tmp_path / "data")
    dataset = EventFolder(root)
    pack(dataset, tmp_path / "a.h5", compress=compress)
    whole = Store(tmp_path / "a.h5")
    outcomes = []
    with small_disk(tmp_path / "disk") as resize:
        for room in range(PAGE, 20 * PAGE, 3 * PAGE if compress else PAGE):
            resize(room)
            outcomes.append(tried(dataset, tmp_path / "disk" / "b.h5", whole, compress))
    assert outcomes == sorted(outcomes)
    assert not outcomes[0]
    assert outcomes[-1]


def test_files_may_not_grow_any_more(tmp_path):
    dataset = EventFolder(animals(tmp_path / "data"))
    pack(dataset, tmp_path / "a.h5")
    whole, size = Store(tmp_path / "a.h5"), (tmp_path / "a.h5").stat().st_size
    outcomes = []
    for limit in [*range(0, size, PAGE // 4), size, size + PAGE]:
        with file_limit(limit):
            outcomes.append(tried(dataset, tmp_path / "b.h5", whole))
    assert outcomes == sorted(outcomes)
    assert not outcomes[0]
    assert outcomes[-2:] == [True, True]


def test_a_full_disk_is_gone_on_from(tmp_path):
    dataset = EventFolder(animals(tmp_path / "data"))
    with small_disk(tmp_path / "disk") as resize:
        for room in range(PAGE, 40 * PAGE, PAGE):
            resize(room)
            try:
                pack(dataset, tmp_path / "disk" / "a.h5")
            except OSError:
                gc.collect()
                continue
            break
        check_same(dataset, EventFolder(tmp_path / "disk" / "a.h5"))


SLOW = """
import sys, time
from nvsdata.datasets.store import writer
decode = writer._decode
def slowly(*given):
    time.sleep(0.2)
    return decode(*given)
writer._decode = slowly
from nvsdata.cli import main
sys.exit(main())
"""


def test_two_commands_at_once_and_a_kill(digits, tmp_path, capsys):
    out = tmp_path / "a.h5"
    arguments = ["pack", str(digits), "--dataset", "NMNIST", "--out", str(out)]
    first = subprocess.Popen([sys.executable, "-c", SLOW, *arguments], stderr=subprocess.DEVNULL)
    journal = out.with_name(".a.h5.part") / JOURNAL
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 3):
        assert first.poll() is None
        time.sleep(0.02)
    assert main(arguments) == 1
    said = capsys.readouterr().err
    assert f"is being written by process {first.pid}" in said
    assert said.count("\n") == 1
    first.send_signal(signal.SIGKILL)
    first.wait()
    assert not out.exists()
    # the lock of a dead process is no lock
    assert main(arguments) == 0
    assert capsys.readouterr().out.startswith("50 recordings")
    assert not list(tmp_path.glob("*.part"))
    check_same(NMNIST(digits, "all"), NMNIST(out, "all"))
    assert main(arguments) == 1
    assert "--overwrite" in capsys.readouterr().err


def test_users_and_windows_of_a_store(home, tmp_path):
    root = home(trees.dvs128gesture())
    (root / "DvsGesture/user24_lab.aedat").write_bytes(b"#!AER-DAT3.1\r\n#!END-HEADER\r\n")
    report = pack(DVS128Gesture(root, "all"), tmp_path / "a.h5")
    assert list(report.skipped) == ["DvsGesture/user24_lab.aedat"]
    assert set(DVS128Gesture(tmp_path / "a.h5", "test").users) == {29}
    assert len(DVS128Gesture(root, "test")) == 24


def test_letters_from_a_store_stand_as_in_the_folder(home, tmp_path):
    root = home(trees.asldvs())
    pack(ASLDVS(root, "all"), tmp_path / "a.h5")
    assert np.array_equal(ASLDVS(root)[3][0].y, ASLDVS(tmp_path / "a.h5")[3][0].y)


def test_a_store_within_its_dataset(tmp_path, monkeypatch):
    """Neither what is unfinished nor the store itself is part of the dataset."""
    for label in ("ant", "bee"):
        for i in range(4):
            path = tmp_path / label / f"{i}.npy"
            path.parent.mkdir(exist_ok=True)
            nvsdata.write(nvsdata.Events([5, 7 + i], [1, 2], [1, 2], [0, 1], (4, 4)), path)
    out = tmp_path / "all.h5"
    add, count = part.Part.add, iter(range(9))

    def dies(self, *given):
        add(self, *given)
        if next(count) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(part.Part, "add", dies)
    with pytest.raises(KeyboardInterrupt):
        nvsdata.pack(nvsdata.EventFolder(tmp_path, "all"), out)
    monkeypatch.undo()
    sizes = []
    for _ in range(3):
        nvsdata.pack(nvsdata.EventFolder(tmp_path, "all"), out, overwrite=True)
        store = nvsdata.EventFolder(out, "all")
        assert store.classes == ["ant", "bee"]
        assert store.targets == [0] * 4 + [1] * 4
        sizes.append(out.stat().st_size)
    assert len(set(sizes)) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all.h5", "ant", "bee"]
