"""Stores that the datasets' classes open in place of folders."""

import multiprocessing
import os
import pickle
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import storefiles
import trees
from distributions import CASES, check_same
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import EventFolder, FormatError
from nvsdata import transforms as T
from nvsdata.datasets import ASLANDVS, ASLDVS, NMNIST, DVS128Gesture, NCaltech101
from nvsdata.datasets.store import record, writing
from nvsdata.datasets.store import writer as packing
from nvsdata.datasets.store.opening import open_store
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.writer import pack


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("compress", [False, True])
def test_a_store_gives_what_the_folder_gives(home, tmp_path, name, compress):
    files, kind, *_ = CASES[name]
    root = home(files())
    report = pack(kind(root, "all"), tmp_path / "a.nvs", compress=compress)
    assert report.packed == len(set(kind(root, "all").recording_names()))
    assert not (tmp_path / ".a.nvs.part").exists()
    for split in ("train", "test"):
        folder, store = kind(root, split), kind(tmp_path / "a.nvs", split)
        check_same(folder, store)
        window = T.Window(10_000, 60_000)
        for i in range(len(folder)):
            assert window(folder.recording(i)) == window(store.recording(i))
            assert folder.recording(i).span == store.recording(i).span


def test_a_store_remembers_which_sizes_are_guessed(tmp_path):
    for name in ("a.npy", "a.dat"):
        (tmp_path / "data/one").mkdir(parents=True, exist_ok=True)
        nvsdata.write(trees.some(0), tmp_path / "data/one" / name)
    for n in range(2):
        # packed once more from a store
        source = tmp_path / (f"{n - 1}.nvs" if n else "data")
        pack(EventFolder(source), tmp_path / f"{n}.nvs")
        found = {Path(one.path).name: one for one in map(EventFolder(tmp_path / f"{n}.nvs").recording, range(2))}
        assert {name: one.size_is_guessed for name, one in found.items()} == {"a.npy": True, "a.dat": False}
        assert pickle.loads(pickle.dumps(found["a.npy"])).size_is_guessed
        assert not pickle.loads(pickle.dumps(found["a.dat"])).size_is_guessed
    stated = EventFolder(tmp_path / "1.nvs", sensor_size=(1280, 720))
    assert [stated.recording(i).size_is_guessed for i in range(2)] == [False, False]


def test_side_files_travel_along(home, tmp_path):
    root = home(trees.ncaltech101())
    pack(NCaltech101(root, "all"), tmp_path / "a.nvs")
    folder, store = NCaltech101(root), NCaltech101(tmp_path / "a.nvs")
    assert [folder.box(i) for i in range(len(folder))] == [store.box(i) for i in range(len(store))]
    root = home(trees.dvs128gesture())
    shutil.rmtree(root / "Caltech101", ignore_errors=True)
    pack(DVS128Gesture(root, "all"), tmp_path / "g.nvs")
    assert DVS128Gesture(tmp_path / "g.nvs", "test").users == DVS128Gesture(root, "test").users


def test_pairs_from_a_store(home, tmp_path):
    root = home(trees.aslandvs(True))
    pack(ASLANDVS(root, "all"), tmp_path / "a.nvs")
    folder, store = ASLANDVS(root, "test"), ASLANDVS(tmp_path / "a.nvs", "test")
    assert [folder[i] for i in range(len(folder))] == [store[i] for i in range(len(store))]


def test_a_folder_with_splits_of_its_own(home, tmp_path):
    files = {
        f"{split}/{name}/{i}.bin": trees.atis(trees.some(i))
        for split in ("train", "test")
        for name in "ab"
        for i in range(3)
    }
    root = home(files)
    pack(EventFolder(root, "train"), tmp_path / "a.nvs")
    for split in ("train", "test"):
        check_same(EventFolder(root, split), EventFolder(tmp_path / "a.nvs", split))


@pytest.fixture
def digits(home):
    return home(trees.nmnist())


def test_what_is_left_out_is_reported(digits, tmp_path):
    (digits / "Train/0/00001.bin").write_bytes(b"abcdefg")
    (digits / "Train/1/00001.bin").write_bytes(b"")
    report = pack(NMNIST(digits, "all"), tmp_path / "a.nvs")
    assert report.packed == 48
    assert report.skipped["Train/1/00001.bin"] == "no events"
    assert "truncated" in report.skipped["Train/0/00001.bin"]
    assert len(NMNIST(tmp_path / "a.nvs")) == 28


