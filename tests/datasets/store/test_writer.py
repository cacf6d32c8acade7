"""Packing: what goes into the store, and what becomes of it when the disk is full, a run is killed, or two at once."""

from __future__ import annotations

import gc
import json
import os
import shutil
import signal
import stat
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
from nvsdata.datasets.store import part, writer, writing
from nvsdata.datasets.store.index import BEGIN
from nvsdata.datasets.store.part import DATA, JOURNAL
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.record import ALIGNED
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


class Killed(BaseException):
    """Raised by a test in place of a kill."""


def kills(*_, **__):
    raise Killed


def stopped(dataset, out, monkeypatch, step="_finish", **options):
    """Pack up to a step of the writer."""
    with monkeypatch.context() as patch:
        patch.setattr(writer if step == "_decode" else writing, step, kills)
        with pytest.raises(Killed):
            pack(dataset, out, **options)
    assert not out.exists()
    return out.with_name(f".{out.name}.part")


@pytest.fixture
def few(tmp_path):
    """A dataset of six recordings with a side file, and the bytes of its two stores."""
    root = trees.put(animals(tmp_path / "data"), {"list.txt": b"ant/0.bin"})
    (tmp_path / "whole").mkdir()
    stores = {}
    for compress in (False, True):
        pack(EventFolder(root), tmp_path / "whole/a.h5", compress=compress, overwrite=True)
        stores[compress] = (tmp_path / "whole/a.h5").read_bytes()
    return EventFolder(root), stores


def decoded(dataset, out, monkeypatch, **options):
    """Pack, and return the recordings that were decoded."""
    decode, names = writer._decode, []

    def noted(*given):
        names.append(given[-1])
        return decode(*given)

    with monkeypatch.context() as patch:
        patch.setattr(writer, "_decode", noted)
        pack(dataset, out, **options)
    assert not list(out.parent.glob(f".{out.name}*"))
    return names


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


@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize("keep", [0, 10, BEGIN, 1_000, -1])
def test_events_that_never_reached_the_disk_are_packed_anew(digits, tmp_path, monkeypatch, keep, zeros):
    """After a power cut, the journal may have lines of records that the data lacks, or has zeros for."""
    data = stopped(NMNIST(digits, "all"), tmp_path / "a.h5", monkeypatch) / DATA
    raw = data.read_bytes()
    data.write_bytes(raw[:keep] + bytes(len(raw) - len(raw[:keep]) if zeros else 0))
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    check_same(NMNIST(digits, "all"), NMNIST(tmp_path / "a.h5", "all"))


@pytest.mark.parametrize("compress", [False, True])
def test_a_run_goes_on_after_the_last_sound_record(few, tmp_path, monkeypatch, compress):
    dataset, stores = few
    names, out, rng = dataset.recording_names(), tmp_path / "a.h5", np.random.default_rng(0)
    for altered in range(len(names)):
        data = stopped(dataset, out, monkeypatch, compress=compress) / DATA
        lengths = [json.loads(line)["length"] for line in lines_of(data)[1:]]
        raw = bytearray(data.read_bytes())
        assert len(raw) == BEGIN + sum(lengths)
        raw[BEGIN + sum(lengths[:altered]) + int(rng.integers(0, lengths[altered] - ALIGNED))] ^= 1
        data.write_bytes(raw)
        assert decoded(dataset, out, monkeypatch, compress=compress) == names[altered:]
        assert out.read_bytes() == stores[compress]
        out.unlink()


def lines_of(data):
    """Lines of the journal next to the data of an unfinished store."""
    return data.with_name(JOURNAL).read_bytes().splitlines(keepends=True)


@pytest.mark.parametrize("compress", [False, True])
def test_a_journal_that_is_cut_anywhere_loses_only_what_was_cut(few, tmp_path, monkeypatch, compress):
    dataset, stores = few
    names, out = dataset.recording_names(), tmp_path / "a.h5"
    data = stopped(dataset, out, monkeypatch, compress=compress) / DATA
    before, lines = data.read_bytes(), lines_of(data)
    ends = np.cumsum([len(line) for line in lines]).tolist()
    for cut in sorted({0, 1, ends[0] - 1, *ends, *(end + step for end in ends[:-1] for step in (1, 50, -1))}):
        data.parent.mkdir(exist_ok=True)
        data.write_bytes(before)
        data.with_name(JOURNAL).write_bytes(b"".join(lines)[:cut])
        whole = max(sum(end <= cut for end in ends) - 1, 0)
        assert decoded(dataset, out, monkeypatch, compress=compress) == names[whole:]
        assert out.read_bytes() == stores[compress]
        out.unlink()


