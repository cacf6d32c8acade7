import re
from contextlib import suppress

import numpy as np
import pytest
import trees
from hypothesis import given
from hypothesis import strategies as st
from places import SHARED

from nvsdata import NCARS, NMNIST
from nvsdata.datasets import (
    ASLDVS,
    CIFAR10DVS,
    HMDB51DVS,
    YUPENNDVS,
    DVS128Gesture,
    EventFolder,
    NCaltech101,
    stratified,
)
from nvsdata.datasets.hmdb51dvs import official
from nvsdata.datasets.splits import held_out, held_out_last
from nvsdata.datasets.store.writer import pack

texts = st.text(st.characters(exclude_characters="\0"), max_size=6)
recordings = st.lists(st.tuples(st.sampled_from(["cat", "ant", "a\nb", "\udcff"]), texts), unique=True, max_size=60)
shares = st.floats(0.01, 0.99)


def held(found, share=0.2, seed=0):
    return {found[i] for i in stratified(found, share, seed)[1]}


@given(recordings, shares, st.integers(0, 5), st.randoms())
def test_the_order_makes_no_difference(found, share, seed, random):
    train, test = stratified(found, share, seed)
    assert train == sorted(train)
    assert test == sorted(test)
    assert sorted(train + test) == list(range(len(found)))
    shuffled = found.copy()
    random.shuffle(shuffled)
    assert held(shuffled, share, seed) == held(found, share, seed)


@given(recordings.filter(bool), shares, st.integers(0, 5), st.data())
def test_one_recording_less_moves_at_most_one_other_of_its_class(found, share, seed, data):
    gone = data.draw(st.sampled_from(found))
    left = [recording for recording in found if recording != gone]
    moved = (held(found, share, seed) ^ held(left, share, seed)) - {gone}
    assert len(moved) <= 1
    assert {name for name, _ in moved} <= {gone[0]}


@given(recordings.filter(bool), shares, st.data())
def test_holding_out_decides_about_each_recording_alone(found, share, data):
    try:
        rest, held_back = held_out(found, share)
    except ValueError:
        return
    assert sorted(rest + held_back) == list(range(len(found)))
    names = {found[i] for i in held_back}
    some = data.draw(st.lists(st.sampled_from(found), unique=True))
    # a class of one recording can't be in both parts
    with suppress(ValueError):
        assert {some[i] for i in held_out(some, share)[1]} == names & set(some)


def test_about_the_fraction_of_each_class_is_held_out():
    found = [(name, str(i)) for name in ("cat", "dog") for i in range(2000)]
    for share in (0.05, 0.1, 0.5):
        held_back = [found[i] for i in held_out(found, share)[1]]
        for name in ("cat", "dog"):
            count = sum(group == name for group, _ in held_back)
            assert abs(count - 2000 * share) < 4 * (2000 * share * (1 - share)) ** 0.5


@given(st.lists(texts, min_size=2, max_size=40, unique=True), st.integers(1, 5), shares, st.randoms())
def test_the_last_names_of_each_class_are_held_out(names, dogs, share, random):
    found = [("cat", name) for name in names] + [("dog", str(n)) for n in range(dogs)]
    random.shuffle(found)
    counts = [int(count * share + 0.5) for count in (len(names), dogs)]
    if 0 in counts or counts == [len(names), counts[1]] or counts[1] == dogs:
        with pytest.raises(ValueError, match=r"leaves no recordings of (cat|dog)"):
            held_out_last(found, share)
        return
    rest, held_back = held_out_last(found, share)
    assert sorted(rest + held_back) == list(range(len(found)))
    expected = {("cat", name) for name in sorted(names)[-counts[0] :]}
    expected |= {("dog", str(n)) for n in range(dogs - counts[1], dogs)}
    assert {found[i] for i in held_back} == expected


def test_the_highest_numbers_of_n_cars_are_held_out(tmp_path):
    for group in ("cars", "background"):
        (tmp_path / "n-cars_train" / group).mkdir(parents=True)
        for number in range(3990, 8000, 10):
            (tmp_path / "n-cars_train" / group / f"obj_{number:06d}_td.dat").touch()
    rest, held_back = NCARS(tmp_path, "train").hold_out(0.3)
    for label in (0, 1):
        numbers = [
            sorted(int(sample.stem.split("_")[1]) for sample in part.samples if sample.label == label)
            for part in (rest, held_back)
        ]
        assert numbers[0] + numbers[1] == list(range(3990, 8000, 10))
        assert len(numbers[1]) == 120


