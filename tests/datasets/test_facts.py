"""What is known of the datasets before any of their files is there, in numbers from elsewhere."""

from __future__ import annotations

import io
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
import scipy.io
import trees

from nvsdata import FormatError
from nvsdata.datasets import (
    ASLANDVS,
    CIFAR10DVS,
    DATASETS,
    HMDB51DVS,
    MNISTDVS,
    NMNIST,
    UCF50DVS,
    UCF101DVS,
    YUPENNDVS,
    DVS128Gesture,
    EventFolder,
    NCaltech101,
)
from nvsdata.datasets.description import nothing_below
from nvsdata.datasets.facts import Archive, ExpectedCount, Info, Sample, expected_names
from nvsdata.datasets.verification import some_names


@pytest.mark.parametrize(
    ("name", "total"),
    [
        ("n-mnist", 1_178_661_068),  # of both parts in one
        ("n-caltech101", 3_991_470_277),
        ("mnist-dvs", 6_205_980_609),
        ("cifar10-dvs", 8_384_751_365),
        ("n-cars", 450_543_128),
        ("asl-dvs", 5_807_293_496),
        ("aslan-dvs", 5_586_395_500),
    ],
)
def test_archives_add_up_to_what_their_hosts_state(name, total):
    """A size that is off by a byte would have every download refused."""
    archives = DATASETS[name].info.archives
    assert sum(archive.size for archive in {*archives, *(a.within for a in archives if a.within)}) == total


def test_where_each_class_of_cifar10_dvs_lies():
    # figshare's numbers of the files, in the order of the classes
    numbers = "7712788 7712791 7712794 7712812 7712815 7712818 7712842 7712851 7712836 7712839".split()
    assert [{url.rsplit("/", 1)[1] for url in a.urls} for a in CIFAR10DVS.info.archives] == [{n} for n in numbers]


@pytest.mark.parametrize(
    ("name", "count", "size"),
    [
        ("n-mnist", 70_000, (34, 34)),
        ("n-caltech101", 8_709, (240, 180)),
        ("mnist-dvs", 30_000, (128, 128)),
        ("cifar10-dvs", 10_000, (128, 128)),
        ("n-cars", 24_029, (120, 100)),
        ("asl-dvs", 100_800, (240, 180)),
        ("dvs128-gesture", 1_464, (128, 128)),
        ("ucf50-dvs", 6_681, (240, 180)),
        ("ucf101-dvs", 13_523, (240, 180)),
        ("hmdb51-dvs", 6_766, (240, 180)),
        ("aslan-dvs", 3_697, (240, 180)),
        ("yupenn-dvs", 420, (240, 180)),
        ("folder", 0, None),
    ],
)
def test_how_many_recordings_of_which_size(name, count, size):
    assert (DATASETS[name].info.recordings, DATASETS[name].info.sensor_size) == (count, size)


def test_what_is_not_said_of_an_archive_is_unknown():
    archive, info, holding = Archive("a.zip", "", (), "a"), Info("x", None, (), "", ""), ExpectedCount("a", 3)
    assert (archive.size, archive.within, archive.optional) == (0, None, False)
    assert (info.archives, info.recordings, info.expected_counts) == ((), 0, ())
    assert (holding.part, holding.stems) == ("", [])
    for fact in (archive, info, holding):
        with pytest.raises(FrozenInstanceError):
            fact.name = fact.label = "other"


@pytest.mark.parametrize(
    ("name", "file", "stem"),
    [
        ("c.bin", "c.bin", "c"),
        ("a/b/c.bin", "c.bin", "c"),
        ("a.b/c.d.tar.bin", "c.d.tar.bin", "c.d.tar"),
        ("a.b/c", "c", "c"),
    ],
)
def test_a_sample_is_known_by_its_file(name, file, stem):
    sample = Sample(name, 0)
    assert (sample.file, sample.stem, sample.part) == (file, stem, "")
    assert sample._replace(window=(5, 9)).part == " 5-9"
    assert sample._replace(window=(5, 9), events=(2, 3)).part == " 5-9 2+3"