@pytest.mark.parametrize("compress", [False, True])
def test_a_kill_within_any_write_is_gone_on_from(few, tmp_path, monkeypatch, compress):
    dataset, stores = few
    out, write_all, written = tmp_path / "a.h5", writing.write_all, []

    def dies_in(moment, share):
        def dies(handle, content):
            written.append(handle)
            if len(written) < moment:
                write_all(handle, content)
                return
            write_all(handle, bytes(content)[: round(share * len(content))])
            raise Killed

        return dies

    # the journal's first line, two writes for each recording, index and head
    for moment in range(1, 1 + 2 * 6 + 2 + 1):
        for share in (0, 0.4, 1):
            written.clear()
            with monkeypatch.context() as patch:
                for module in (writing, part):
                    patch.setattr(module, "write_all", dies_in(moment, share))
                with pytest.raises(Killed):
                    pack(dataset, out, compress=compress)
            assert not out.exists()
            pack(dataset, out, compress=compress)
            assert out.read_bytes() == stores[compress]
            assert not list(tmp_path.glob(".*"))
            out.unlink()


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("step", ["packed_index", "file_head", "_read_back"])
def test_an_index_that_an_earlier_run_appended_is_replaced(few, tmp_path, monkeypatch, compress, step):
    dataset, stores = few
    out = tmp_path / "a.h5"
    for _ in range(2):
        stopped(dataset, out, monkeypatch, step, compress=compress)
    assert decoded(dataset, out, monkeypatch, compress=compress) == []
    assert out.read_bytes() == stores[compress]
    out.unlink()
    # a shorter one, after a longer one
    folder = stopped(dataset, out, monkeypatch, step, compress=compress)
    with (folder / DATA).open("ab") as file:
        file.write(b"more" * 1_000)
    pack(dataset, out, compress=compress)
    assert out.read_bytes() == stores[compress]


def test_side_files_and_folders_that_changed_since_are_those_of_the_next_run(few, tmp_path, monkeypatch):
    dataset, _ = few
    stopped(dataset, tmp_path / "a.h5", monkeypatch, "_read_back")
    (dataset.root / "list.txt").write_bytes(b"cat/0.bin\n" * 100)
    (dataset.root / "dog").mkdir()
    assert decoded(EventFolder(dataset.root), tmp_path / "a.h5", monkeypatch) == []
    assert Store(tmp_path / "a.h5").data("list.txt") == b"cat/0.bin\n" * 100
    assert EventFolder(tmp_path / "a.h5").classes == ["ant", "cat", "dog"]


@pytest.mark.parametrize("compress", [False, True])
def test_what_was_compressed_is_not_gone_on_with_uncompressed(few, tmp_path, monkeypatch, compress):
    dataset, stores = few
    out = tmp_path / "a.h5"
    stopped(dataset, out, monkeypatch, compress=not compress)
    assert decoded(dataset, out, monkeypatch, compress=compress) == dataset.recording_names()
    assert out.read_bytes() == stores[compress] != stores[not compress]


@pytest.mark.parametrize("compress", [False, True])
def test_a_store_of_many_processes_has_the_bytes_of_one(few, tmp_path, compress):
    dataset, stores = few
    pack(dataset, tmp_path / "a.h5", compress=compress, jobs=3)
    assert (tmp_path / "a.h5").read_bytes() == stores[compress]


def test_a_recording_that_was_left_out_is_tried_again(few, tmp_path, monkeypatch):
    dataset, _ = few
    sound, out = (dataset.root / "ant/1.bin").read_bytes(), tmp_path / "a.h5"
    (dataset.root / "ant/1.bin").write_bytes(sound + b"ab")
    stopped(EventFolder(dataset.root), out, monkeypatch)
    (dataset.root / "ant/1.bin").write_bytes(sound)
    # and appended: recordings are in the order in which they were packed
    assert decoded(EventFolder(dataset.root), out, monkeypatch) == ["ant/1.bin"]
    assert not Store(out).left_out
    check_same(EventFolder(dataset.root), EventFolder(out))


