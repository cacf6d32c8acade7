"""Names of records against a list and a dict."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
import trees

import nvsdata
from nvsdata.datasets.store import names as module
from nvsdata.datasets.store.index import pack_texts
from nvsdata.datasets.store.names import Names, PackedRecordings

TEXTS = ["b/0.bin", "a/ä.bin", "a/\udcff.bin", "", "c.bin", "a/line\nbreak.bin", "日本/語.bin"]


def names_of(texts):
    return Names(np.frombuffer(pack_texts(texts), np.uint8))


@pytest.mark.parametrize("count", range(len(TEXTS) + 1))
@pytest.mark.parametrize("at_once", [1, 2, 3, 100])
def test_names_are_those_of_a_list(monkeypatch, count, at_once):
    monkeypatch.setattr(module, "AT_ONCE", at_once)
    texts = TEXTS[:count]
    names = names_of(texts)
    assert len(names) == count
    assert list(names) == texts
    assert names == texts
    assert names != [*texts, "another"]
    assert names[1:5:2] == texts[1:5:2]
    assert [names[i - count] for i in range(count)] == texts
    for wrong in (count, -count - 1):
        with pytest.raises(IndexError):
            names[wrong]


def test_names_have_numbers():
    names = names_of(TEXTS)
    # in another order than that of reading
    for number in (3, 0, 6, 2, 5, 1, 4):
        assert names.number(TEXTS[number]) == number
        assert names.number(names[number]) == number
        assert TEXTS[number] in names
    for other in ("d", "b/0.bi", "b/0.bin0", "B/0.bin", "a"):
        assert other not in names
        with pytest.raises(KeyError, match=other):
            names.number(other)
    assert 5 not in names


@pytest.mark.parametrize("raw", [b"a", b"a\0a\0", b"a\0\xff\0", b"a\0b\0\xc3\0\xa4\0"])
def test_bytes_that_are_no_names_are_refused(monkeypatch, raw):
    monkeypatch.setattr(module, "AT_ONCE", 1)
    with pytest.raises(ValueError, match=r"index|decode"):
        Names(np.frombuffer(raw, np.uint8))


def test_names_beyond_4_bytes_are_refused():
    raw = np.broadcast_to(np.zeros(1, np.uint8), module.MOST_BYTES + 1)
    with pytest.raises(ValueError, match=r"index has 4294967297 bytes of names"):
        Names(raw)


@pytest.mark.parametrize("count", [0, 1, 255, 256, 257, 65_536, 65_537])
def test_folders_of_any_number(count):
    names = names_of([f"{n}/a" for n in range(count)])
    packed = PackedRecordings(SimpleNamespace(names=names))
    assert packed.folders == [str(n) for n in range(count)]
    assert packed.folder.tolist() == list(range(count))


def test_folders_and_order():
    names = names_of(["b/1", "a/0", "b/0", "c", "a/b/0"])
    folder, folders = names.folders()
    assert [folders[i] for i in folder] == ["b", "a", "b", ".", "a/b"]
    numbers = np.arange(5, dtype=np.uint32)
    names.sort(numbers, by_file=True)
    assert numbers.tolist() == [1, 4, 2, 0, 3]
    names.sort(numbers, by_file=False)
    assert numbers.tolist() == [1, 4, 2, 0, 3]


def test_recordings_are_sent_as_the_path_of_their_store(tmp_path):
    for i in range(40):
        (tmp_path / f"data/a{i % 3}").mkdir(parents=True, exist_ok=True)
        nvsdata.write(trees.some(i), tmp_path / f"data/a{i % 3}/{i}.npy")
    folder = nvsdata.EventFolder(tmp_path / "data")
    nvsdata.pack(folder, tmp_path / "a.nvs")
    packed = nvsdata.EventFolder(tmp_path / "a.nvs")
    assert len(pickle.dumps(packed.source.recordings())) < 300
    sent = pickle.loads(pickle.dumps(packed))
    assert sent.samples == packed.samples == folder.samples
    assert sent[7] == folder[7]
