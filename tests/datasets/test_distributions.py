"""Every dataset from look-alikes of its files, as distributed, re-sorted, and packed."""

from __future__ import annotations

import itertools
import shutil

import numpy as np
import pytest
import torch
import trees
from distributions import CASES, check_same

import nvsdata
from nvsdata import FormatError
from nvsdata import transforms as T
from nvsdata.datasets import (
    ASLANDVS,
    ASLDVS,
    CIFAR10DVS,
    DATASETS,
    HMDB51DVS,
    MNISTDVS,
    NCARS,
    NMNIST,
    UCF50DVS,
    UCF101DVS,
    YUPENNDVS,
    DVS128Gesture,
    NCaltech101,
)


def by_stem(dataset):
    """Stem and label of every sample to its events."""
    found = {}
    for i, sample in enumerate(dataset.samples):
        ev, label = dataset[i]
        found[sample.stem, label] = ev
    assert len(found) == len(dataset)
    return found


every_dataset = pytest.mark.parametrize("name", CASES)


@every_dataset
def test_as_distributed(home, name):
    files, kind, train_size, test_size = CASES[name]
    root = home(files())
    train, test, both = (kind(root, split) for split in ("train", "test", "all"))
    assert (len(train), len(test)) == (train_size, test_size)
    assert len(train.targets) == len(train)
    keys = [{(s.name, s.window) for s in part.samples} for part in (train, test, both)]
    assert not keys[0] & keys[1]
    assert keys[0] | keys[1] <= keys[2]
    assert DATASETS[name.split(",")[0]] is kind
    for dataset in (train, test):
        ev, label = dataset[len(dataset) - 1]
        assert len(ev) > 0
        assert 0 <= label < len(dataset.classes)
        assert ev.sensor_size == dataset.sensor_size
    assert dataset.class_to_idx[dataset.classes[label]] == label
    files = len(train.recording_names())
    kind = "recordings" if files == len(train) else f"samples of {files} recordings"
    assert f": {len(train)} {kind}, {len(train.classes)} classes" in repr(train)


@pytest.mark.parametrize(
    "name", ["n-mnist", "n-cars", "mnist-dvs", "cifar10-dvs", "asl-dvs", "yupenn-dvs", "hmdb51-dvs"]
)
@pytest.mark.parametrize("parts", [True, False], ids=["split folders", "flat"])
def test_resorted_by_hand(home, tmp_path, name, parts):
    files, kind, *_ = CASES[name]
    if not parts and name in ("n-mnist", "n-cars"):
        pytest.skip("without split folders there is no split")
    original = home(files())
    root = tmp_path / "sorted"
    for split in ("train", "test"):
        before = kind(original, split)
        for sample in before.samples:
            folder = root / split if parts else root
            target = folder / before.classes[sample.label].upper() / sample.name.rsplit("/", 1)[-1]
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(original / sample.name, target)
    for lists in original.glob("testTrain*"):
        shutil.copytree(lists, root / lists.name)
    for split in ("train", "test"):
        check_same(kind(original, split), kind(root, split))


@pytest.mark.parametrize("name", ["n-caltech101", "cifar10-dvs", "asl-dvs"])
def test_random_splits_are_stratified_by_seed(home, name):
    files, kind, *_ = CASES[name]
    root = home(files())
    splits = [{s.name for s in kind(root, "test", fold=seed).samples} for seed in (0, 0, 1)]
    assert splits[0] == splits[1] != splits[2]
    _, counts = np.unique(kind(root, "test").targets, return_counts=True)
    assert (counts == 2).all()
    with pytest.raises(ValueError, match="seed"):
        kind(root, fold=-1)


def test_events_are_those_that_were_written(home):
    root = home(trees.asldvs() | trees.mnistdvs() | trees.ncars())
    asl = by_stem(ASLDVS(root, "all"))
    assert asl["k_0003", 9] == trees.some(102, size=(240, 180))
    digits = by_stem(MNISTDVS(root, "all", scale=8))
    assert digits["mnist_7_scale08_0900", 7] == trees.some(7908, size=(128, 128))
    car = by_stem(NCARS(root, "test"))["obj_000003_td", 1]
    assert np.array_equal(car.t, trees.some(103, size=(73, 40)).t)


