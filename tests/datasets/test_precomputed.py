"""Precomputed samples: those of the dataset, in its order, whoever makes them and however far a run came."""

from __future__ import annotations

import json
import os
import pickle
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import torch
import trees
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import NMNIST, EventFolder, Events, FormatError, Precomputed, precompute
from nvsdata import transforms as T
from nvsdata.cli import main
from nvsdata.datasets import ASLANDVS, decode_sample
from nvsdata.datasets.store import precompute as precomputing
from nvsdata.datasets.store import writing
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.verification import problems


@dataclass(frozen=True)
class Halves:
    """A list of the events of each half."""

    deterministic = True

    def __call__(self, sample):
        events = sample.read()
        return [events[: len(events) // 2], events[len(events) // 2 :]]


PIPELINES = {
    "graph": T.Compose([T.Window(0, 100_000), T.RadiusGraph(radius=20)]),
    "frames": T.ToFrames(5),
    "voxels": T.VoxelGrid(4),
    "events": T.Window(0, 50_000),
    "list": T.Compose([Halves(), T.Each(T.RadiusGraph(radius=20))]),
}


def animals(root, count=5):
    files = {
        f"{name}/{i}.bin": trees.atis(trees.some(i + ord(name[0]))) for name in ("ant", "cat") for i in range(count)
    }
    return trees.put(root, files)


@pytest.fixture
def root(tmp_path):
    return animals(tmp_path / "data")


def same(a, b):
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, Events):
        return a == b and (a.start, a.stated_end) == (b.start, b.stated_end)
    if isinstance(a, torch.Tensor):
        return a.dtype == b.dtype and torch.equal(a, b)
    return all(same(getattr(a, name), getattr(b, name)) for name in ("x", "pos", "t", "edge_index", "edge_attr"))


def check_equal(found, dataset):
    assert len(found) == len(dataset)
    assert (found.classes, found.targets, found.split_hash) == (dataset.classes, dataset.targets, dataset.split_hash)
    for (a, label), (b, expected) in zip(found, dataset, strict=True):
        assert same(a, b)
        assert label == expected


@pytest.mark.parametrize("transform", PIPELINES.values(), ids=PIPELINES)
def test_samples_are_those_of_the_dataset(root, tmp_path, transform):
    dataset = EventFolder(root, transform=transform)
    report = precompute(dataset, tmp_path / "a.nvs")
    assert (report.samples, report.skipped) == (10, {})
    assert report.bytes < (tmp_path / "a.nvs").stat().st_size
    assert report.making > 0 < report.reading
    check_equal(Precomputed(tmp_path / "a.nvs"), dataset)
    assert list(problems(tmp_path / "a.nvs")) == []


def test_the_rest_of_the_pipeline_comes_on_top(root, tmp_path):
    pipeline = T.Compose([T.Compose([T.Window(0, 100_000), T.RadiusGraph(radius=20)]), T.RandomFlip(), T.RandomScale()])
    dataset = EventFolder(root, transform=pipeline, seed=3, target_transform=lambda label: label + 5)
    report = precompute(dataset, tmp_path / "a.nvs")
    assert report.head == T.Compose([T.Window(0, 100_000), T.RadiusGraph(radius=20)])
    found = Precomputed(tmp_path / "a.nvs", report.tail, lambda label: label + 5, seed=3)
    for epoch in (0, 4):
        dataset.set_epoch(epoch)
        found.set_epoch(epoch)
        for i in (0, 7):
            assert same(found[i][0], dataset[i][0])
            assert found[i][1] == dataset[i][1]
    both = Precomputed(tmp_path / "a.nvs", transforms=lambda graph, label: (graph.num_nodes, label))
    assert both[9] == (dataset[9][0].num_nodes, 1)
    assert "RadiusGraph(radius=20" in repr(found)


def test_windows_and_splits_stay_together(root, tmp_path):
    dataset = nvsdata.windows(EventFolder(root, transform=T.VoxelGrid(2)), duration=30_000)
    precompute(dataset, tmp_path / "a.nvs")
    found = Precomputed(tmp_path / "a.nvs")
    check_equal(found, dataset)
    assert found.samples == dataset.samples
    for a, b in zip(found.split(0.6), dataset.split(0.6), strict=True):
        assert a.samples == b.samples
        check_equal(a, b)
    events = nvsdata.windows(EventFolder(root, transform=T.VoxelGrid(2)), events=20)
    precompute(events, tmp_path / "b.nvs")
    assert Precomputed(tmp_path / "b.nvs").samples == events.samples


def test_neighboring_files_of_n_cars_are_held_out_together():
    assert nvsdata.NCARS.in_scenes
    assert not NMNIST.in_scenes


@pytest.mark.parametrize("files", [trees.dvs128gesture, trees.dvs128gesture_preprocessed])
def test_parts_of_trials_have_the_names_of_the_dataset(home, tmp_path, files):
    dataset = nvsdata.DVS128Gesture(home(files()), "all", transform=T.VoxelGrid(2))
    precompute(dataset, tmp_path / "a.nvs")
    found = Precomputed(tmp_path / "a.nvs")
    check_equal(found, dataset)
    assert found.subset([2, 5]).split_hash == dataset.subset([2, 5]).split_hash != dataset.split_hash


def test_workers_read_it_too(root, tmp_path):
    precompute(EventFolder(root, transform=T.VoxelGrid(2)), tmp_path / "a.nvs")
    found = Precomputed(tmp_path / "a.nvs")
    by_workers = list(DataLoader(found, batch_size=None, num_workers=2))
    assert all(same(a, b) and y == z for (a, y), (b, z) in zip(by_workers, found, strict=True))
    assert same(pickle.loads(pickle.dumps(found))[3][0], found[3][0])


@pytest.mark.parametrize("count", [2, 3, 11])
def test_joined_shards_are_the_same_dataset(root, tmp_path, count):
    (root / "ant/3.bin").write_bytes(b"abc")
    dataset = EventFolder(root, transform=PIPELINES["graph"])
    whole = precompute(dataset, tmp_path / "one.nvs")
    reports = [precompute(dataset, tmp_path / "a.nvs", shard=(i, count)) for i in range(count, 0, -1)]
    assert sum(report.samples for report in reports) == whole.samples == 9
    shards = sorted(tmp_path.glob("a-*.nvs"))
    assert nvsdata.join(shards, tmp_path / "a.nvs") == 9
    one, joined = Precomputed(tmp_path / "one.nvs"), Precomputed(tmp_path / "a.nvs")
    assert joined.samples == one.samples
    assert joined.skipped == one.skipped == ["ant/3.bin"]
    check_equal(joined, one)
    with pytest.raises(ValueError, match=f"is shard 1/{count} of a store"):
        Precomputed(shards[0])


@pytest.mark.parametrize("jobs", [2, "cluster"])
def test_the_file_has_the_same_bytes_whoever_makes_samples(root, tmp_path, jobs, request):
    dataset = EventFolder(root, transform=PIPELINES["graph"])
    precompute(dataset, tmp_path / "one.nvs")
    at = {"scheduler": request.getfixturevalue("cluster").scheduler_address} if jobs == "cluster" else {"jobs": jobs}
    precompute(dataset, tmp_path / "two.nvs", **at)
    assert (tmp_path / "one.nvs").read_bytes() == (tmp_path / "two.nvs").read_bytes()


def made_by(dataset, out, monkeypatch, stop=None):
    """Precompute; return the names of the samples that are made."""
    made, names = precomputing._made, []

    def noted(small, head, sample):
        if len(names) == stop:
            raise KeyboardInterrupt
        names.append(sample.name)
        return made(small, head, sample)

    with monkeypatch.context() as patch:
        patch.setattr(precomputing, "_made", noted)
        if stop is None:
            precompute(dataset, out)
        else:
            with pytest.raises(KeyboardInterrupt):
                precompute(dataset, out)
    return names


def test_an_interrupted_run_resumes(root, tmp_path, monkeypatch, capsys):
    for path in root.rglob("*.bin"):
        os.utime(path, ns=(10**18, 10**18))
    dataset, out = EventFolder(root, transform=T.VoxelGrid(3)), tmp_path / "a.nvs"
    precompute(dataset, tmp_path / "one.nvs")
    names = made_by(dataset, out, monkeypatch, stop=6)
    assert "6 of 10 records are in" in capsys.readouterr().err
    assert not out.exists()
    assert made_by(dataset, out, monkeypatch, stop=2) == ["cat/1.bin", "cat/2.bin"]
    # a record that was damaged meanwhile, and the ones after it, are made again
    with (tmp_path / ".a.nvs.part/data").open("r+b") as file:
        file.seek(-12, 2)
        file.write(b"\xff\x00\xff")
    assert made_by(dataset, out, monkeypatch) == ["cat/2.bin", "cat/3.bin", "cat/4.bin"]
    assert out.read_bytes() == (tmp_path / "one.nvs").read_bytes()
    assert names == [sample.name for sample in dataset.samples][:6]
    # other settings begin from scratch
    made_by(dataset, tmp_path / "b.nvs", monkeypatch, stop=6)
    assert len(made_by(EventFolder(root, transform=T.VoxelGrid(4)), tmp_path / "b.nvs", monkeypatch)) == 10


def digits(tmp_path, **options):
    files = {f"Train/{digit}/{digit:05d}.bin": trees.atis(trees.some(digit, 100)) for digit in range(6)}
    return NMNIST(trees.put(tmp_path / "digits", files), "all", transform=T.VoxelGrid(3), **options)


@pytest.mark.parametrize("options", [{"stabilized": True}, {"first_saccade": True}, {"errors": "repair"}])
def test_a_run_with_other_options_of_the_dataset_begins_anew(tmp_path, monkeypatch, options):
    out = tmp_path / "a.nvs"
    plain, other = digits(tmp_path), digits(tmp_path, **options)
    made_by(plain, out, monkeypatch, stop=3)
    assert len(made_by(other, out, monkeypatch)) == 6
    check_equal(Precomputed(out), other)
    for i, dataset in enumerate((plain, other), 1):
        precompute(dataset, out, shard=(i, 2))
    with pytest.raises(ValueError, match="of different datasets or runs"):
        nvsdata.join(sorted(tmp_path.glob("a-*.nvs")), tmp_path / "b.nvs")


def test_functions_that_processes_do_not_call_are_not_sent_to_them(root, tmp_path):
    pipeline = T.Compose([T.VoxelGrid(3), lambda sample: sample + 1])
    dataset = EventFolder(root, transform=pipeline, target_transform=lambda label: label + 1)
    assert precompute(dataset, tmp_path / "a.nvs", jobs=2).samples == 10
    assert Precomputed(tmp_path / "a.nvs").targets == dataset.targets


def test_samples_that_cannot_be_made_are_left_out(root, tmp_path, capsys):
    (root / "ant/1.bin").write_bytes(b"abc")
    dataset = EventFolder(root, transform=T.VoxelGrid(3))
    report = precompute(dataset, tmp_path / "a.nvs")
    assert list(report.skipped) == ["ant/1.bin"]
    assert "truncated" in report.skipped["ant/1.bin"]
    found = Precomputed(tmp_path / "a.nvs")
    assert found.skipped == ["ant/1.bin"]
    assert [sample.name for sample in found.samples] == [s.name for s in dataset.samples if s.name != "ant/1.bin"]
    assert list(problems(tmp_path / "a.nvs")) == [
        ("ant/1.bin", f"left out when it was packed: {report.skipped['ant/1.bin']}")
    ]
    with pytest.raises(ValueError, match="nothing to write"):
        precompute(dataset.subset([1]), tmp_path / "b.nvs")


def test_what_cannot_be_precomputed(root, tmp_path):
    out = tmp_path / "a.nvs"
    with pytest.raises(ValueError, match="the pipeline is empty"):
        precompute(EventFolder(root), out)
    with pytest.raises(ValueError, match=r"begins with RandomFlip.*isn't deterministic"):
        precompute(EventFolder(root, transform=T.Compose([T.RandomFlip(), T.VoxelGrid(2)])), out)
    with pytest.raises(ValueError, match="has `transforms`"):
        precompute(EventFolder(root, transforms=lambda *both: both), out)
    pairs = ASLANDVS.__new__(ASLANDVS)
    pairs.transform, pairs.transforms, pairs.samples = T.VoxelGrid(2), None, [("a", "b")]
    with pytest.raises(TypeError, match=r"pairs of recordings: use nvsdata\.cache"):
        precompute(pairs, out)

    with pytest.raises(ValueError, match=r"ant/1\.bin is a sample 2 times"):
        precompute(EventFolder(root, transform=T.VoxelGrid(2)).subset([0, 1, 1]), out)
    boxed = EventFolder(root, transform=T.VoxelGrid(2))
    boxed.boxes = True  # as of NCaltech101
    with pytest.raises(TypeError, match=r"are boxes: use nvsdata\.cache"):
        precompute(boxed, out)

    class Odd:
        deterministic = True

        def __call__(self, sample):
            return {1, 2}

        def __repr__(self):
            return "Odd()"

    with pytest.raises(TypeError, match=r"not builtins\.set"):
        precompute(EventFolder(root, transform=Odd()), out)
    assert not out.exists()
    precompute(EventFolder(root, transform=T.VoxelGrid(2)), out)
    with pytest.raises(FileExistsError):
        precompute(EventFolder(root, transform=T.VoxelGrid(2)), out)


def test_each_kind_of_file_is_opened_by_its_class(root, tmp_path):
    nvsdata.pack(EventFolder(root), tmp_path / "events.nvs")
    precompute(EventFolder(root, transform=T.VoxelGrid(2)), tmp_path / "samples.nvs")
    with pytest.raises(ValueError, match=r"has precomputed samples: open it with nvsdata\.Precomputed"):
        EventFolder(tmp_path / "samples.nvs")
    with pytest.raises(ValueError, match="has recordings, not precomputed samples"):
        Precomputed(tmp_path / "events.nvs")
    with pytest.raises(FileNotFoundError, match="`nvsdata precompute` makes one"):
        Precomputed(tmp_path / "nowhere.nvs")
    with pytest.raises(TypeError, match="no recordings"):
        Precomputed(tmp_path / "samples.nvs").recording(0)
    with pytest.raises(TypeError, match="other windows or precomputed samples"):
        nvsdata.windows(Precomputed(tmp_path / "samples.nvs"), 100)
    with pytest.raises(TypeError, match="recordings are packed, not precomputed samples"):
        nvsdata.pack(Precomputed(tmp_path / "samples.nvs"), tmp_path / "again.nvs")
    for kind in ("pack", "precompute"):
        dataset = EventFolder(root, transform=T.VoxelGrid(2))
        for i in (1, 2):
            (nvsdata.pack if kind == "pack" else precompute)(dataset, tmp_path / f"{kind}.nvs", shard=(i, 2))
    with pytest.raises(ValueError, match="of different datasets or runs"):
        nvsdata.join([tmp_path / "pack-1-of-2.nvs", tmp_path / "precompute-2-of-2.nvs"], tmp_path / "a.nvs")


def test_every_flipped_byte_of_a_record_is_noticed(root, tmp_path):
    path = tmp_path / "a.nvs"
    precompute(EventFolder(root, transform=PIPELINES["graph"]), path)
    store, raw = Store(path), path.read_bytes()
    begin, end = store._place[2:4]
    expected, stored = Precomputed(path)[2][0], int.from_bytes(raw[begin + 4 : begin + 8], "little")
    assert stored > 100
    rng = np.random.default_rng(0)
    for at in range(begin, end):
        path.write_bytes(raw[:at] + bytes([raw[at] ^ int(rng.integers(1, 256))]) + raw[at + 1 :])
        found = Precomputed(path)
        if at < begin + 16 + stored:
            with pytest.raises(FormatError, match=r"a\.nvs:ant/2\.bin"):
                found[2]
        else:
            # bytes that fill the record up to a multiple of 8 aren't read
            assert same(found[2][0], expected)
    path.write_bytes(raw[: begin + 20] + b"\0\0\0\0" + raw[begin + 24 :])
    name = store.names[2]
    assert [found for found, _ in problems(path)] == [name]
    found = Precomputed(path, errors="skip")
    assert same(found[2][0], found[3][0])
    assert list(found.damaged()) == [name]


@pytest.mark.parametrize(
    "change",
    [
        {"label": []},
        {"label": [9] * 10},
        {"position": [0]},
        {"position": [0] * 10},
        {"part": ["x"] * 10},
        {"part": ["bin"] * 10},
        *(
            {"part": [part] * 10, "name": [f"{number}{part}" for number in range(10)]}
            for part in (" 0-" + "9" * 5_000, " 0-٣", " 00-3", " -0-3", " 0-3 ", " 1+2 0-3")
        ),
        {"precomputed": None},
        {"precomputed": {"transform": "a"}},
        {"precomputed": {"transform": "a", "classes": [1, 2]}},
    ],
)
def test_indices_that_contradict_themselves(root, tmp_path, change):
    import storefiles

    from nvsdata.datasets.store import index
    from nvsdata.datasets.store.opened import opened_index

    path = tmp_path / "a.nvs"
    precompute(EventFolder(root, transform=T.VoxelGrid(2)), path)
    file, found = opened_index(path)
    file.close()
    facts = {"dataset": "folder", "split": "all", "fold": 0, "precomputed": found["precomputed"]._asdict()}
    facts |= {name: value for name, value in change.items() if name == "precomputed"}
    sections = {name: found[name] for name in index.SECTIONS[1:]} | change
    sections.pop("precomputed", None)
    storefiles.put_index(path, index.packed_index(facts, **sections))
    with pytest.raises(FormatError, match="impossible samples"):
        Precomputed(path)
    facts["precomputed"] = {"transform": "\x1b[31mred\n", "classes": ["ant", "cat"]}
    sections = {name: found[name] for name in index.SECTIONS[1:]}
    storefiles.put_index(path, index.packed_index(facts, **sections))
    assert "\x1b" not in repr(Precomputed(path))


def test_the_command(root, tmp_path, capsys):
    out = tmp_path / "a.nvs"
    words = ["precompute", str(root), "--dataset", "folder", "--out", str(out), "--transform"]
    assert main([*words, "Compose([RadiusGraph(radius=20.0), RandomFlip()])"]) == 0
    output = capsys.readouterr()
    assert output.out.startswith("10 samples, ")
    assert "the rest of the pipeline is for Precomputed(..., transform=Compose([RandomFlip(" in output.err
    assert "making a sample takes " in output.err
    check_equal(Precomputed(out), EventFolder(root, transform=T.RadiusGraph(radius=20.0)))
    assert main([*words, "RadiusGraph()"]) == 1
    assert "--overwrite" in capsys.readouterr().err
    for text in ("nothing", "RadiusGraph(radius=-1)", "RadiusGraph(no=1)", "__import__('os')"):
        with pytest.raises(SystemExit):
            main([*words, text, "--overwrite"])
        assert "nvsdata precompute: " in capsys.readouterr().err
    (root / "ant/1.bin").write_bytes(b"abc")
    assert main([*words, "VoxelGrid(2)", "--overwrite", "--json"]) == 1
    output = capsys.readouterr()
    assert json.loads(output.out)["samples"] == 9
    assert "left out ant/1.bin: " in output.err


def test_a_full_disk_leaves_no_file(root, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing, "_finish", full)
    with pytest.raises(OSError, match="No space left"):
        precompute(EventFolder(root, transform=T.VoxelGrid(2)), tmp_path / "a.nvs")
    assert not (tmp_path / "a.nvs").exists()
    monkeypatch.undo()
    assert precompute(EventFolder(root, transform=T.VoxelGrid(2)), tmp_path / "a.nvs").samples == 10


def test_webdataset_gets_the_same_samples(root, tmp_path, capsys):
    webdataset = pytest.importorskip("webdataset")
    words = ["precompute", str(root), "--dataset", "folder", "--out", str(tmp_path / "a.nvs"), "--to", "webdataset"]
    assert main([*words, "--transform", "RadiusGraph(radius=20.0)"]) == 0
    found = Precomputed(tmp_path / "a.nvs")
    shards = sorted(map(str, (tmp_path / "a-webdataset").glob("*.tar")))
    read = webdataset.WebDataset(shards, shardshuffle=False).to_tuple("nvs", "cls").map_tuple(decode_sample, int)
    read = list(read)
    assert len(read) == 10
    assert all(same(a, b) and y == z for (a, y), (b, z) in zip(read, found, strict=True))
    with pytest.raises(FileExistsError):
        found.hand_over("webdataset", tmp_path / "a-webdataset")
    found.hand_over("webdataset", tmp_path / "a-webdataset", overwrite=True)
    assert sorted(map(str, (tmp_path / "a-webdataset").glob("*.tar"))) == shards
    assert not list(tmp_path.glob(".*.part"))
    with pytest.raises(SystemExit):
        main([*words, "--transform", "VoxelGrid(2)", "--overwrite", "--shard", "1/2"])


def test_litdata_gets_the_same_samples(root, tmp_path):
    litdata = pytest.importorskip("litdata")
    precompute(EventFolder(root, transform=PIPELINES["graph"]), tmp_path / "a.nvs")
    found = Precomputed(tmp_path / "a.nvs")
    found.hand_over("litdata", tmp_path / "b")
    read = litdata.StreamingDataset(str(tmp_path / "b"))
    assert len(read) == 10
    for number, (graph, label) in enumerate(found):
        assert same(decode_sample(read[number]["sample"]), graph)
        assert read[number]["label"] == label


def test_engines_that_are_unknown_or_missing(root, tmp_path, monkeypatch):
    precompute(EventFolder(root, transform=T.VoxelGrid(2)), tmp_path / "a.nvs")
    found = Precomputed(tmp_path / "a.nvs")
    with pytest.raises(ValueError, match="engine must be 'webdataset', 'litdata', not 'other'"):
        found.hand_over("other", tmp_path / "b")
    monkeypatch.setitem(sys.modules, "litdata", None)
    with pytest.raises(ImportError, match=r"pip install 'nvsdata\[litdata\]'"):
        found.hand_over("litdata", tmp_path / "b")
    assert not (tmp_path / "b").exists()