@pytest.mark.parametrize("torn", [False, True])
def test_a_stopped_run_goes_on(digits, tmp_path, monkeypatch, torn):
    pack(NMNIST(digits, "all"), tmp_path / "whole.nvs")
    decode, seen = packing._decode, []

    def stops(*given):
        if len(seen) == 17:
            raise KeyboardInterrupt
        seen.append(given[-1])
        return decode(*given)

    monkeypatch.setattr(packing, "_decode", stops)
    with pytest.raises(KeyboardInterrupt):
        pack(NMNIST(digits, "all"), tmp_path / "a.nvs")
    assert not (tmp_path / "a.nvs").exists()
    if torn:
        with (tmp_path / ".a.nvs.part" / "journal.jsonl").open("a") as journal:
            journal.write('{"name": "Tra')
        with (tmp_path / ".a.nvs.part" / "data").open("ab") as records:
            records.write(b"123")
    monkeypatch.setattr(packing, "_decode", lambda *given: seen.append(given[-1]) or decode(*given))
    pack(NMNIST(digits, "all"), tmp_path / "a.nvs")
    assert len(seen) == 50
    check_same(NMNIST(tmp_path / "whole.nvs"), NMNIST(tmp_path / "a.nvs"))


def test_what_was_left_out_is_tried_again_after_a_stop(digits, tmp_path, monkeypatch):
    broken = digits / "Test/0/00001.bin"
    sound = broken.read_bytes()
    broken.write_bytes(b"abc")

    def stops(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(writing, "_finish", stops)
        with pytest.raises(KeyboardInterrupt):
            pack(NMNIST(digits, "all"), tmp_path / "a.nvs")
    broken.write_bytes(sound)
    assert pack(NMNIST(digits, "all"), tmp_path / "a.nvs").skipped == {}
    check_same(NMNIST(digits, "test"), NMNIST(tmp_path / "a.nvs", "test"))


def test_several_jobs_write_the_same(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "one.nvs")
    pack(NMNIST(digits, "all"), tmp_path / "two.nvs", jobs=2)
    assert (tmp_path / "one.nvs").read_bytes() == (tmp_path / "two.nvs").read_bytes()
    check_same(NMNIST(tmp_path / "one.nvs", "all"), NMNIST(tmp_path / "two.nvs", "all"))


def test_recordings_longer_than_32_bits(tmp_path):
    (tmp_path / "data" / "a").mkdir(parents=True)
    ev = nvsdata.Events([2**61, 2**61 + 2**33, 2**61 + 2**40], [1, 2, 3], [1, 2, 3], [0, 1, 0])
    nvsdata.write(ev, tmp_path / "data" / "a" / "1.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs")
    recording = EventFolder(tmp_path / "a.nvs").recording(0)
    assert recording.read() == ev
    assert recording.read(2**61 + 1, 2**61 + 2**40).t.tolist() == [2**61 + 2**33]
    assert len(recording.read(0, 5)) == 0
    assert recording.read(5) == ev


def test_workers_of_either_kind_read_the_same(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "a.nvs")
    dataset = NMNIST(tmp_path / "a.nvs", transform=T.Compose([T.Window(0, 50_000), T.RadiusGraph()]))
    expected = [dataset[i][0].num_nodes for i in range(len(dataset))]
    for context, workers in (("fork", 2), ("spawn", 1)):
        if context not in multiprocessing.get_all_start_methods():
            continue
        loader = DataLoader(
            dataset, 4, num_workers=workers, collate_fn=nvsdata.collate, multiprocessing_context=context
        )
        counts = [int(n) for batch, _ in loader for n in batch.ptr.diff()]
        assert counts == expected
    assert len(pickle.dumps(dataset.source)) < 500


@pytest.fixture
def store(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "a.nvs")
    return tmp_path / "a.nvs"


@pytest.mark.parametrize("keep", [0, 7, 8, 63, 64, 65, 2_000, -1_000, -1])
def test_a_store_cut_short_is_refused(store, keep):
    raw = store.read_bytes()
    store.write_bytes(raw[:keep])
    with pytest.raises(FormatError, match=r"a\.nvs"):
        NMNIST(store)


def test_a_small_store_cut_anywhere_is_refused(tmp_path):
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(trees.some(1, 20)), "list.txt": b"one"})
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs")
    raw = (tmp_path / "a.nvs").read_bytes()
    for keep in range(len(raw)):
        (tmp_path / "a.nvs").write_bytes(raw[:keep])
        with pytest.raises(FormatError, match=r"a\.nvs: "):
            open_store(tmp_path / "a.nvs")
    # bytes behind the index belong to nothing
    (tmp_path / "a.nvs").write_bytes(raw + b"more")
    with pytest.raises(FormatError, match="is cut short, or has more bytes than it states"):
        open_store(tmp_path / "a.nvs")