def test_nmnist_first_saccade_and_stabilized(home):
    root = home(trees.nmnist())
    whole, _ = NMNIST(root)[4]
    first, _ = NMNIST(root, first_saccade=True)[4]
    assert first == whole.window(0, 100_000)
    assert NMNIST(root, first_saccade=True).recording(4).read(50_000, 120_000) == whole.window(50_000, 100_000)
    still, _ = NMNIST(root, stabilized=True)[4]
    inside = [
        (t, round(x - d), round(y - e), p)
        for t, x, y, p, d, e in zip(*whole.columns, *_drift(whole.t), strict=True)
        if 0 <= round(x - d) < 34 and 0 <= round(y - e) < 34
    ]
    assert list(zip(*still.columns, strict=True)) == inside


def _drift(t):
    """How far the picture has moved by each time, in the words of the dataset's authors."""
    s = t / 105e3
    x = np.where(s <= 1, 3.5 * s, np.where(s <= 2, 3.5 + 3.5 * (s - 1), np.maximum(7 - 7 * (s - 2), 0)))
    y = np.where(s <= 1, 7 * s, np.where(s <= 2, 7 - 7 * (s - 1), 0))
    return x, y


def test_ncaltech101_boxes_and_background(home):
    root = home(trees.ncaltech101())
    dataset = NCaltech101(root, "all")
    boxes = {s.name.split("/", 1)[1]: dataset.box(i) for i, s in enumerate(dataset.samples)}
    assert boxes["ant/image_0002.bin"] == (5, 7, 100, 80)
    assert boxes["ant/image_0001.bin"] == (0, 7, 105, 80)
    assert boxes["BACKGROUND_Google/image_0001.bin"] is None
    assert len(NCaltech101(root, "all", background=False)) == 30
    assert len(NCaltech101(root, "all", background=False).classes) == 100
    broken = root / "Caltech101_annotations" / "ant" / "annotation_0003.bin"
    broken.write_bytes(b"\x01\x02\x03")
    with pytest.raises(FormatError, match=r"annotation_0003\.bin"):
        dataset.box([s.name for s in dataset.samples].index("Caltech101/ant/image_0003.bin"))


def test_ncaltech101_boxes_as_targets(home):
    root = home(trees.ncaltech101())
    plain, dataset = NCaltech101(root, "all"), NCaltech101(root, "all", boxes=True)
    assert dataset.targets == plain.targets
    for index in range(len(plain)):
        events, target = dataset[index]
        box = plain.box(index)
        wanted = [] if box is None else [[box.x, box.y, box.x + box.width, box.y + box.height]]
        assert target["boxes"].tolist() == wanted
        assert target["boxes"].shape == (len(wanted), 4)
        assert target["labels"].tolist() == [plain[index][1]] * len(wanted)
        assert events == plain[index][0]
    moved = NCaltech101(
        root, "all", boxes=True, transforms=T.WithBoxes(T.Compose([T.RandomFlip(0, 1.0), T.EventImage()]))
    )
    ant = [s.name for s in dataset.samples].index("Caltech101/ant/image_0002.bin")
    image, target = moved[ant]
    assert torch.equal(image, T.EventImage()(T.RandomFlip(0, 1.0)(plain[ant][0])))
    assert target["boxes"].tolist() == [[240 - 105, 7, 240 - 5, 87]]
    assert "transforms: WithBoxes" in repr(moved)
    inputs, targets = next(iter(torch.utils.data.DataLoader(moved, 4, collate_fn=nvsdata.collate)))
    assert inputs.shape[0] == 4
    assert [set(one) for one in targets] == [{"boxes", "labels"}] * 4
    changed = NCaltech101(root, "all", boxes=True, target_transform=lambda target: len(target["boxes"]))
    assert changed[ant][1] == 1
    with pytest.raises(ValueError, match="transforms takes the place of transform and target_transform"):
        NCaltech101(root, transforms=T.WithBoxes(T.EventImage()), transform=T.EventImage())
    with pytest.raises(TypeError, match="transforms must be callable, not 3"):
        NCaltech101(root, transforms=3)
    broken = root / "Caltech101_annotations" / "ant" / "annotation_0002.bin"
    broken.write_bytes(b"\x01\x02")
    skipping = NCaltech101(root, "all", boxes=True, errors="skip")
    with pytest.warns(UserWarning, match="annotation_0002.bin"):
        skipping[ant]
    ((name, reason),) = skipping.damaged().items()
    assert name == "Caltech101/ant/image_0002.bin"
    assert "annotation_0002.bin" in reason
    with pytest.raises(ValueError, match="a cache keeps what `transform` returns"):
        nvsdata.cache(moved, root / "cache")


