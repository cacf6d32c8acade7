import multiprocessing
import pickle
import shutil
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import trees
from distributions import CASES, check_same
from lookalikes import lead_elsewhere
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import EventFolder, FormatError
from nvsdata import transforms as T
from nvsdata.datasets import ASLANDVS, ASLDVS, NMNIST, DVS128Gesture, NCaltech101
from nvsdata.datasets.store import reader
from nvsdata.datasets.store import writer as packing
from nvsdata.datasets.store.reader import INDEX, Store, checksum
from nvsdata.datasets.store.writer import pack


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("compress", [False, True])
def test_a_store_gives_what_the_folder_gives(home, tmp_path, name, compress):
    files, kind, *_ = CASES[name]
    root = home(files())
    report = pack(kind(root, "all"), tmp_path / "a.h5", compress=compress)
    assert report.packed == len(set(kind(root, "all").recording_names()))
    assert not (tmp_path / ".a.h5.part").exists()
    for split in ("train", "test"):
        folder, store = kind(root, split), kind(tmp_path / "a.h5", split)
        check_same(folder, store)
        window = T.Window(10_000, 60_000)
        for i in range(len(folder)):
            assert window(folder.recording(i)) == window(store.recording(i))
            assert folder.recording(i).span == store.recording(i).span


def test_side_files_travel_along(home, tmp_path):
    root = home(trees.ncaltech101())
    pack(NCaltech101(root, "all"), tmp_path / "a.h5")
    folder, store = NCaltech101(root), NCaltech101(tmp_path / "a.h5")
    assert [folder.box(i) for i in range(len(folder))] == [store.box(i) for i in range(len(store))]
    root = home(trees.dvs128gesture())
    shutil.rmtree(root / "Caltech101", ignore_errors=True)
    pack(DVS128Gesture(root, "all"), tmp_path / "g.h5")
    assert DVS128Gesture(tmp_path / "g.h5", "test").users == DVS128Gesture(root, "test").users


def test_pairs_from_a_store(home, tmp_path):
    root = home(trees.aslandvs(True))
    pack(ASLANDVS(root, "all"), tmp_path / "a.h5")
    folder, store = ASLANDVS(root, "test"), ASLANDVS(tmp_path / "a.h5", "test")
    assert [folder[i] for i in range(len(folder))] == [store[i] for i in range(len(store))]


def test_a_folder_with_splits_of_its_own(home, tmp_path):
    files = {
        f"{split}/{name}/{i}.bin": trees.atis(trees.some(i))
        for split in ("train", "test")
        for name in "ab"
        for i in range(3)
    }
    root = home(files)
    pack(EventFolder(root, "train"), tmp_path / "a.h5")
    for split in ("train", "test"):
        check_same(EventFolder(root, split), EventFolder(tmp_path / "a.h5", split))


@pytest.fixture
def digits(home):
    return home(trees.nmnist())


def test_what_is_left_out_is_reported(digits, tmp_path):
    (digits / "Train/0/00001.bin").write_bytes(b"abcdefg")
    (digits / "Train/1/00001.bin").write_bytes(b"")
    report = pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert report.packed == 48
    assert report.skipped["Train/1/00001.bin"] == "no events"
    assert "truncated" in report.skipped["Train/0/00001.bin"]
    assert len(NMNIST(tmp_path / "a.h5")) == 28


@pytest.mark.parametrize("torn", [False, True])
def test_a_stopped_run_goes_on(digits, tmp_path, monkeypatch, torn):
    pack(NMNIST(digits, "all"), tmp_path / "whole.h5")
    decode, seen = packing._decode, []

    def stops(source, name, size):
        if len(seen) == 17:
            raise KeyboardInterrupt
        seen.append(name)
        return decode(source, name, size)

    monkeypatch.setattr(packing, "_decode", stops)
    with pytest.raises(KeyboardInterrupt):
        pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()
    if torn:
        with (tmp_path / ".a.h5.part" / "journal.jsonl").open("a") as journal:
            journal.write('{"name": "Tra')
        with (tmp_path / ".a.h5.part" / "x").open("ab") as column:
            column.write(b"123")
    monkeypatch.setattr(packing, "_decode", lambda *args: seen.append(args[1]) or decode(*args))
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    assert len(seen) == 50
    check_same(NMNIST(tmp_path / "whole.h5"), NMNIST(tmp_path / "a.h5"))