@pytest.mark.parametrize(
    ("kind", "first", "last", "default"),
    [(UCF50DVS, 1, 25, 1), (UCF101DVS, 1, 3, 1), (HMDB51DVS, 1, 3, 1), (ASLANDVS, 1, 10, 1)],
)
def test_folds_are_numbered(kind, first, last, default, tmp_path):
    for fold in (first - 1, last + 1):
        with pytest.raises(ValueError, match=f"^fold must be {first} to {last}, not {fold}$"):
            kind(tmp_path, fold=fold)
    for fold in (first, last, None):
        # it's looked for, at least
        with pytest.raises(FileNotFoundError):
            kind(tmp_path / "nowhere", fold=fold)
    given = kind.__new__(kind)
    assert [given._check_fold(fold) for fold in (None, first, last)] == [default, first, last]


@pytest.mark.parametrize("kind", [CIFAR10DVS, YUPENNDVS])
def test_folds_that_have_no_end_begin_at_0(kind, tmp_path):
    with pytest.raises(ValueError, match=r"at least 0, not -1$"):
        kind(tmp_path, fold=-1)
    given = kind.__new__(kind)
    assert [given._check_fold(fold) for fold in (None, 0, 7)] == [0, 0, 7]


def test_one_split_has_no_folds(home):
    assert NMNIST(home(trees.nmnist())).fold == 0
    with pytest.raises(ValueError, match="NMNIST has one split only: fold must be None, not 0"):
        NMNIST("anywhere", fold=0)


@pytest.mark.parametrize(
    ("folder", "part"),
    [
        ("Train/3", "train"),
        ("n-cars_TEST/cars", "test"),
        ("a/testing/b", "test"),
        ("test/train", "test"),
        ("train_test", "train"),
        ("a/b", None),
        (".", None),
    ],
)
def test_a_part_is_named_by_the_topmost_folder_that_names_one(folder, part):
    assert NMNIST.__new__(NMNIST).part_of(folder) == part


@pytest.mark.parametrize(("kind", "files"), [(UCF101DVS, trees.ucf101dvs), (HMDB51DVS, trees.hmdb51dvs)])
def test_recordings_of_1_kb_are_not_taken_for_empty(home, kind, files):
    root = home(files())
    place = next(name for name in files() if name.endswith(".mat")).rsplit("/", 1)[0]
    for size in (1_023, 1_024):
        (root / place / f"{size}.mat").write_bytes(bytes(size))
    found = kind(root, "all")
    assert f"{place}/1023.mat" in found.skipped
    assert f"{place}/1024.mat" in [sample.name for sample in found.samples]


def test_without_lists_ucf101_holds_out_seven_groups_a_fold(tmp_path):
    trees.put(tmp_path, {f"YoYo/v_YoYo_g{group:02d}_c01.mat": bytes(1_024) for group in range(1, 26)})
    for fold, held in ((1, range(1, 8)), (2, range(8, 15)), (3, range(15, 22))):
        assert UCF101DVS(tmp_path, "test", fold=fold).groups == list(held)
        assert UCF101DVS(tmp_path, fold=fold).groups == [g for g in range(1, 26) if g not in held]
    trees.put(tmp_path, {"YoYo/another.mat": bytes(1_024)})
    # what is of no group is in no test set
    assert sorted(UCF101DVS(tmp_path, fold=1).groups)[:2] == [0, 8]


def test_names_in_lists_may_have_dots(tmp_path):
    lists = {
        f"{part}list0{fold}.txt": f"YoYo/v_{fold}.b_g01_c0{fold}.avi {fold}\n\n"
        for fold in range(5)
        for part in ("train", "test")
    }
    trees.put(tmp_path, {name: text.encode() for name, text in lists.items()} | {"YoYo/v_1.mat": bytes(1_024)})
    assert UCF101DVS(tmp_path, "all").split_lists() == {
        f"{part}list0{fold}.txt": [f"v_{fold}.b_g01_c0{fold}"] for fold in (1, 2, 3) for part in ("train", "test")
    }
    trees.put(tmp_path, {"wave/a.b.mat": bytes(1_024), "wave_test_split1.txt": b"a.b.avi 1\nc d.avi 2 \n"})
    assert HMDB51DVS(tmp_path, "all").split_lists() == {"wave_test_split1.txt": ["a.b", "c d"]}
    assert [sample.stem for sample in HMDB51DVS(tmp_path).samples] == ["a.b"]


def test_files_of_other_names_are_no_digits(tmp_path):
    names = ["a", "mnist_1", "mnist_1_scale04", "mnist_1_scale04_b", "mnist_1_scaleXX_0001", "mnist_1_scale04_0900"]
    names += ["mnist_1_scale04_0901_again", "mnist_1_scale04_1000"]
    trees.put(tmp_path, {f"1/{name}.aedat": b"" for name in names})
    assert [sample.stem for sample in MNISTDVS(tmp_path).samples] == names[-3:-2]
    assert [sample.stem for sample in MNISTDVS(tmp_path, "test").samples] == names[-2:]