def test_events_lost_after_packing_are_noticed_and_packed_again(digits, tmp_path, monkeypatch):
    finish = writing._finish

    def loses(part, *rest):
        with part.data.open("r+b") as file:
            file.seek(BEGIN + 200)
            file.write(b"\xff\x1e\x1d")
        return finish(part, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(writing, "_finish", loses)
        with pytest.raises(OSError, match=r"the record of Test/0/00001\.bin can't be read back"):
            pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    check_same(NMNIST(digits, "all"), NMNIST(tmp_path / "a.h5", "all"))


@pytest.mark.skipif(sys.platform == "win32", reason="permissions as POSIX has them")
@pytest.mark.parametrize("umask", [0o077, 0o022, 0o002])
def test_a_new_store_has_the_permissions_of_any_new_file(few, tmp_path, umask):
    before = os.umask(umask)
    try:
        pack(few[0], tmp_path / "a.h5")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.h5").stat().st_mode) == 0o666 & ~umask


@pytest.mark.skipif(sys.platform == "win32", reason="permissions as POSIX has them")
def test_a_store_in_place_of_another_has_its_permissions(few, tmp_path):
    (tmp_path / "a.h5").write_text("private")
    (tmp_path / "a.h5").chmod(0o600)
    pack(few[0], tmp_path / "a.h5", overwrite=True)
    assert stat.S_IMODE((tmp_path / "a.h5").stat().st_mode) == 0o600


def test_a_link_stays_and_its_target_is_replaced(few, tmp_path):
    dataset, stores = few
    (tmp_path / "large").mkdir()
    (tmp_path / "large/b.h5").write_text("old")
    (tmp_path / "a.h5").symlink_to(tmp_path / "large/b.h5")
    with pytest.raises(FileExistsError, match="--overwrite"):
        pack(dataset, tmp_path / "a.h5")
    assert (tmp_path / "large/b.h5").read_text() == "old"
    pack(dataset, tmp_path / "a.h5", overwrite=True)
    assert (tmp_path / "a.h5").is_symlink()
    assert (tmp_path / "large/b.h5").read_bytes() == stores[False]
    assert not [*tmp_path.glob(".*"), *(tmp_path / "large").glob(".*")]
    with locked(tmp_path / "large/b.h5"), pytest.raises(OutputInUse):
        pack(dataset, tmp_path / "a.h5", overwrite=True)


def test_a_link_to_nothing_is_not_followed_unless_asked(few, tmp_path):
    dataset, stores = few
    (tmp_path / "a.h5").symlink_to(tmp_path / "b.h5")
    with pytest.raises(FileExistsError, match="--overwrite"):
        pack(dataset, tmp_path / "a.h5")
    assert not (tmp_path / "b.h5").exists()
    pack(dataset, tmp_path / "a.h5", overwrite=True)
    assert (tmp_path / "b.h5").read_bytes() == stores[False]


def test_a_folder_is_not_replaced(few, tmp_path):
    (tmp_path / "a.h5").mkdir()
    with pytest.raises(IsADirectoryError):
        pack(few[0], tmp_path / "a.h5", overwrite=True)


def test_an_existing_store_stays_until_the_new_one_is_complete(few, tmp_path, monkeypatch):
    dataset, stores = few
    (tmp_path / "a.h5").write_text("old")
    for step in ("_decode", "_finish", "_read_back"):
        with monkeypatch.context() as patch:
            patch.setattr(writer if step == "_decode" else writing, step, kills)
            with pytest.raises(Killed):
                pack(dataset, tmp_path / "a.h5", overwrite=True)
        assert (tmp_path / "a.h5").read_text() == "old"
    assert decoded(dataset, tmp_path / "a.h5", monkeypatch, overwrite=True) == []
    assert (tmp_path / "a.h5").read_bytes() == stores[False]


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


def test_an_index_without_room_is_added_by_the_next_run(few, tmp_path, monkeypatch, capsys):
    root = few[0].root
    (root / "list.txt").write_bytes(b"ant/0.bin\n" * 5_000)
    dataset, out = EventFolder(root), tmp_path / "disk/a.h5"
    with small_disk(tmp_path / "disk") as resize:
        resize(8 * PAGE)
        for _ in range(2):
            with pytest.raises(OSError, match="No space left") as caught:
                pack(dataset, out)
            assert caught.value.filename == str(out)
            assert "all records are in" in capsys.readouterr().err
            assert not out.exists()
            del caught
        resize(40 * PAGE)
        assert decoded(dataset, out, monkeypatch) == []
        assert EventFolder(out).source.data("list.txt") == b"ant/0.bin\n" * 5_000
        check_same(dataset, EventFolder(out))


@pytest.mark.parametrize("compress", [False, True])
def test_a_store_is_packed_into_its_own_place(few, tmp_path, compress):
    dataset, stores = few
    out = tmp_path / "a.h5"
    pack(dataset, out, compress=not compress)
    store = EventFolder(out)
    pack(store, out, compress=compress, overwrite=True)
    assert out.read_bytes() == stores[compress]
    # and the one that is open is still read
    check_same(store, EventFolder(out))


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


@pytest.mark.parametrize("suffix", [".h5", ".nvs"])
def test_a_store_within_its_dataset(tmp_path, monkeypatch, suffix):
    """Neither what is unfinished nor the store itself is part of the dataset."""
    for label in ("ant", "bee"):
        for i in range(4):
            path = tmp_path / label / f"{i}.npy"
            path.parent.mkdir(exist_ok=True)
            nvsdata.write(nvsdata.Events([5, 7 + i], [1, 2], [1, 2], [0, 1], (4, 4)), path)
    out = tmp_path / f"all{suffix}"
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
    assert sorted(path.name for path in tmp_path.iterdir()) == [out.name, "ant", "bee"]