def test_what_was_left_out_is_tried_again_after_a_stop(digits, tmp_path, monkeypatch):
    broken = digits / "Test/0/00001.bin"
    sound = broken.read_bytes()
    broken.write_bytes(b"abc")

    def stops(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(packing, "_assemble", stops)
        with pytest.raises(KeyboardInterrupt):
            pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    broken.write_bytes(sound)
    assert pack(NMNIST(digits, "all"), tmp_path / "a.h5").skipped == {}
    check_same(NMNIST(digits, "test"), NMNIST(tmp_path / "a.h5", "test"))


def test_several_jobs_write_the_same(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "one.h5")
    pack(NMNIST(digits, "all"), tmp_path / "two.h5", jobs=2)
    check_same(NMNIST(tmp_path / "one.h5", "all"), NMNIST(tmp_path / "two.h5", "all"))


def test_recordings_longer_than_32_bits(tmp_path):
    (tmp_path / "data" / "a").mkdir(parents=True)
    ev = nvsdata.Events([2**61, 2**61 + 2**33, 2**61 + 2**40], [1, 2, 3], [1, 2, 3], [0, 1, 0])
    nvsdata.write(ev, tmp_path / "data" / "a" / "1.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.h5")
    recording = EventFolder(tmp_path / "a.h5").recording(0)
    assert recording.read() == ev
    assert recording.read(2**61 + 1, 2**61 + 2**40).t.tolist() == [2**61 + 2**33]
    assert len(recording.read(0, 5)) == 0
    assert recording.read(5) == ev


def test_workers_of_either_kind_read_the_same(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    dataset = NMNIST(tmp_path / "a.h5", transform=T.Compose([T.Window(0, 50_000), T.RadiusGraph()]))
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
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    return tmp_path / "a.h5"


@pytest.mark.parametrize("keep", [0, 100, 2_000, -1_000, -1])
def test_a_store_cut_short_is_refused(store, keep):
    raw = store.read_bytes()
    store.write_bytes(raw[:keep])
    with pytest.raises(FormatError, match=r"a\.h5"):
        NMNIST(store)


def test_newer_versions_wrong_checksums_and_other_datasets_are_refused(store):
    with h5py.File(store, "r+") as file:
        file["index/base"][3] += 1
    with pytest.raises(FormatError, match="fails its checksum"):
        NMNIST(store)
    with h5py.File(store, "r+") as file:
        file.attrs["version"] = 9
    with pytest.raises(FormatError, match="newer"):
        NMNIST(store)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f: f.attrs.pop("version"), "attribute version is None"),
        (lambda f: f.attrs.update(checksum="?"), "attribute checksum is"),
        (lambda f: (f.pop("index/name"), f.create_group("index/name")), "/index/name is not a dataset"),
        (lambda f: f.pop("index/name"), "there is no /index/name"),
        (
            lambda f: (f.pop("index/base"), f.create_dataset("index/base", (10**12,), "i8", chunks=(9,))),
            "0 of 111111111112 pieces of /index/base are there",
        ),
        (
            lambda f: (f.pop("events/x"), f.create_dataset("events/x", (10**12,), "u1", chunks=(9,))),
            "0 of 111111111112 pieces of /events/x are there",
        ),
    ],
)
def test_damage_is_named(store, change, reason):
    with h5py.File(store, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=reason):
        NMNIST(store)


def test_a_store_of_another_dataset_is_named(store):
    with pytest.raises(ValueError, match="contains n-mnist, not asl-dvs"):
        ASLDVS(store)


def test_damaged_events_show_in_their_checksum(store):
    names = Store(store).names
    assert not any(Store(store).fault(name) for name in names)
    with h5py.File(store, "r+") as file:
        file["events/x"][5] ^= 1
    assert [name for name in names if Store(store).fault(name)] == names[:1]


def test_a_file_that_is_no_store_is_refused(tmp_path):
    nvsdata.write(nvsdata.Events([1], [1], [1], [1]), tmp_path / "a.h5")
    with pytest.raises(FormatError, match="neither a folder nor a packed store"):
        NMNIST(tmp_path / "a.h5")