def test_gestures_are_eleven_and_users_from_24_on_are_for_testing(tmp_path):
    trees.put(tmp_path, {f"user{user}_lab/{label}.npy": b"" for user in (22, 23, 24, 25) for label in (0, 10, 11)})
    train, test = DVS128Gesture(tmp_path), DVS128Gesture(tmp_path, "test")
    assert (train.users, train.targets) == ([22, 22, 23, 23], [0, 10, 0, 10])
    assert (test.users, test.targets) == ([24, 24, 25, 25], [0, 10, 0, 10])


def test_gestures_are_sorted_by_trial_and_then_by_time(tmp_path):
    for trial, rows in (("user01_led", ["2,5,9", "1,0,4"]), ("user01_lab", ["3,6,8", "4,1,2"])):
        table = "\n".join(["class,startTime_usec,endTime_usec", *rows]).encode()
        trees.put(tmp_path, {f"{trial}.aedat": b"", f"{trial}_labels.csv": table})
    found = DVS128Gesture(tmp_path, "all")
    assert [sample.label for sample in found.samples] == [3, 2, 0, 1]
    assert found.lightings == ["lab", "lab", "led", "led"]
    assert found.names[0] == ("right_arm_clockwise", "user01_lab user01_lab 1-2")


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        # one that ends as it begins is kept, one that ends too late is cut where the next begins
        (["1,5,5", "11,7,20", "2,9,12"], [(0, (5, 5)), (10, (7, 9)), (1, (9, 12))]),
        (["3,9,12", "2,0,9"], [(1, (0, 9)), (2, (9, 12))]),
        (["0,1,2"], "a label of class 0 from 1 to 2 µs is impossible"),
        (["12,1,2"], "a label of class 12 from 1 to 2 µs is impossible"),
        (["1,5,4"], "a label of class 1 from 5 to 4 µs is impossible"),
        ([], "labels aren't a table of class, startTime_usec, endTime_usec: KeyError"),
        (["1,1"], "labels aren't a table of class, startTime_usec, endTime_usec"),
    ],
)
def test_a_table_of_gestures(tmp_path, rows, found):
    table = "\n".join([*(["class,startTime_usec,endTime_usec"] if len(rows) else ["class,start,end", "1,1,2"]), *rows])
    trees.put(tmp_path, {"user01_lab.aedat": b"", "user01_lab_labels.csv": table.encode()})
    if isinstance(found, str):
        with pytest.raises(ValueError, match=f"^user01_lab.aedat: {found}"):
            DVS128Gesture(tmp_path, "all")
    else:
        samples = DVS128Gesture(tmp_path, "all").samples
        assert [(sample.label, sample.window) for sample in samples] == found


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("fold,video_a,video_b,same", "1,v_1"),
        ("fold,video_a,video_b,same", "1,v_1,v_2"),
        ("fold,video_a,video_b,same", "x,v_1,v_2,1"),
        ("fold,video_a,video_b,same", "1,v_1,v_2,same"),
        ("fold,video,video_b,same", "1,v_1,v_2,1"),
    ],
)
def test_a_broken_table_of_pairs_is_named(tmp_path, header, row):
    trees.put(tmp_path, {"v_1.mat": b"", "v_2.mat": b"", "aslan_pairs.csv": f"{header}\n{row}\n".encode()})
    with pytest.raises(ValueError, match=r"^aslan_pairs.csv must have the columns fold, video_a, video_b and same: "):
        ASLANDVS(tmp_path, "all")


