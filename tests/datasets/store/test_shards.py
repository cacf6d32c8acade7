"""Shards: packed each on its own, joined by an index file, lost, swapped, and read by many."""

from __future__ import annotations

import os
from itertools import chain

import pytest
import storefiles
import trees
from distributions import check_same
from storefiles import COUNT, packed
from torch.utils.data import DataLoader

from nvsdata import EventFolder, FormatError, join, pack
from nvsdata.cli import main
from nvsdata.common.errors import shown
from nvsdata.datasets.store import shards, writer
from nvsdata.datasets.store.index import BEGIN
from nvsdata.datasets.store.opening import open_store
from nvsdata.datasets.store.part import DATA
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.shards import shard_path
from nvsdata.datasets.verification import problems

needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")


def test_joined_shards_are_the_store_of_all(joined, animals, tmp_path):
    whole = tmp_path / "whole.nvs"
    report = pack(EventFolder(animals), whole)
    store, expected = Store(joined), Store(whole)
    assert store.listing() == expected.listing()
    assert set(store.names) == set(expected.names)
    assert store.left_out == expected.left_out == report.skipped != {}
    assert store.data("list.txt") == b"ant/1 ant/2"
    assert all(store.size(name) == expected.size(name) for name in store.names)
    assert all(store.stamp(name) == expected.stamp(name) for name in store.names)
    assert not any(store.fault(name) for name in store.names)
    one, other, folder = (EventFolder(root) for root in (joined, whole, animals))
    assert one.classes == folder.classes == ["ant", "cat", "dog"]
    assert one.split_hash == other.split_hash
    check_same(one, other)
    for i in range(len(one)):
        first, last = one.recording(i).span
        window = (first + (last - first) // 3, last)
        assert one.recording(i).read(*window) == other.recording(i).read(*window)


def test_each_shard_has_recordings_of_all_classes_once(joined):
    names = [Store(shard_path(joined, (i, COUNT))).names for i in range(1, COUNT + 1)]
    assert all({name.split("/")[0] for name in own} == {"ant", "cat"} for own in names)
    assert sorted(chain.from_iterable(names)) == sorted(Store(joined).names)


@pytest.mark.parametrize("compress", [False, True])
def test_records_are_those_of_one_file(animals, tmp_path, compress):
    (alone,) = packed(animals, tmp_path / "b.nvs", 1, compress=compress)
    pack(EventFolder(animals), tmp_path / "whole.nvs", compress=compress)
    end = int(storefiles.index_of(alone)["place"][-1])
    assert alone.read_bytes()[BEGIN:end] == (tmp_path / "whole.nvs").read_bytes()[BEGIN:end]
    join([alone], tmp_path / "b.nvs")
    check_same(EventFolder(tmp_path / "b.nvs"), EventFolder(tmp_path / "whole.nvs"))


@pytest.mark.parametrize("events", range(1, 9))
def test_full_records_are_intact(tmp_path, events):
    """Of 8 numbers of events, one fills the record up, so that it ends where its shard does."""
    trees.put(tmp_path / "in", {f"c/{i}.bin": trees.atis(trees.some(i, events)) for i in range(2)})
    packed(tmp_path / "in", tmp_path / "a.nvs", 2)
    join([shard_path(tmp_path / "a.nvs", (i, 2)) for i in (1, 2)], tmp_path / "a.nvs")
    store = Store(tmp_path / "a.nvs")
    assert {name: store.fault(name) for name in store.names} == dict.fromkeys(["c/0.bin", "c/1.bin"], "")


def test_few_shards_are_open_at_a_time(joined, monkeypatch):
    monkeypatch.setattr(shards, "MOST_OPEN", 1)
    store = Store(joined)
    for _ in range(2):
        assert not any(store.fault(name) for name in store.names)
    assert len(store._shards._open) == 1


@pytest.mark.parametrize("one_file", [False, True])
def test_a_closed_store_cant_be_read(joined, animals, tmp_path, one_file):
    if one_file:
        pack(EventFolder(animals), joined, overwrite=True)
    store = Store(joined)
    name = store.names[0]
    recording = store.open(name, None)
    recording.read()
    store.close()
    with pytest.raises(ValueError, match="closed file"):
        store.open(name, None)


@pytest.mark.parametrize("workers", [0, 2])
def test_workers_read_shards(joined, animals, workers):
    context = "spawn" if workers else None
    loader = DataLoader(EventFolder(joined), batch_size=None, num_workers=workers, multiprocessing_context=context)
    assert [(len(events), target) for events, target in loader] == [
        (len(events), target) for events, target in EventFolder(joined)
    ]


def test_shards_are_found_from_another_folder_and_through_a_link(joined, tmp_path, monkeypatch):
    (tmp_path / "links").mkdir()
    (tmp_path / "links/b.nvs").symlink_to(joined)
    monkeypatch.chdir(tmp_path)
    one, other = EventFolder("a.nvs"), EventFolder("links/b.nvs")
    monkeypatch.chdir(tmp_path / "links")
    check_same(one, other)
    # as in a cache of the Hugging Face hub, where each file is a link to one with another name
    for number, path in enumerate(sorted(tmp_path.glob("a*.nvs"))):
        path.rename(tmp_path / f"blob{number}")
        (tmp_path / "links" / path.name).symlink_to(tmp_path / f"blob{number}")
    check_same(EventFolder("a.nvs"), one)


def test_a_lost_shard_is_named_and_left_out_on_request(joined):
    whole = EventFolder(joined)
    lost = {n for n, sample in enumerate(whole.samples) if sample.name in Store(shard_path(joined, (2, COUNT))).names}
    assert 0 < len(lost) < len(whole)
    events = [len(sample) for sample, _ in whole]
    shard_path(joined, (2, COUNT)).unlink()
    left = EventFolder(joined)  # opens without it
    for n in range(len(left)):
        if n in lost:
            with pytest.raises(FormatError, match=r"a-2-of-3\.nvs: this shard of the store is missing"):
                left[n]
        else:
            assert len(left[n][0]) == events[n]
    skipping = EventFolder(joined, errors="skip")
    with pytest.warns(UserWarning, match=r"a-2-of-3\.nvs"):
        sizes = [len(sample) for sample, _ in skipping]
    assert [size for n, size in enumerate(sizes) if n not in lost] == [e for n, e in enumerate(events) if n not in lost]
    assert set(skipping.damaged()) == {whole.samples[n].name for n in lost}


def test_a_damaged_shard_is_named_with_its_place(joined):
    shard = shard_path(joined, (3, COUNT))
    raw = bytearray(shard.read_bytes())
    place = int(storefiles.index_of(shard)["place"][1]) - 20
    raw[place] ^= 1
    shard.write_bytes(raw)
    name = Store(shard).names[0]
    store = Store(joined)
    assert store.fault(name)
    with pytest.raises(FormatError, match=r"a-3-of-3\.nvs:") as caught:
        store.open(name, None).read()
    assert BEGIN < caught.value.offset <= place
    assert all(not store.fault(other) for other in store.names if other != name)


def test_a_shard_of_another_pack_is_refused(joined, animals, tmp_path):
    shard = shard_path(joined, (1, COUNT))
    (animals / "ant/0.bin").write_bytes(trees.atis(trees.some(50)))
    pack(EventFolder(animals), tmp_path / "a.nvs", shard=(1, COUNT), overwrite=True)
    name = Store(shard).names[0]
    with pytest.raises(FormatError, match=r"a-1-of-3\.nvs: isn't the shard that was joined"):
        Store(joined).open(name, None)
    shard.write_bytes(shard.read_bytes()[:40])
    with pytest.raises(FormatError, match="isn't the shard that was joined"):
        Store(joined).open(name, None)


def test_a_dataset_says_that_a_shard_is_one(joined):
    with pytest.raises(ValueError, match=r"a-2-of-3\.nvs is shard 2/3 of a store: join all shards"):
        EventFolder(shard_path(joined, (2, COUNT)))


@pytest.mark.parametrize("shard", [(0, 2), (3, 2), (-1, 1), (True, 2), (1.0, 2), (1, 2, 2), "12", 1])
def test_impossible_shards(animals, tmp_path, shard):
    with pytest.raises(ValueError, match="shard must be"):
        pack(EventFolder(animals), tmp_path / "a.nvs", shard=shard)


def test_a_folder_in_place_of_a_shard_is_named(joined):
    shard = shard_path(joined, (2, COUNT))
    shard.unlink()
    shard.mkdir()
    ((path, (reason, lost)),) = Store(joined).lost().items()
    assert (path, len(lost)) == (str(shard), 2)
    assert "can't be opened" in reason


@needs_pipes
def test_a_pipe_in_place_of_a_shard_is_named(joined):
    shard = shard_path(joined, (2, COUNT))
    shard.unlink()
    os.mkfifo(shard)
    ((path, (reason, lost)),) = Store(joined).lost().items()
    assert (path, len(lost)) == (str(shard), 2)
    assert "is a pipe or a device" in reason


@needs_pipes
@pytest.mark.parametrize("opened", [Store, open_store])
def test_a_pipe_is_no_store(tmp_path, opened):
    os.mkfifo(tmp_path / "a.nvs")
    with pytest.raises(FormatError, match="is a pipe or a device, not a packed store"):
        opened(tmp_path / "a.nvs")


@pytest.mark.parametrize("change", [lambda raw: raw[:200], lambda raw: raw[:-1], lambda raw: raw + b"1"])
def test_a_shard_of_another_size_is_named_once(joined, change):
    shard = shard_path(joined, (2, COUNT))
    shard.write_bytes(change(shard.read_bytes()))
    (reason,) = [fault for name, fault in problems(joined) if "a-2-of-3" in name]
    assert reason == "is cut short, or has more bytes than it states: pack it again (2 recordings)"
    assert not [name for name, _ in problems(joined) if name in Store(joined).names]


def test_a_shard_continues_where_it_ended(animals, tmp_path, monkeypatch):
    (expected,) = (path.read_bytes() for path in packed(animals, tmp_path / "a.nvs", 2)[:1])
    (tmp_path / "again").mkdir()
    calls = []

    def interrupted(*given):
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(given)
        return decode(*given)

    decode = writer._decode
    monkeypatch.setattr(writer, "_decode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pack(EventFolder(animals), tmp_path / "again/a.nvs", shard=(1, 2))
    assert (tmp_path / "again/.a-1-of-2.nvs.part" / DATA).stat().st_size
    monkeypatch.setattr(writer, "_decode", decode)
    pack(EventFolder(animals), tmp_path / "again/a.nvs", shard=(1, 2))
    assert (tmp_path / "again/a-1-of-2.nvs").read_bytes() == expected


@pytest.mark.parametrize(
    "given",
    [
        "a",
        [["../a", 8, 1]],
        [["a/b", 8, 1]],
        [["..", 8, 1]],
        [["", 8, 1]],
        [["a", -8, 1]],
        [["a", 8.0, 1]],
        [["a", True, 1]],
        [["a", 8]],
        [[1, 8, 1]],
        [["a", 8, 1], ["a", 8, 1]],
        [{"file": "a"}],
        [["a", 8, 1]],
        [["a", 0, 1]],
    ],
)
def test_stated_shards_that_cant_be_are_refused(joined, given):
    storefiles.reindex(joined, storefiles.facts_of(storefiles.index_of(joined)) | {"shards": given})
    with pytest.raises(FormatError, match="join"):
        Store(joined)


@pytest.mark.parametrize(
    "given", [1, [1], [1, 2], [3, 2, ""], [0, 2, ""], [1, "2", ""], [1, 2, 3], [True, 2, ""], {}, "abc"]
)
def test_a_stated_shard_that_cant_be_is_refused(joined, given):
    path = shard_path(joined, (1, COUNT))
    storefiles.reindex(path, storefiles.facts_of(storefiles.index_of(path)) | {"shard": given})
    with pytest.raises(FormatError, match="impossible shard"):
        Store(path)


def test_shards_begin_with_records(joined):
    found = storefiles.index_of(joined)
    moved = [list(shard) for shard in found["shards"]]
    moved[0][1], moved[1][1] = moved[0][1] + 8, moved[1][1] - 8
    storefiles.reindex(joined, storefiles.facts_of(found) | {"shards": moved})
    with pytest.raises(FormatError, match="contradicts itself"):
        Store(joined)


def test_the_commands(animals, tmp_path, capsys):
    out = tmp_path / "a.nvs"
    for i, count, left_out in ((1, 3, 2), (2, 5, 0)):
        words = ["pack", str(animals), "--dataset", "folder", "--out", str(out), "--shard", f"{i}/2"]
        assert main([*words, "--dry-run"]) == 0
        assert f"{count + left_out} recordings" in capsys.readouterr().out
        assert main(words) == (left_out > 0)
        printed = f"{count} recordings, {60 * count} events in {shown(shard_path(out, (i, 2)))}; {left_out} left out\n"
        assert capsys.readouterr().out == printed
    files = [str(shard_path(out, (i, 2))) for i in (1, 2)]
    assert main(["join", *files[:1], "--out", str(out)]) == 1
    assert "1 of 2 shards are missing: 2/2" in capsys.readouterr().err
    assert main(["join", *files, "--out", str(out)]) == 0
    assert "8 recordings of 2 shards" in capsys.readouterr().out
    for path, count in ((out, 8), (files[0], 3), (files[1], 5)):
        main(["verify", str(path)])
        assert f"{count} recordings opened" in capsys.readouterr().out
    assert len(EventFolder(out)) == 8
    shard_path(out, (2, 2)).unlink()
    assert main(["verify", str(out)]) == 1
    *_, lost, split, guessed, total = capsys.readouterr().out.splitlines()
    assert guessed.startswith("3 recordings state no sensor size")
    assert lost == f"{shown(files[1])}: this shard of the store is missing: copy or pack it again (5 recordings)"
    assert split.startswith("split all: ")
    assert total == "3 recordings opened: 3 faults"