def test_a_store_is_no_recording(store):
    with pytest.raises(FormatError, match="a packed store of many recordings"):
        nvsdata.open(store)


def test_the_smallest_types_that_fit_are_stored(store):
    with h5py.File(store) as file:
        kinds = {name: file[f"events/{name}"].dtype for name in "txyp"}
    assert kinds == {"t": np.uint32, "x": np.uint8, "y": np.uint8, "p": np.uint8}


def test_the_kernel_reads_what_python_reads(store):
    direct, by_python = Store(store), Store(store)
    by_python._direct = ()
    rng = np.random.default_rng(0)
    for number in range(len(direct.names)):
        whole = direct.open(direct.names[number], None).read()
        for start, stop in [(0, 10**9), (-5, 0), (10**9, 10**10), *np.sort(rng.integers(0, 310_000, (5, 2))).tolist()]:
            found = direct.read(number, start, stop)
            expected = whole.window(start, stop)
            for ours, other in zip(found, by_python.read(number, start, stop), strict=True):
                assert ours.dtype == other.dtype
                assert (ours == other).all()
            assert (found.t == expected.t).all()
            assert (found.x == expected.x).all()
            assert (found.y == expected.y).all()
            assert (found.p == expected.p).all()


def test_a_store_that_is_cut_short_while_it_is_open(store):
    opened = Store(store)
    with store.open("r+b") as file:
        file.truncate(opened._places[0][2] + 8)
    with pytest.raises(FormatError, match="truncated while it was read"):
        opened.open(opened.names[-1], None).read()


def _reindexed(store, **changed):
    with h5py.File(store, "r+") as file:
        for name, values in changed.items():
            del file[f"index/{name}"]
            file[f"index/{name}"] = values
        file.attrs["checksum"] = checksum({name: file[f"index/{name}"][()] for name in INDEX})


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("offset", lambda a: a + (np.arange(a.size) == a.size - 1)),
        ("offset", lambda a: np.maximum(a, 1)),
        ("offset", lambda a: a[:0]),
        ("size", lambda a: a * 0),
        ("size", lambda a: a * 2_000),
        ("duration", lambda a: a[1:]),
    ],
)
def test_an_index_that_does_not_fit_its_events_is_refused(store, name, change):
    with h5py.File(store) as file:
        values = file[f"index/{name}"][()]
    _reindexed(store, **{name: change(values)})
    with pytest.raises(FormatError, match="contradicts itself"):
        NMNIST(store)


@pytest.mark.parametrize("name", ["index/base", "events/x"])
@pytest.mark.parametrize("how", ["external link", "virtual", "stored externally"])
def test_a_store_does_not_speak_of_other_files(store, name, how):
    shutil.copy(store, store.with_name("other.h5"))
    with h5py.File(store, "r+") as file:
        shape, kind = file[name].shape, file[name].dtype
        del file[name]
        lead_elsewhere(file, name, how, store.with_name("other.h5"), shape, kind)
    with pytest.raises(FormatError, match=f"{name} is .*{how}.*: other files are read only with NVSDATA_HDF5_LINKS=1"):
        NMNIST(store)


def test_soft_links_within_a_store_are_followed(store):
    expected = [nvsdata.NMNIST(store).recording(i).read() for i in range(3)]
    with h5py.File(store, "r+") as file:
        file.move("events/x", "elsewhere")
        file["events/x"] = h5py.SoftLink("/elsewhere")
    assert [nvsdata.NMNIST(store).recording(i).read() for i in range(3)] == expected


def test_a_column_that_ends_beyond_the_file_is_refused(tmp_path):
    (tmp_path / "a.h5").write_bytes(bytes(100))

    def column(offset, size):
        numbers = SimpleNamespace(size=size, nbytes=4 * size, chunks=None, dtype=np.dtype("i4"), name="/t")
        numbers.id = SimpleNamespace(get_offset=lambda: offset)
        return reader._place(tmp_path / "a.h5", numbers)

    assert column(20, 20) == (np.dtype("i4"), 4, 20)
    with pytest.raises(FormatError, match=r"a\.h5.*byte 24: cut short within /t"):
        column(24, 20)
    # nothing is stored of an empty one
    assert column(None, 0) == (np.dtype("i4"), 4, 0)
    assert column(None, 3) is None