def test_newer_versions_and_wrong_checksums_are_refused(store):
    raw = store.read_bytes()
    store.write_bytes(raw[:-1] + bytes([raw[-1] ^ 1]))
    with pytest.raises(FormatError, match=r"a\.nvs: its index fails its checksum: pack it again"):
        NMNIST(store)
    store.write_bytes(raw[:40] + b"1" + raw[41:])
    with pytest.raises(FormatError, match=r"a\.nvs: its first bytes fail their checksum"):
        NMNIST(store)
    store.write_bytes(raw[:8] + struct.pack("<I", 9) + raw[12:])
    with pytest.raises(FormatError, match=r"a\.nvs: is of version 9, .*: install a newer one"):
        NMNIST(store)


def test_a_store_of_another_dataset_is_named(store):
    with pytest.raises(ValueError, match="contains n-mnist, not asl-dvs"):
        ASLDVS(store)


def test_a_store_of_one_split_has_no_other(digits, tmp_path):
    pack(NMNIST(digits, "test"), tmp_path / "a.nvs")
    check_same(NMNIST(digits, "test"), NMNIST(tmp_path / "a.nvs", "test"))
    with pytest.raises(ValueError, match="was packed from split 'test'"):
        NMNIST(tmp_path / "a.nvs", "train")


def test_damaged_events_show_in_their_checksum(store):
    names = Store(store).names
    assert not any(Store(store).fault(name) for name in names)
    at = storefiles.block_places(store, 0)[0] + 5
    with store.open("r+b") as file:
        file.seek(at)
        byte = file.read(1)[0]
        file.seek(at)
        file.write(bytes([byte ^ 1]))
    opened = Store(store)
    assert [name for name in names if opened.fault(name)] == names[:1]
    assert "its events fail their checksum" in opened.fault(names[0])


@pytest.mark.parametrize("raw", [b"", b"NVSSTOR", b"some words", b"NVSSTOR3" + bytes(100), bytes(1_000)])
def test_a_file_that_is_no_store_is_refused(tmp_path, raw):
    (tmp_path / "a.nvs").write_bytes(raw)
    with pytest.raises(FormatError, match=r"a\.nvs: not a packed store, or damaged"):
        NMNIST(tmp_path / "a.nvs")


def test_a_recording_is_no_store(tmp_path):
    nvsdata.write(nvsdata.Events([1], [1], [1], [1]), tmp_path / "a.h5")
    with pytest.raises(FormatError, match="neither a folder nor a packed store"):
        NMNIST(tmp_path / "a.h5")


@pytest.mark.parametrize("name", ["a.nvs", "a.h5", "a"])
def test_a_store_is_no_recording(store, name):
    store.rename(store.with_name(name))
    with pytest.raises(FormatError, match="a packed store of many recordings"):
        nvsdata.open(store.with_name(name))


def test_frames_and_inertial_samples_are_not_in_a_store(store):
    recording = NMNIST(store).recording(0)
    with pytest.raises(FormatError, match=r"a\.nvs:Train/.*only events, no frames"):
        recording.frames()
    with pytest.raises(FormatError, match="only events, no inertial samples"):
        recording.inertial()


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("most", [1, 7, 60, 1 << 16])
def test_random_windows_are_those_of_the_events(digits, tmp_path, monkeypatch, compress, most):
    monkeypatch.setattr(record, "MOST_EVENTS", most)
    pack(NMNIST(digits, "test"), tmp_path / "a.nvs", compress=compress)
    folder, store = NMNIST(digits, "test"), NMNIST(tmp_path / "a.nvs", "test")
    rng = np.random.default_rng(0)
    for number in range(0, len(folder), 3):
        whole, recording = folder[number][0], store.recording(number)
        for start, stop in [(0, 10**9), (-5, 0), (10**9, 10**10), *np.sort(rng.integers(0, 310_000, (5, 2))).tolist()]:
            found, expected = recording.read(start, stop), whole.window(start, stop)
            assert found == expected
            assert [column.dtype for column in found.columns] == [column.dtype for column in expected.columns]


