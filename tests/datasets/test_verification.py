import dataclasses
import json
import shutil
import sys

import pytest
import storefiles
import trees

import nvsdata
from nvsdata import NMNIST, EventFolder
from nvsdata.cli import main
from nvsdata.datasets import ASLDVS, CIFAR10DVS, DATASETS, UCF101DVS, YUPENNDVS, DVS128Gesture
from nvsdata.datasets.facts import ExpectedCount, expected_names
from nvsdata.datasets.registry import dataset_named
from nvsdata.datasets.store.writer import pack
from nvsdata.datasets.verification import Found, missing_recordings, problems
from nvsdata.datasets.yupenndvs import CLASSES


def complete(kind):
    """A name for every recording that a dataset should have."""
    named = [holding for holding in kind.info.expected_counts if holding.label]
    for k, holding in enumerate(named):
        stems = holding.stems or [f"{k}-{i}" for i in range(holding.count)]
        yield from (Found(holding.part, holding.label, stem) for stem in stems)


HELD = [name for name, kind in DATASETS.items() if kind.info.expected_counts and name != "n-mnist"]


@pytest.mark.parametrize("name", HELD)
def test_a_complete_dataset_lacks_nothing_and_one_recording_less_shows(name):
    holds, found = DATASETS[name].info.expected_counts, list(complete(DATASETS[name]))
    assert len(found) == len(set(found)) == DATASETS[name].info.recordings
    assert list(missing_recordings(holds, found)) == []
    gone = found.pop(len(found) // 3)
    ((where, fault),) = missing_recordings(holds, found)
    assert where == "/".join(filter(None, (gone.part, gone.label)))
    assert fault.startswith("1 of ")
    assert not holds[0].stem or fault.endswith(f"recordings are missing: {gone.stem}")


def test_nmnist_is_known_by_counts_and_by_numbers():
    holds = NMNIST.info.expected_counts
    ids = {"train": iter(range(1, 60_001)), "test": iter(range(1, 10_001))}
    found = [
        Found(holding.part, holding.label, f"{next(ids[holding.part]):05d}")
        for holding in holds
        if holding.label
        for _ in range(holding.count)
    ]
    assert len(found) == 70_000
    assert list(missing_recordings(holds, found)) == []
    assert list(missing_recordings(holds, found[1:])) == [
        ("train/0", "1 of 5,923 recordings are missing"),
        ("train", "1 of 60,000 recordings are missing: 00001"),
    ]


def test_too_many_and_strange_ones_are_told_too():
    holds = (expected_names("a", "a_{}", range(3)), ExpectedCount("b", 2))
    found = [Found("", "a", f"a_{i}") for i in range(1, 5)] + [Found("", "b", str(i)) for i in range(3)]
    assert list(missing_recordings(holds, found)) == [
        ("a", "1 of 3 recordings are missing: a_0"),
        ("a", "2 recordings that the dataset doesn't have: a_3, a_4"),
        ("b", "3 recordings, though the dataset has 2"),
    ]
    many = dict(missing_recordings((expected_names("a", "{}", range(100)),), []))
    assert many == {"a": "100 of 100 recordings are missing: 0, 1, 10 and 97 more"}


@pytest.fixture
def scenes(tmp_path):
    """All 420 recordings of YUPENN-DVS."""
    data = trees.atis(trees.some(1, 3))
    return trees.put(tmp_path / "yupenn", {f"{name}/{i}.bin": data for name in CLASSES for i in range(30)})


def test_a_complete_folder_is_sound_and_an_incomplete_one_is_not(scenes, tmp_path, capsys):
    assert main(["verify", str(scenes), "--dataset", "YUPENN-DVS"]) == 0
    (scenes / "ocean/7.bin").unlink()
    assert main(["verify", str(scenes), "--dataset", "yupenn-dvs"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[-6].startswith("yupenn-dvs: 419 recordings, 420 expected (the set of videos; no source describes")
    assert (lines[-5], lines[-1]) == ("ocean: 1 of 30 recordings are missing", "419 recordings opened: 2 faults")
    splits = {name: YUPENNDVS(scenes, name).split_hash for name in YUPENNDVS.splits}
    assert lines[-4:-1] == [f"split {name}: {digest}" for name, digest in splits.items()]
    assert main(["verify", str(scenes), "--dataset", "yupenn-dvs", "--json"]) == 1
    fault, _, summary = map(json.loads, capsys.readouterr().out.splitlines())
    assert fault["name"] == "yupenn-dvs"
    assert summary == {"faults": 2, "splits": splits, "opened": 419, "compared": 0, "guessed": 0}
    # a store knows which dataset it is of
    pack(YUPENNDVS(scenes, "all"), tmp_path / "a.h5")
    assert dict(problems(tmp_path / "a.h5"))["ocean"] == "1 of 30 recordings are missing"


def test_few_of_many_are_not_all_sound(tmp_path):
    root = trees.put(tmp_path, trees.cifar10dvs())
    found = dict(problems(root, dataset_named("CIFAR10DVS")))
    assert found["cifar10-dvs"] == "30 recordings, 10,000 expected (two public programs that read the dataset)"
    assert found["bird"].startswith("1,000 of 1,000 recordings are missing: cifar10_bird_0, cifar10_bird_1, ")
    assert found["dog"].startswith("990 of 1,000 recordings are missing: cifar10_dog_10, ")
    assert len(found) == 11


def test_what_lists_name_is_looked_for(tmp_path):
    root = trees.put(tmp_path / "ucf", trees.ucf101dvs())
    found = dict(problems(root, dataset_named("ucf101-dvs")))
    assert found["Billards/v_Billiards_g08_c02.mat"] == "empty"
    assert not any(name.endswith(".txt") for name in found)
    (root / "Billards/v_Billiards_g07_c01.mat").unlink()
    found = dict(problems(root, dataset_named("ucf101-dvs")))
    assert found["testlist01.txt"] == "1 of 4 recordings that it lists are missing: v_billiards_g07_c01"
    assert "13,523 expected" in found["ucf101-dvs"]
    root = trees.put(tmp_path / "hmdb", trees.hmdb51dvs())
    next(root.glob("wave/April*_5.mat")).unlink()
    found = dict(problems(root, dataset_named("hmdb51-dvs")))
    assert found["wave_test_split1.txt"].endswith("are missing: April_09_wave_#5_(goo)_np1_ba_med_5")
    root = trees.put(tmp_path / "gesture", trees.dvs128gesture())
    (root / "DvsGesture/user24_lab_labels.csv").unlink()
    found = dict(problems(root, dataset_named("dvs128-gesture")))
    assert found["trials_to_test.txt"] == "1 of 2 recordings that it lists are missing: user24_lab"
    assert found["dvs128-gesture"].startswith(
        "36 gestures, 1,464 expected (the rows of the archive's 122 tables; the paper"
    )
    root = trees.put(tmp_path / "cut", trees.dvs128gesture_preprocessed())
    assert dict(problems(root, dataset_named("dvs128-gesture")))["dvs128-gesture"].startswith(
        "33 gestures, 1,341 expected"
    )
    root = trees.put(tmp_path / "aslan", trees.aslandvs(True))
    assert dict(problems(root, dataset_named("aslan-dvs")))["aslan-dvs"].startswith("12 recordings, 3,697 expected")


def test_what_was_left_out_of_a_store_shows(tmp_path):
    root = trees.put(tmp_path / "data", {f"{c}/{i}.bin": trees.atis(trees.some(i)) for c in "ab" for i in range(2)})
    (root / "a/0.bin").write_bytes(b"abc")
    pack(EventFolder(root), tmp_path / "a.h5")
    ((name, fault),) = problems(tmp_path / "a.h5")
    assert name == "a/0.bin"
    assert fault.startswith("left out when it was packed: ")
    assert "truncated" in fault


def test_a_folder_that_begins_with_a_damaged_recording(tmp_path):
    root = trees.put(tmp_path / "data", {"a/0.bin": b"abc", "a/1.bin": trees.atis(trees.some(1)), "a/2.h5": b"junk"})
    assert [name for name, _ in problems(root, dataset_named("folder"))] == ["a/0.bin", "a/0.bin", "a/2.h5"]
    assert pack(EventFolder(root), tmp_path / "a.h5").packed == 1


def test_a_store_of_one_split_is_held_to_nothing_else(tmp_path):
    root = trees.put(tmp_path / "data", trees.cifar10dvs())
    pack(CIFAR10DVS(root, "test", fold=2), tmp_path / "a.h5")
    assert list(problems(tmp_path / "a.h5")) == []


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names must be text there")
def test_names_of_any_bytes(tmp_path, capsys):
    root = trees.put(tmp_path / "data", {"a\nb/1\udcff.bin": b"abc", "a\nb/2.bin": trees.atis(trees.some(1))})
    for options in ([], ["--dataset", "folder"]):
        assert main(["verify", str(root), *options]) == 1
        out = capsys.readouterr().out
        assert r"a\nb/1\udcff.bin: 3 bytes of a torn record, cut off" in out
        # the fault, the empty recording, the note on guessed sensor sizes, splits, and the sum
        assert out.count("\n") == 4 + len(options) // 2


def test_wrong_levels_show_what_was_expected_and_what_is_there(tmp_path):
    root = trees.put(tmp_path / "N-MNIST", trees.nmnist())
    with pytest.raises(FileNotFoundError) as caught:
        NMNIST(root / "Train", "test")
    text = str(caught.value)
    assert "expected there: Train/<digit>/<id>.bin and Test/<digit>/<id>.bin" in text
    assert "found: 0/ (3 .bin), 1/ (3 .bin)" in text
    assert "and 5 more folders" in text
    assert f"the root must be a folder above, such as {root}" in text
    assert "\n" not in text
    with pytest.raises(FileNotFoundError, match=f"such as {root}"):
        NMNIST(root / "Train" / "3")
    trees.put(tmp_path / "asl", {"a/a_0001.mat": b"", "b/b_0001.mat": b""})
    with pytest.raises(FileNotFoundError, match=f"such as {tmp_path / 'asl'}; unpack it manually") as caught:
        ASLDVS(tmp_path / "asl" / "a")
    assert "./ (1 .mat)" in str(caught.value)
    assert "download" not in str(caught.value)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="found: nothing; pass download=True"):
        CIFAR10DVS(tmp_path / "empty")
    with pytest.raises(FileNotFoundError, match=f"such as {root.parent / 'asl'}"):
        EventFolder(tmp_path / "asl" / "a")
    for kind in (UCF101DVS, DVS128Gesture):
        with pytest.raises(FileNotFoundError, match="expected there: "):
            kind(tmp_path / "empty", "all")


def test_nobody_is_told_to_download_what_no_program_can():
    for kind in DATASETS.values():
        with pytest.raises(FileNotFoundError) as caught:
            kind("nowhere-at-all")
        assert ("download=True" in str(caught.value)) == kind.info.by_program


def test_an_event_folder_of_parts_is_what_was_meant(tmp_path):
    root = trees.put(tmp_path / "N-MNIST", trees.nmnist())
    both = EventFolder(root)
    assert both.classes == list("0123456789")
    assert len(both) == 50
    assert (len(EventFolder(root, "train")), len(EventFolder(root, "test"))) == (30, 20)
    trees.put(root, {"notes/read.me": b"", "list.txt": b""})
    assert len(EventFolder(root)) == 50
    trees.put(root, {"others/1.bin": trees.atis(trees.some(1))})
    with pytest.raises(ValueError, match=r"has Test and Train, and class folders \(others\): say split='train'"):
        EventFolder(root)
    # a class may be of trains
    shutil.rmtree(root)
    trees.put(root, {f"{name}/1.bin": trees.atis(trees.some(1)) for name in ("train", "car")})
    assert EventFolder(root).classes == ["car", "train"]


def test_sensors_of_different_sizes_in_one_store(tmp_path):
    (tmp_path / "data/a").mkdir(parents=True)
    events = [nvsdata.Events([1], [x], [5], [1]) for x in (3, 700)]
    for i, ev in enumerate(events):
        nvsdata.write(ev, tmp_path / f"data/a/{i}.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.h5")
    assert [EventFolder(tmp_path / "a.h5")[i][0] for i in range(2)] == events


def test_arguments_out_of_place_are_told(tmp_path):
    root = trees.put(tmp_path / "N-MNIST", trees.nmnist())
    with pytest.raises(TypeError, match="split must be 'train', 'test', 'all'; pass transform=Window"):
        NMNIST(root, nvsdata.transforms.Window(0, 5))
    with pytest.raises(TypeError, match=r"T\.Compose"):
        NMNIST(root, transform=[nvsdata.transforms.Window(0, 5)])


def test_a_home_folder(tmp_path, monkeypatch):
    trees.put(tmp_path / "N-MNIST", trees.nmnist())
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    dataset = NMNIST("~/N-MNIST", "all")
    assert len(dataset) == 50
    pack(dataset, "~/a.h5")
    assert len(NMNIST("~/a.h5")) == 30
    assert nvsdata.cache(dataset, "~/cache").folder.parent == tmp_path / "cache"


def test_datasets_go_by_either_name():
    from nvsdata.datasets import dataset_named

    for name, kind in DATASETS.items():
        for said in (name, name.upper(), kind.__name__, name.replace("-", "_")):
            assert dataset_named(said) is kind
    with pytest.raises(ValueError, match=r"no dataset 'nmnst'; did you mean n-mnist"):
        dataset_named("nmnst")
    with pytest.raises(ValueError, match="no dataset 'qqq'; there are n-mnist, "):
        dataset_named("qqq")


def test_classes_are_held_to_their_part(tmp_path):
    root = trees.put(tmp_path, trees.nmnist())
    found = dict(problems(root, NMNIST))
    assert found["n-mnist"].startswith("50 recordings, 70,000 expected (counts and numbers are MNIST's)")
    assert found["train/3"] == "6,128 of 6,131 recordings are missing"
    assert found["test/3"] == "1,008 of 1,010 recordings are missing"
    # three numbers are there, each ten times
    lost = "59,997 of 60,000 recordings are missing: 00004, 00005, 00006 and 59,994 more"
    assert (found["train"], list(found)[-2:]) == (lost, ["train", "test"])
    assert len(found) == 1 + 20 + 2


def test_a_folder_of_unknown_kind_has_recordings_and_lists(tmp_path):
    trees.put(tmp_path, {"a/1.bin": trees.atis(trees.some(1)), "a/2.BIN": b"", "list.TXT": b"cat 1\n", "b.csv": b"x,y"})
    trees.put(tmp_path, {"a/3.txt": b"0.1 1 2 1\n0.2 5 5 0\n", "a/4.txt": b"0.1 1 2 1\nhello\n"})
    found = dict(problems(tmp_path))
    assert sorted(found) == ["a/2.BIN", "a/4.txt"]
    assert found["a/2.BIN"] == "empty"
    with pytest.raises(FileNotFoundError, match="no recordings below"):
        list(problems(trees.put(tmp_path / "lists", {"1.txt": b"cat 1\n"})))
    with pytest.raises(FileNotFoundError, match="no such folder or store"):
        list(problems(tmp_path / "nowhere"))


def test_a_store_of_a_dataset_that_is_not_known_here(tmp_path, monkeypatch):
    root = trees.put(tmp_path / "data", {"a/1.bin": trees.atis(trees.some(1)), "a/2.bin": b""})
    monkeypatch.setattr(EventFolder, "info", dataclasses.replace(EventFolder.info, name="of another program"))
    pack(EventFolder(root), tmp_path / "a.h5")
    left_out = ("a/2.bin", "left out when it was packed: no events")
    assert list(problems(tmp_path / "a.h5")) == [left_out]
    raw = bytearray((tmp_path / "a.h5").read_bytes())
    raw[storefiles.block_places(tmp_path / "a.h5", 0)[0]] ^= 1
    (tmp_path / "a.h5").write_bytes(raw)
    first, (name, reason) = problems(tmp_path / "a.h5")
    assert (first, name) == (left_out, "a/1.bin")
    assert reason.startswith("its events fail their checksum")


def test_guessed_sensor_sizes_are_reported_as_guesses(tmp_path, capsys):
    nvsdata.write(nvsdata.example(), tmp_path / "stated.h5")
    (tmp_path / "unstated.bin").write_bytes(trees.atis(trees.some(1, 3)))
    assert main(["verify", str(tmp_path)]) == 0
    first, last = capsys.readouterr().out.splitlines()
    assert first.startswith("1 recordings state no sensor size: it is guessed")
    assert first.endswith("; --dataset NAME states it")
    assert last == "2 recordings opened: no faults"
    assert main(["verify", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["guessed"] == 1
