"""Lists of samples against plain lists."""

import pickle

import numpy as np
import pytest

from nvsdata.datasets.facts import Sample
from nvsdata.datasets.sample_list import ListedRecordings, SampleList, labels_of, taken
from nvsdata.datasets.store.index import pack_texts
from nvsdata.datasets.store.names import Names

LISTING = {
    ".": ["0.npy", "list.csv"],
    "test/b": ["0.npy", "2.npy", "9.npy"],
    "train/a": ["5.npy", "7.npy"],
    "train/a/more": ["6.npy"],
    "train/b": ["1.npy", "2.npy", "3.bin"],
    "train/empty": [],
}
LABELS = {"test/b": 1, "train/a": 0, "train/a/more": 0, "train/b": 1}


class Packed(Names):
    """The recordings of a store, without a store."""

    def __init__(self, names):
        super().__init__(np.frombuffer(pack_texts(names), np.uint8))
        self.names = self
        self.folder, self.folders = Names.folders(self)


def recordings(packed):
    listed = ListedRecordings(LISTING)
    shuffled = np.random.default_rng(0).permutation(len(listed.names)).tolist()
    return Packed([listed.names[i] for i in shuffled]) if packed else listed


def samples(packed, by_file=True):
    return SampleList.sorted(recordings(packed), LABELS.get, by_file=by_file)


def plain(by_file=True):
    found = [
        Sample(f"{folder}/{name}", LABELS[folder])
        for folder, names in LISTING.items()
        for name in names
        if folder in LABELS
    ]
    return sorted(found, key=lambda s: (s.label, s.file, s.name) if by_file else (s.label, s.name))


@pytest.mark.parametrize("by_file", [False, True])
@pytest.mark.parametrize("packed", [False, True])
def test_samples_are_sorted(packed, by_file):
    found, expected = samples(packed, by_file), plain(by_file)
    assert len(found) == len(expected) == 9
    assert list(found) == expected
    assert found == expected
    assert found != expected[:-1]
    assert found != expected[::-1]
    assert [found[i] for i in range(9)] == expected
    assert found[-1] == expected[-1]
    assert found[np.int64(2)] == expected[2]
    assert labels_of(found) == labels_of(expected) == [0, 0, 0, 1, 1, 1, 1, 1, 1]
    for wrong in (9, -10):
        with pytest.raises(IndexError):
            found[wrong]


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("indices", [[], [3], [8, 0, 0], [-1, -9], range(2, 9, 3)])
def test_parts_are_those_of_a_list(packed, indices):
    assert list(taken(samples(packed), indices)) == taken(plain(), indices)
    assert list(samples(packed)[2:9:3]) == plain()[2:9:3]
    assert list(samples(packed)[:0]) == []
    with pytest.raises(IndexError):
        samples(packed).take([9])


@pytest.mark.parametrize("packed", [False, True])
def test_samples_within_folders(packed):
    found = samples(packed).within(lambda folder: folder.startswith("train"))
    assert list(found) == [sample for sample in plain() if sample.name.startswith("train")]


def test_no_labels_and_no_recordings():
    assert list(SampleList.sorted(recordings(True), lambda folder: None, by_file=True)) == []
    assert list(SampleList.sorted(ListedRecordings({".": []}), LABELS.get, by_file=True)) == []
    assert list(SampleList.sorted(Packed([]), LABELS.get, by_file=True)) == []


def test_they_are_added_as_lists_are():
    assert samples(True) + samples(False) == plain() + plain()
    assert samples(True) + plain()[:2] == plain() + plain()[:2]
    assert plain()[:2] + samples(True) == plain()[:2] + plain()


def test_they_can_be_sent():
    assert pickle.loads(pickle.dumps(samples(False))) == plain()