@pytest.mark.parametrize("compress", [False, True])
def test_a_store_that_is_cut_short_while_it_is_open(digits, tmp_path, compress):
    pack(NMNIST(digits, "all"), tmp_path / "a.nvs", compress=compress)
    opened = Store(tmp_path / "a.nvs")
    names = opened.names
    begin = storefiles.block_places(tmp_path / "a.nvs", 10)[0]
    next_one, last = (storefiles.head_at(tmp_path / "a.nvs", number)[0] for number in (11, len(names) - 1))
    os.truncate(tmp_path / "a.nvs", begin + 8)
    assert len(opened.open(names[9], None).read())
    for name, at in {names[10]: begin + 8, names[11]: next_one, names[-1]: last}.items():
        with pytest.raises(FormatError, match=rf"a\.nvs: byte {at}: truncated while it was read"):
            opened.open(name, None).read()
        assert "truncated while it was read" in opened.fault(name)


@pytest.mark.skipif(os.name == "nt", reason="an open file can't be renamed there")
def test_a_store_that_is_open_outlives_its_name(store):
    dataset, expected = NMNIST(store), list(NMNIST(store))
    store.rename(store.with_name("other.nvs"))
    assert list(dataset) == expected


def test_names_of_any_bytes(tmp_path):
    names = ["a\nb/\udcff.bin", "a\nb/\u00e4 \U0001f600.bin", "\udc80/x.bin"]
    files = {name: trees.atis(trees.some(number)) for number, name in enumerate(names)}
    try:
        trees.put(tmp_path / "data", files | {"\udcff.txt": b"one"})
    except OSError:
        pytest.skip("this disk has no names of any bytes")
    folder = EventFolder(tmp_path / "data")
    pack(folder, tmp_path / "a.nvs")
    store = EventFolder(tmp_path / "a.nvs")
    check_same(folder, store)
    assert store.classes == folder.classes
    assert sorted(store.source.names) == sorted(names)
    assert store.source.listing() == folder.source.listing()
    assert store.source.data("\udcff.txt") == b"one"
    for name in names:
        assert store.source.size(name) == len(files[name])


def test_what_was_left_out_can_not_be_opened(tmp_path):
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(trees.some(1)), "a/1.bin": b"abc", "b/2.bin": b""})
    report = pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs")
    store = Store(tmp_path / "a.nvs")
    assert store.left_out == report.skipped
    assert set(store.left_out) == {"a/1.bin", "b/2.bin"}
    assert store.listing() == EventFolder(tmp_path / "data").source.listing()
    with pytest.raises(FormatError, match=r"a\.nvs: a/1\.bin was left out when it was packed: .*truncated"):
        store.open("a/1.bin", None)
    assert len(EventFolder(tmp_path / "a.nvs")) == 1


def test_an_open_store_that_becomes_another_one_returns_nothing_of_it(tmp_path):
    for name, order in (("a", (1, 2)), ("b", (2, 1))):
        files = {f"a/{number}.bin": trees.atis(trees.some(seed, 20)) for number, seed in enumerate(order)}
        pack(EventFolder(trees.put(tmp_path / name, files), sensor_size=(34, 34)), tmp_path / f"{name}.nvs")
    dataset = EventFolder(tmp_path / "a.nvs")
    assert dataset[0][0] == trees.some(1, 20)
    # in place, with records of the same length
    (tmp_path / "a.nvs").write_bytes((tmp_path / "b.nvs").read_bytes())
    for index in range(2):
        with pytest.raises(FormatError, match="has changed since it was opened"):
            dataset[index]
    assert EventFolder(tmp_path / "a.nvs")[0][0] == trees.some(2, 20)


def test_an_open_recording_is_pickled_without_its_bytes(tmp_path):
    files = {"a/0.bin": trees.atis(trees.some(1, 2_000))}
    pack(EventFolder(trees.put(tmp_path / "a", files)), tmp_path / "a.nvs")
    recording = EventFolder(tmp_path / "a.nvs").recording(0)
    sent = pickle.dumps(recording)
    assert len(sent) < 1_000
    assert pickle.loads(sent).read() == recording.read()
