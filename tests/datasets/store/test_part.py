"""The folder of an unfinished store, as somebody else may have changed it."""

import json
import os

import numpy as np
import pytest
import trees

from nvsdata import EventFolder
from nvsdata.data.events import Columns
from nvsdata.datasets.store import part as parts
from nvsdata.datasets.store.index import BEGIN
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.record import record_of
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
        {"events": 61},
        {"events": None},
        {"length": 0},
        {"length": 8},
        {"length": -8},
        {"length": 1.5},
        {"length": 2**62},
        {"length": 10**30},
        {"length": "64"},
        {"bytes": -1},
        {"bytes": 10**30},
        {"check": 1},
        {"check": None},
        {"stamp": "no"},
        {"stamp": 5},
        {"stamp": []},
        {"stamp": {}},
        {"stamp": [None]},
        {"more": 1},
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


@pytest.mark.parametrize("field", ["name", "events", "length", "check", "bytes", "stamp"])
def test_a_line_without_a_field_is_not_believed(stopped, field):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    head, first, second = journal.read_text().splitlines()
    line = json.loads(first)
    del line[field]
    journal.write_text("\n".join((head, json.dumps(line), second)) + "\n")
    packed_soundly(dataset, folder)


@pytest.mark.parametrize("field", ["version", "dataset", "root", "opened_with", "compress"])
def test_a_journal_of_another_packing_is_not_gone_on_with(stopped, field):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    head, first, second = journal.read_text().splitlines()
    # a whole record of another recording, which the lines call the dataset's own
    lines = [json.dumps(json.loads(head) | {field: "other"}), second, first]
    (folder / parts.DATA).write_bytes((folder / parts.DATA).read_bytes()[:BEGIN] + records(folder, second, first))
    journal.write_text("\n".join(lines) + "\n")
    packed_soundly(dataset, folder)
    assert Store(folder.with_name("s.h5")).names == dataset.recording_names()


def records(folder, *lines):
    """Records of two lines of a journal, in the order of the lines given."""
    raw, at, found = (folder / parts.DATA).read_bytes(), BEGIN, {}
    for line in (folder / parts.JOURNAL).read_text().splitlines()[1:]:
        length = json.loads(line)["length"]
        found[line] = raw[at : at + length]
        at += length
    return b"".join(found[line] for line in lines)


def test_records_in_another_order_are_those_of_their_lines(stopped):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    _, first, second = journal.read_text().splitlines()
    data = (folder / parts.DATA).read_bytes()[:BEGIN] + records(folder, second, first)
    (folder / parts.DATA).write_bytes(data)
    # the checksum of the first line is that of the other record
    packed_soundly(dataset, folder)


def test_a_line_that_is_there_twice_counts_once(stopped):
    dataset, folder = stopped
    journal = folder / parts.JOURNAL
    head, first, _ = journal.read_text().splitlines()
    journal.write_text("\n".join((head, first, first)) + "\n")
    data = folder / parts.DATA
    one = data.read_bytes()[BEGIN : BEGIN + json.loads(first)["length"]]
    data.write_bytes(bytes(BEGIN) + one + one)
    packed_soundly(dataset, folder)


IMPOSSIBLE = [("t", -5), ("t", 2**40), ("x", 200), ("y", 200), ("p", 7)]


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize(("column", "value"), IMPOSSIBLE)
def test_events_that_cannot_be_are_packed_again_whatever_their_checksum(stopped, column, value, compress):
    dataset, folder = stopped
    journal, data = folder / parts.JOURNAL, folder / parts.DATA
    head, first, second = journal.read_text().splitlines()
    facts, ev = json.loads(first), dataset.recording(0).read()
    columns = Columns(*(values.astype(np.int64) for values in ev.columns))
    getattr(columns, column)[1] = value
    record = record_of(columns, ev.sensor_size, (None, None), "atis", compress=compress)
    raw = data.read_bytes()
    data.write_bytes(raw[:BEGIN] + record + raw[BEGIN + facts["length"] :])
    facts |= {"length": len(record), "check": int.from_bytes(record[:4], "little")}
    journal.write_text("\n".join((head, json.dumps(facts), second)) + "\n")
    packed_soundly(dataset, folder)


@pytest.mark.parametrize("text", ["\0" * 100, "[" * 100_000, "nonsense", '{"version": 2}', "[]\n[]\n"], ids=range(5))
def test_a_journal_that_is_none(stopped, text):
    dataset, folder = stopped
    (folder / parts.JOURNAL).write_text(text + "\n")
    packed_soundly(dataset, folder)


def test_the_unfinished_store_of_an_older_layout_is_packed_again_and_removed(stopped):
    dataset, folder = stopped
    head = {"version": 2, "dataset": "folder", "root": str(dataset.root), "kinds": ["<i8", "|u1", "|u1", "|u1"]}
    line = {"name": "a/0.bin", "events": 60, "base": 5, "size": [34, 34], "crc": 1}
    (folder / parts.DATA).unlink()
    for name in "txyp":
        (folder / name).write_bytes(bytes(60 * 8))
    (folder / parts.JOURNAL).write_text(f"{json.dumps(head)}\n{json.dumps(line)}\n")
    packed_soundly(dataset, folder)
    assert not folder.exists()


@pytest.mark.parametrize("name", [parts.DATA, parts.JOURNAL])
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
