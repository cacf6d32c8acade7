"""Folders of classes, whatever they are called and however deep they lie."""

from __future__ import annotations

import sys

import pytest
import trees

import nvsdata
from nvsdata import EventFolder, Events
from nvsdata.datasets.store.writer import pack
from nvsdata.datasets.ucf import UCF101DVS
from nvsdata.datasets.yupenndvs import YUPENNDVS

ONE = trees.atis(trees.some(1))


def labels(dataset):
    return [(sample.name, dataset.classes[sample.label]) for sample in dataset.samples]


def test_the_topmost_folder_is_the_class(tmp_path):
    trees.put(
        tmp_path, {"ant/train/y/1.bin": ONE, "ant/2.bin": ONE, "bee/1.bin": ONE, "top.bin": ONE, "empty/x/notes": b""}
    )
    both = EventFolder(tmp_path)
    assert both.classes == ["ant", "bee", "empty"]
    assert labels(both) == [("ant/2.bin", "ant"), ("ant/train/y/1.bin", "ant"), ("bee/1.bin", "bee")]
    assert sorted(both.recording_names()) == ["ant/2.bin", "ant/train/y/1.bin", "bee/1.bin"]


def test_parts_in_capitals_and_a_part_that_is_a_class(tmp_path):
    root = trees.put(tmp_path / "a", {"TRAIN/ant/x/1.bin": ONE, "Test/bee/1.bin": ONE, "notes/x.md": b""})
    assert labels(EventFolder(root, "train")) == [("TRAIN/ant/x/1.bin", "ant")]
    assert labels(EventFolder(root, "test")) == [("Test/bee/1.bin", "bee")]
    assert labels(EventFolder(root)) == [("TRAIN/ant/x/1.bin", "ant"), ("Test/bee/1.bin", "bee")]
    assert EventFolder(root, "train").classes == ["ant", "bee"]
    root = trees.put(tmp_path / "b", {"train/1.bin": ONE, "train/x/2.bin": ONE, "test/bee/1.bin": ONE})
    assert labels(EventFolder(root, "test")) == [("test/bee/1.bin", "bee")]
    with pytest.raises(FileNotFoundError, match=r"train is not a folder; split='train' needs it"):
        EventFolder(root, "train")


def test_parts_beside_classes_are_told(tmp_path):
    trees.put(tmp_path, {f"{name}/1.bin": ONE for name in ("train/a", "dee", "cee", "bee", "eff", "ant")})
    with pytest.raises(
        ValueError, match=r"has train, and class folders \(ant, bee, cee\): say split='train' or 'test'"
    ):
        EventFolder(tmp_path)


def test_the_size_is_that_of_the_first_recording(tmp_path):
    for number, size in enumerate(((20, 10), (30, 40))):
        (tmp_path / "a").mkdir(exist_ok=True)
        nvsdata.write(Events([1], [1], [1], [1], size), tmp_path / f"a/{number}.h5")
    for errors in ("raise", "skip"):
        assert EventFolder(tmp_path, errors=errors).sensor_size == (20, 10)
    given = EventFolder(tmp_path, sensor_size=(50, 60))
    assert given.sensor_size == given[0][0].sensor_size == given[1][0].sensor_size == (50, 60)
    assert [EventFolder(tmp_path)[i][0].sensor_size for i in (0, 1)] == [(20, 10), (30, 40)]
    assert EventFolder(tmp_path)[1:].sensor_size == (30, 40)


def test_what_is_told_of_a_folder(tmp_path):
    trees.put(tmp_path, {f"{name}/{i}.bin": ONE for name in ("ant", "bee") for i in range(2)})
    dataset = EventFolder(tmp_path)
    lines = ["EventFolder: 4 recordings, 2 classes", f"root: {tmp_path}", f"split: all, hash {dataset.split_hash}"]
    lines += ["sensor: as each recording states", f"sample: {dataset[0][0]}"]
    assert repr(dataset).split("\n    ") == lines
    cut = nvsdata.windows(dataset, 10**7).subset([0, 0, 1])
    assert repr(cut).startswith("EventFolder: 3 samples of 2 recordings, 2 classes\n")


def test_a_fold_is_told(home):
    dataset = YUPENNDVS(home(trees.yupenndvs()), fold=5)
    assert repr(dataset).splitlines()[2].strip() == f"split: train, fold 5, hash {dataset.split_hash}"


def test_what_a_store_leaves_out_is_skipped_once(home, tmp_path):
    root = home(trees.ucf101dvs())
    pack(UCF101DVS(root, "all"), tmp_path / "a.h5")
    assert UCF101DVS(tmp_path / "a.h5").skipped == UCF101DVS(root).skipped == ["Billards/v_Billiards_g08_c02.mat"]
    assert "left out: 1" in repr(UCF101DVS(tmp_path / "a.h5"))
    with pytest.raises(ValueError, match=f"{tmp_path / 'a.h5'} contains ucf101-dvs, not folder"):
        EventFolder(tmp_path / "a.h5")


def test_a_missing_package_is_told_when_a_folder_is_listed(tmp_path, monkeypatch):
    pytest.importorskip("lz4")
    trees.put(tmp_path, {"ant/0.bin": ONE})
    nvsdata.write(nvsdata.example(), tmp_path / "ant/1.aedat4")
    for name in ("lz4", "lz4.frame", "zstandard"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r"ant/1\.aedat4: AEDAT 4 needs .* pip install 'nvsdata\[aedat4\]'"):
        EventFolder(tmp_path)
    # damage isn't reported here, and what needs no package is read
    (tmp_path / "ant/1.aedat4").write_bytes(b"damaged")
    assert len(EventFolder(tmp_path)) == 2