@pytest.mark.parametrize("shape", [(2, 10), (2, 2, 10), (2, 3, 4, 5)])
def test_a_broken_view_2_is_named(tmp_path, shape):
    def saved(table):
        out = io.BytesIO()
        scipy.io.savemat(out, {"action_splits_pairs": table})
        return out.getvalue()

    trees.put(tmp_path, {"v_1.mat": b"", "v_2.mat": b"", "View2.mat": saved(np.ones(shape))})
    with pytest.raises(ValueError, match=r"^View2.mat contains no action_splits_pairs of \[pairs, 5, folds\]$"):
        ASLANDVS(tmp_path, "all")
    # the two columns of actions aren't needed; zeros before an id make no difference
    trees.put(tmp_path, {"v_003.mat": b"", "View2.mat": saved(np.array([[[1, 3, 0]], [[2, 1, 1]]]).transpose(0, 2, 1))})
    found = ASLANDVS(tmp_path, "test")
    assert found.samples == [("v_1.mat", "v_003.mat", 0), ("v_2.mat", "v_1.mat", 1)]


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ([2, 4, 5, 7, 9, 7, 9, 20, 5, 20], (5, 7, 4, 13)),
        ([2, 4, -5, -7, 9, -7, 9, 20, -5, 20], (0, 0, 9, 20)),
        ([2, 4, 5, 7, 9, 7, 9, 20, 5], None),
        ([1, 4, 5, 7, 9, 7, 9, 20, 5, 20], None),
        ([3, 4, 5, 7, 9, 7, 9, 20, 5, 20], None),
        ([2, 3, 5, 7, 9, 7, 9, 20, 5, 20], None),
    ],
)
@pytest.mark.parametrize("rest", [b"", b"\1"])
def test_boxes_are_the_first_corners(tmp_path, values, found, rest):
    annotation = b"".join(value.to_bytes(2, "little", signed=True) for value in values) + rest
    trees.put(tmp_path, {"Caltech101/ant/image_0001.bin": b"", "more/ant/annotation_0001.bin": annotation})
    dataset = NCaltech101(tmp_path, "all")
    if found is None:
        with pytest.raises(FormatError, match="byte 0: not an annotation: it doesn't begin with a box of 2 rows and 4"):
            dataset.box(0)
    else:
        assert dataset.box(0) == found


def test_names_in_messages_are_few():
    assert some_names(["a", "b", "c"]) == "a, b, c"
    assert some_names(["a", "b", "c", "d"]) == "a, b, c and 1 more"
    assert expected_names("a", "a_{}", range(2, 4)).stems == ["a_2", "a_3"]


def test_what_is_below_a_root_is_told_briefly(tmp_path):
    listing = {".": [], "(old)": [], "a": ["1.bin", "2.bin", "3.bin", "x.txt", "y.txt", "read", "read.me", "z.csv"]}
    begin = "expected there: TREE; found: "
    first = "(old)/ (no files of its own), a/ (3 .bin, 2 .txt, 1 read)"
    assert nothing_below(tmp_path, listing, "TREE", set()) == begin + first
    listing |= {name: ["1.h5"] for name in "bcd"}
    five = first + ", b/ (1 .h5), c/ (1 .h5), d/ (1 .h5)"
    assert nothing_below(tmp_path, listing, "TREE", set()) == begin + five
    assert nothing_below(tmp_path, listing | {"e": []}, "TREE", set()) == begin + five + " and 1 more folders"
    assert nothing_below(tmp_path, {".": []}, "TREE", set()) == begin + "nothing"


def test_a_root_that_is_too_deep_is_told_by_its_name_or_by_what_lies_in_it(tmp_path):
    inner = tmp_path / "Data" / "Train" / "Class-1"
    inner.mkdir(parents=True)

    def above(root, listing=None):
        _, _, said = nothing_below(root, listing or {".": []}, "TREE", {"train", "class1"}).partition("; the root ")
        return said

    for root in (inner, inner.parent, inner / "train"):
        assert above(root) == f"must be a folder above, such as {tmp_path / 'Data'}"
    assert above(tmp_path / "Data") == ""
    # recordings without folders of classes
    assert above(tmp_path / "Data", {".": ["1.bin"]}) == f"must be a folder above, such as {tmp_path}"
    assert above(tmp_path / "Data", {".": ["1.odt"], "a": ["1.bin"]}) == ""
    assert above(tmp_path / "nowhere", {".": ["1.bin"]}) == ""


def test_the_nearest_folder_gives_the_class(tmp_path):
    trees.put(tmp_path, {"3/5/1.bin": trees.atis(trees.some(1)), "3/2.bin": trees.atis(trees.some(2))})
    digits = MNISTDVS.__new__(MNISTDVS)
    digits.classes = list("0123456789")
    digits.class_to_idx = {name: index for index, name in enumerate(digits.classes)}
    assert [digits._label_of(folder) for folder in ("3/5", "3/x", "grabbed_data7/scale4", "x")] == [5, 3, 7, None]
    # but that below the root, where classes aren't known beforehand
    assert [sample.label for sample in EventFolder(tmp_path).samples] == [0, 0]