def test_a_class_without_recordings_in_a_part_is_named():
    with pytest.raises(
        ValueError, match=r"a validation fraction of 0\.001 leaves no recordings of cat, dog for validation"
    ):
        held_out([(name, str(i)) for name in ("dog", "cat") for i in range(9)], 0.001)
    with pytest.raises(ValueError, match=r"a validation fraction of 0\.999 leaves no recordings of cat for training"):
        held_out([("cat", str(i)) for i in range(9)], 0.999)
    for fraction in (0.0, 1.0, -1, 2, float("nan")):
        with pytest.raises(ValueError, match="must be between 0 and 1"):
            held_out([("cat", "1")], fraction)


@given(recordings, shares)
def test_each_class_gives_its_share(found, share):
    test = held(found, share)
    for name in {name for name, _ in found}:
        count = sum(group == name for group, _ in found)
        assert abs(sum(group == name for group, _ in test) - count * share) <= 0.5 + 1e-9


def test_names_that_occur_twice_are_shared_out():
    train, test = stratified([("a", "1")] * 10, 0.2)
    assert (len(train), len(test)) == (8, 2)


def test_splits_are_fixed_by_the_seed():
    found = [(str(i % 2), f"{i:05d}") for i in range(20)]
    # written down: the same on every machine
    assert stratified(found, 0.2, seed=0)[1] == HELD
    assert stratified(found, 0.2, seed=1)[1] != HELD
    with pytest.raises(ValueError, match="between 0 and 1"):
        stratified(found, 1)


HELD = [2, 4, 5, 17]


def test_a_fifth_of_real_nmnist(real_nmnist):
    dataset = NMNIST(real_nmnist)
    train, test = stratified(dataset.names)
    assert len(train) + len(test) == 1000
    assert abs(len(test) - 200) <= 3
    counts, all_counts = (np.bincount(np.array(dataset.targets)[which]) for which in (test, range(1000)))
    assert (np.abs(counts - all_counts * 0.2) <= 0.5).all()


def names(dataset):
    return set(dataset.names)


@pytest.mark.parametrize(("kind", "files"), [(CIFAR10DVS, trees.cifar10dvs), (ASLDVS, trees.asldvs)])
def test_a_file_less_leaves_the_split_as_it_was(home, kind, files):
    root = home(files())
    before = names(kind(root, "test"))
    gone = kind(root, "all").samples[0]
    (root / gone.name).unlink()
    moved = (before ^ names(kind(root, "test"))) - {(kind.info.classes[gone.label], gone.stem)}
    assert len(moved) <= 1


def test_with_and_without_background(home):
    root = home(trees.ncaltech101())
    for split in ("train", "test"):
        with_it, without = names(NCaltech101(root, split)), names(NCaltech101(root, split, background=False))
        assert {name for name in with_it if name[0] != "BACKGROUND_Google"} == without


@pytest.mark.parametrize("split", ["train", "test"])
def test_a_store_without_a_broken_recording_has_the_folders_split(home, tmp_path, split):
    root = home(trees.cifar10dvs())
    broken = CIFAR10DVS(root, split).samples[1]
    (root / broken.name).write_bytes(b"#!AER-DAT2.0\r\n")
    report = pack(CIFAR10DVS(root, "all"), tmp_path / "a.h5")
    assert list(report.skipped) == [broken.name]
    for part in ("train", "test"):
        folder, store = CIFAR10DVS(root, part), CIFAR10DVS(tmp_path / "a.h5", part)
        assert names(folder) - names(store) == ({("airplane", broken.stem)} if part == split else set())
        assert names(store) <= names(folder)
        assert store.skipped == [broken.name]