def test_mnistdvs_scales(home):
    root = home(trees.mnistdvs())
    assert len(MNISTDVS(root, "all", scale=None)) == 90
    assert {s.stem.split("_")[2] for s in MNISTDVS(root, scale=16).samples} == {"scale16"}
    with pytest.raises(ValueError, match="scale must be"):
        MNISTDVS(root, scale=5)


def test_gesture_slices_users_and_the_label_that_ends_too_late(home):
    root = home(trees.dvs128gesture())
    train, test = DVS128Gesture(root), DVS128Gesture(root, "test")
    assert sorted(set(train.users)) == [1, 22]
    assert set(test.lightings) == {"lab", "fluorescent_led"}
    assert [train.targets.count(label) for label in range(11)] == [2] * 7 + [4] + [2] * 3
    trial = trees.some(1, 3_000, (128, 128), first=80_000_000, gap=500)
    for i, sample in enumerate(train.samples):
        if "user22" in sample.name:
            assert train[i][0] == trial.window(*sample.window)
    windows = sorted(s.window for s in train.samples if "user22" in s.name)
    assert all(a[1] <= b[0] for a, b in itertools.pairwise(windows))


def test_preprocessed_gestures_count_in_milliseconds(home, tmp_path):
    root = home(trees.dvs128gesture_preprocessed())
    train = DVS128Gesture(root)
    assert train.users == [1] * 11 + [23] * 11
    assert set(train.lightings) == {"lab", "fluorescent_led"}
    assert train.targets == [*range(11), *range(11)]
    in_ms = trees.some(20 + 4, 300, (128, 128), first=0, gap=30)
    recording, whole = train.recording(15), train[15][0]
    assert whole.t.tolist() == (in_ms.t * 1000).tolist()
    assert recording.span == (whole.t[0], whole.t[-1])
    for start, stop in ((500_500, 900_001), (500_000, 900_000), (-1, 1), (None, 40_000)):
        assert recording.read(start, stop) == whole.window(start, stop)
    assert recording.read(500_500, 900_001).start == 500_500
    nvsdata.pack(train, tmp_path / "g.h5")
    check_same(train, DVS128Gesture(tmp_path / "g.h5"))


def test_gesture_without_its_lists_goes_by_user(home):
    files = {name: data for name, data in trees.dvs128gesture().items() if "trials_to" not in name}
    assert set(DVS128Gesture(home(files), "test").users) == {24, 29}


def test_a_gesture_reads_only_its_own_packets(tmp_path, monkeypatch):
    from nvsdata.formats.aedat import aedat3
    from nvsdata.kernels.decode.aedat3 import NUMBER

    ev = trees.some(0, 400_000, (128, 128), first=80_000_000, gap=60)
    nvsdata.write(ev, tmp_path / "user01_lab.aedat3")
    a, b = int(ev.t[200_000]), int(ev.t[210_000])
    (tmp_path / "user01_lab_labels.csv").write_text(f"class,startTime_usec,endTime_usec\n1,{a},{b}\n")
    read = []
    kernel = aedat3.aedat3_decode
    monkeypatch.setattr(aedat3, "aedat3_decode", lambda *args: read.append(args[2][:, NUMBER].sum()) or kernel(*args))
    sample, _ = DVS128Gesture(tmp_path, "all")[0]
    assert sample == ev.window(a, b)
    assert 0 < sum(read) <= len(sample) + 2 * aedat3.PACKET


@pytest.mark.parametrize("rows", ["1,5,2", "12,1,2", "1,x,2", "1,2"])
def test_a_broken_table_of_labels_is_named(tmp_path, rows):
    (tmp_path / "user01_lab.aedat").write_bytes(b"")
    (tmp_path / "user01_lab_labels.csv").write_text(f"class,startTime_usec,endTime_usec\n{rows}\n")
    with pytest.raises(ValueError, match="user01_lab"):
        DVS128Gesture(tmp_path, "all")


