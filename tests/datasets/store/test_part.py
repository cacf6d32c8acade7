"""The folder of an unfinished store, as somebody else may have changed it."""

import json
import os
import zlib

import numpy as np
import pytest
import trees

from nvsdata import EventFolder
from nvsdata.datasets.store import part as parts
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.writer import pack


class Stopped(Exception):
    pass


@pytest.fixture
def stopped(tmp_path, monkeypatch):
    """A dataset of four recordings, and the folder of a store of which two are packed."""
    root = trees.put(tmp_path / "data", {f"{name}/{i}.bin": trees.atis(trees.some(i)) for name in "ab" for i in (0, 1)})
    dataset, add, added = EventFolder(root), parts.Part.add, []

    def stop(self, *given):
        if len(added) == 2:
            raise Stopped
        added.append(given)
        add(self, *given)

    with monkeypatch.context() as patch:
        patch.setattr(parts.Part, "add", stop)
        with pytest.raises(Stopped):
            pack(dataset, tmp_path / "s.h5")
    return dataset, tmp_path / ".s.h5.part"


def kinds_of(head):
    """Names and types of the columns, as a journal's first line has them."""
    return zip("txyp", map(np.dtype, json.loads(head)["kinds"]), strict=True)


def packed_soundly(dataset, folder):
    out = folder.with_name("s.h5")
    pack(dataset, out)
    store = Store(out)
    assert sorted(store.names) == ["a/0.bin", "a/1.bin", "b/0.bin", "b/1.bin"]
    again = EventFolder(out)
    for index in range(len(dataset)):
        assert again[index][0] == dataset[index][0]


@pytest.mark.parametrize(
    "change",
    [
        {"events": 10**30},
        {"events": -1},
        {"events": "12"},
        {"events": 1.0},
        {"base": 2**62},
        {"base": None},
        {"size": [34, -1]},
        {"size": ["34", "34"]},
        {"size": [1, 1]},
        {"size": 34},
        {"time": [1]},
        {"time": [2**70, 2**70]},
        {"bytes": -1},
        {"format": 3},
        {"stamp": "no"},
        {"crc": 1},
        {"name": "../../secret.h5"},
        {"name": ["a"]},
        {"skipped": 7},
    ],
    ids=str,
)
def test_a_line_that_says_something_else_is_not_believed(stopped, change):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    head, first, second = journal.read_text().splitlines()
    journal.write_text("\n".join((head, json.dumps(json.loads(first) | change), second)) + "\n")
    packed_soundly(dataset, folder)


def test_a_line_that_is_there_twice_counts_once(stopped):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    head, first, _ = journal.read_text().splitlines()
    journal.write_text("\n".join((head, first, first)) + "\n")
    for name, kind in kinds_of(head):
        one = (folder / name).read_bytes()[: json.loads(first)["events"] * kind.itemsize]
        (folder / name).write_bytes(one + one)
    packed_soundly(dataset, folder)


@pytest.mark.parametrize(("column", "value"), [("t", -5), ("x", 200), ("y", 200), ("p", 7)])
def test_events_that_cannot_be_are_packed_again_whatever_their_checksum(stopped, column, value):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    head, first, second = journal.read_text().splitlines()
    facts, crc = json.loads(first), 0
    for name, kind in kinds_of(head):
        values = np.fromfile(folder / name, kind)
        if name == column:
            values[1] = value
            values.tofile(folder / name)
        crc = zlib.crc32(values[: facts["events"]].tobytes(), crc)
    journal.write_text("\n".join((head, json.dumps(facts | {"crc": crc}), second)) + "\n")
    packed_soundly(dataset, folder)


@pytest.mark.parametrize("text", ["\0" * 100, "[" * 100_000, "nonsense", '{"version": 2}', "[]\n[]\n"], ids=range(5))
def test_a_journal_that_is_none(stopped, text):
    dataset, folder = stopped
    (folder / parts.JOURNAL).write_text(text + "\n")
    packed_soundly(dataset, folder)


@pytest.mark.parametrize("name", ["t", "x", parts.JOURNAL])
@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_link_or_pipe_in_the_place_of_a_file(stopped, tmp_path, name, kind):
    dataset, folder = stopped
    target = tmp_path / "thesis.tex"
    target.write_text("a year's work")
    (folder / name).unlink()
    if kind == "link":
        (folder / name).symlink_to(target)
    elif kind == "pipe":
        os.mkfifo(folder / name)
    else:
        (folder / name).mkdir()
    with pytest.raises(OSError, match=r"\.s\.h5\.part/"):
        pack(dataset, tmp_path / "s.h5")
    assert target.read_text() == "a year's work"


def test_a_link_in_the_place_of_the_folder(stopped, tmp_path):
    dataset, folder = stopped
    other = folder.rename(tmp_path / "other")
    before = {path.name: path.read_bytes() for path in other.iterdir()}
    folder.symlink_to(other)
    packed_soundly(dataset, folder)
    assert {path.name: path.read_bytes() for path in other.iterdir()} == before


def test_a_journal_of_a_gigabyte_is_not_read(stopped, tmp_path):
    dataset, folder = stopped
    os.truncate(folder / parts.JOURNAL, 1 << 30)
    with pytest.raises(OSError, match="too large"):
        pack(dataset, tmp_path / "s.h5")