def test_a_store_of_one_split_gives_that_split_only(home, tmp_path):
    root = home(trees.cifar10dvs())
    pack(CIFAR10DVS(root, "train", fold=2), tmp_path / "a.h5")
    assert CIFAR10DVS(tmp_path / "a.h5", fold=2).split_hash == CIFAR10DVS(root, fold=2).split_hash
    for options in ({"split": "test", "fold": 2}, {"split": "train"}, {"split": "all"}):
        with pytest.raises(ValueError, match="packed from split 'train', fold 2 only"):
            CIFAR10DVS(tmp_path / "a.h5", **options)
    root = home(trees.yupenndvs())
    pack(YUPENNDVS(root, "train", fold=4), tmp_path / "y.h5")
    assert names(YUPENNDVS(tmp_path / "y.h5", fold=4)) == names(YUPENNDVS(root, fold=4))


def test_the_hash_tells_splits_apart_but_not_folders(home, tmp_path):
    root = home(trees.cifar10dvs() | trees.dvs128gesture())
    whole = CIFAR10DVS(root, "all")
    hashes = {CIFAR10DVS(root, split, fold=fold).split_hash for split in ("train", "test") for fold in (0, 1)}
    assert len(hashes | {whole.split_hash}) == 5
    assert all(len(digits) == 16 for digits in hashes)
    pack(whole, tmp_path / "a.h5")
    for sample in whole.samples:
        target = tmp_path / "sorted" / ("test", "train")[len(sample.stem) % 2] / whole.classes[sample.label].upper()
        target.mkdir(parents=True, exist_ok=True)
        (target / sample.file).write_bytes((root / sample.name).read_bytes())
    for other in (tmp_path / "a.h5", tmp_path / "sorted"):
        assert CIFAR10DVS(other, "test", fold=1).split_hash == CIFAR10DVS(root, "test", fold=1).split_hash
    assert whole.split_hash in repr(whole)
    assert whole[1:].split_hash != whole.split_hash == whole.subset(reversed(range(len(whole)))).split_hash
    gestures = DVS128Gesture(root, "all")
    assert len(set(gestures.names)) == len(gestures)
    assert gestures[1:].split_hash != gestures.split_hash


def test_parts_of_a_folder_have_the_same_labels(tmp_path):
    trees.put(
        tmp_path,
        {f"{place}/1.bin": trees.atis(trees.some(1)) for place in ("train/ant", "train/cat", "test/bee", "test/cat")},
    )
    train, test = EventFolder(tmp_path, "train"), EventFolder(tmp_path, "test")
    assert train.classes == test.classes == ["ant", "bee", "cat"]
    assert (train.targets, test.targets) == ([0, 2], [1, 2])


def test_hmdb51s_splits_are_those_of_its_authors():
    """70 videos for training and 30 for testing per class; counts as in the readme beside the lists."""
    lists = official()
    assert list(lists) == list(HMDB51DVS.info.classes)
    assert sum(map(len, lists.values())) == HMDB51DVS.info.recordings == 6_766
    for videos in lists.values():
        for k in range(3):
            parts = [digits[k] for digits in videos.values()]
            assert (parts.count("1"), parts.count("2"), set(parts) <= set("012")) == (70, 30, True)
    assert lists["brush_hair"]["April_09_brush_hair_u_nm_np1_ba_goo_0"] == "112"


def test_recordings_without_lists_follow_hmdb51s_own(tmp_path):
    names = sorted(official()["wave"])
    for name in names:
        (tmp_path / "wave").mkdir(exist_ok=True)
        (tmp_path / f"wave/{name}.mat").write_bytes(bytes(2_000))
    for fold in (1, 2, 3):
        train, test = (HMDB51DVS(tmp_path, split, fold=fold) for split in ("train", "test"))
        assert (len(train), len(test)) == (70, 30)
        assert {s.stem for s in test.samples} == {n for n in names if official()["wave"][n][fold - 1] == "2"}
    assert len(HMDB51DVS(tmp_path, "all")) == len(names)


@pytest.mark.skipif(not (SHARED / "lists").exists(), reason="names of UCF101's videos")
def test_ucf101s_rule_gives_the_numbers_of_its_lists():
    """trainlist01 to testlist03 have so many lines each; all of them follow the rule."""
    names = (SHARED / "lists/ucf101_videos.txt").read_text().split()
    groups = [int(re.search(r"_g(\d+)_c", name)[1]) for name in names]
    assert len(groups) == 13_320
    for fold, counts in {1: (9_537, 3_783), 2: (9_586, 3_734), 3: (9_624, 3_696)}.items():
        held = sum(7 * fold - 6 <= group <= 7 * fold for group in groups)
        assert (len(groups) - held, held) == counts