def test_ucf101_splits_groups_and_what_is_left_out(home):
    root = home(trees.ucf101dvs())
    train, test = UCF101DVS(root), UCF101DVS(root, "test")
    assert (set(train.groups), set(test.groups)) == ({8, 25}, {1, 7})
    assert train.skipped == ["Billards/v_Billiards_g08_c02.mat"]
    assert {train.classes[label] for label in train.targets} == {"Billiards", "HandstandPushups"}
    # no list of the second split there: the rule that the lists follow
    assert set(UCF101DVS(root, "test", fold=2).groups) == {8}
    with pytest.raises(ValueError, match="fold must be 1 to 3, not 4"):
        UCF101DVS(root, fold=4)


def test_ucf50_holds_out_a_group(home):
    root = home(trees.ucf50dvs())
    assert set(UCF50DVS(root, "test", fold=25).groups) == {25}
    assert set(UCF50DVS(root, fold=25).groups) == {1, 2}
    ev, _ = UCF50DVS(root, "test", fold=2)[0]
    assert ev == trees.some(2, 300, (240, 180))


@pytest.mark.parametrize("kind", ["mat", "aedat"])
def test_hmdb51_in_both_formats(home, kind):
    root = home(trees.hmdb51dvs(kind))
    test = HMDB51DVS(root, "test")
    assert [int(s.stem[-1]) for s in test.samples] == [3, 4, 3, 4]
    assert test[0][0] == trees.some(3, 300, (240, 180), first=2_000_000)
    assert test.skipped == [f"wave/empty_wave_1.{kind}"]
    # a list of split 1 only; for the others, the lists that come with nvsdata don't know these names
    with pytest.raises(FileNotFoundError, match="no recordings for split 'train'"):
        HMDB51DVS(root, fold=2)


@pytest.mark.parametrize("view2", [True, False])
def test_aslan_pairs(home, view2):
    root = home(trees.aslandvs(view2))
    train, test = ASLANDVS(root, fold=3), ASLANDVS(root, "test", fold=3)
    assert (len(train), len(test)) == (17, 2)
    assert test.targets == [0, 1]
    (a, b), same = test[1]
    assert (a, b, same) == (trees.some(3, 300, (240, 180)), trees.some(12, 300, (240, 180)), 1)
    assert train.missing == ["99" if view2 else "v_99"]
    (graph, _), _ = ASLANDVS(root, fold=3, transform=nvsdata.transforms.RadiusGraph())[0]
    assert graph.num_nodes == 300


def test_aslan_without_pairs_says_what_it_needs(home):
    files = {name: data for name, data in trees.aslandvs(True).items() if "View2" not in name}
    with pytest.raises(FileNotFoundError, match="View2"):
        ASLANDVS(home(files))


def test_yupenn_leaves_one_out(home):
    root = home(trees.yupenndvs())
    test = YUPENNDVS(root, "test", fold=5)
    assert (len(test), len(YUPENNDVS(root, fold=5))) == (1, 8)
    assert test.classes[test.targets[0]] == "forest_fire"
    with pytest.raises(ValueError, match="fold must be below the number of recordings, 9, not 9"):
        YUPENNDVS(root, fold=9)


@every_dataset
def test_an_empty_root_says_how_to_get_the_data(tmp_path, name):
    _, kind, *_ = CASES[name]
    with pytest.raises(FileNotFoundError, match="manually from"):
        kind(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError):
        kind(tmp_path)


def test_the_order_does_not_depend_on_the_folders(tmp_path):
    # '-' comes before the dot of an extension, which comes before letters
    names = ["a", "a-b", "ab", "a#1"]
    one, two = tmp_path / "one", tmp_path / "two"
    for k, name in enumerate(names):
        trees.put(one, {f"cat/{name}.bin": trees.atis(trees.some(k))})
        trees.put(two, {f"{('train', 'test')[k % 2]}/cat/{name}.bin": trees.atis(trees.some(k))})
    stems = [[s.stem for s in CIFAR10DVS(root, "all").samples] for root in (one, two)]
    assert stems[0] == stems[1] == ["a#1", "a-b", "a", "ab"]
