"""Joining of shards, and sets of files that are refused."""

from __future__ import annotations

import shutil
from itertools import pairwise

import pytest
import storefiles
import trees
from distributions import check_same
from storefiles import COUNT, packed

import nvsdata
from nvsdata import NMNIST, EventFolder, FormatError, join, pack
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.shards import shard_path


def test_what_is_no_set_of_shards_is_refused(joined, animals, tmp_path):
    first, second, third = (shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1))
    out = tmp_path / "new.nvs"
    with pytest.raises(ValueError, match=r"1 of 3 shards are missing: 2/3"):
        join([first, third], out)
    with pytest.raises(ValueError, match="are the same shard"):
        join([first, second, third, second], out)
    with pytest.raises(FormatError, match=r"a\.nvs: isn't a shard"):
        join([joined], out)
    with pytest.raises(ValueError, match="no shards to join"):
        join([], out)
    (tmp_path / "other").mkdir()
    with pytest.raises(ValueError, match="move all shards there"):
        join([first, second, third], tmp_path / "other/new.nvs")
    with pytest.raises(FileExistsError):
        join([first, second, third], joined)
    other = trees.put(tmp_path / "more", {"ant/9.bin": trees.atis(trees.some(9))})
    shutil.copytree(animals, other, dirs_exist_ok=True)
    replaced = packed(other, tmp_path / "b.nvs")
    with pytest.raises(ValueError, match="of different datasets or runs"):
        join([first, second, replaced[2]], out)
    halves = packed(animals, tmp_path / "c.nvs", 2)
    with pytest.raises(ValueError, match="of different datasets or runs"):
        join([first, second, third, halves[0]], out)
    assert not out.exists()


def test_shards_without_recordings_are_joined_with_the_others(animals, tmp_path):
    files = packed(animals, tmp_path / "a.nvs", 12)
    assert join(files, tmp_path / "a.nvs") == 8
    pack(EventFolder(animals), tmp_path / "whole.nvs")
    check_same(EventFolder(tmp_path / "a.nvs"), EventFolder(tmp_path / "whole.nvs"))
    assert Store(tmp_path / "a.nvs").left_out == Store(tmp_path / "whole.nvs").left_out


@pytest.mark.parametrize("split", ["train", "test"])
def test_shards_of_one_split(tmp_path, split):
    names = [f"{part}/{kind}/{i}.bin" for part in ("train", "test") for kind in "ab" for i in range(3)]
    root = trees.put(tmp_path / "data", {name: trees.atis(trees.some(n)) for n, name in enumerate(names)})
    out = tmp_path / "a.nvs"
    for i in (1, 2):
        pack(EventFolder(root, split), out, shard=(i, 2))
    assert join([shard_path(out, (i, 2)) for i in (1, 2)], out) == len(EventFolder(root, split).recording_names())
    check_same(EventFolder(out, split), EventFolder(root, split))


def test_an_index_file_never_replaces_a_shard(joined):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    before = files[0].read_bytes()
    with pytest.raises(ValueError, match="is a shard: choose another name"):
        join(files, files[0], overwrite=True)
    assert files[0].read_bytes() == before


def test_places_follow_each_other(joined):
    found = storefiles.index_of(joined)
    assert [shard[0] for shard in found["shards"]] == [f"a-{i}-of-3.nvs" for i in (1, 2, 3)]
    assert all(a < b for a, b in pairwise(found["place"]))


def test_a_dataset_with_splits(home, tmp_path):
    root = home(trees.nmnist())
    out = tmp_path / "a.nvs"
    files = []
    for i in (1, 2):
        pack(NMNIST(root, "all"), out, shard=(i, 2))
        files.append(shard_path(out, (i, 2)))
    nvsdata.join(files, out)
    for split in ("train", "test", "all"):
        assert NMNIST(out, split).split_hash == NMNIST(root, split).split_hash
        check_same(NMNIST(out, split), NMNIST(root, split))


def test_a_shard_whose_name_no_index_can_have(joined, tmp_path):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    renamed = files[1].rename(tmp_path / "x:1.nvs")
    with pytest.raises(ValueError, match=r"x:1\.nvs: a shard's name can't have : or \\"):
        join([files[0], renamed, files[2]], tmp_path / "new.nvs")
    assert not (tmp_path / "new.nvs").exists()


@pytest.mark.parametrize("section", ["name", "left_out"])
def test_shards_with_the_same_recording(joined, tmp_path, section):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    (name, *_), others = Store(files[0]).names, storefiles.index_of(files[1])[section]
    changes = {"name": [name, *others[1:]]} if section == "name" else {"left_out": [name], "reason": ["empty"]}
    storefiles.reindex(files[1], **changes)
    with pytest.raises(ValueError, match=r"a-1-of-3\.nvs and the others contradict each other"):
        join(files, tmp_path / "new.nvs")
    assert not (tmp_path / "new.nvs").exists()


def test_shards_of_another_sensor_size(joined, animals, tmp_path):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    pack(EventFolder(animals, sensor_size=(300, 300)), joined, shard=(2, COUNT), overwrite=True)
    with pytest.raises(ValueError, match=r"a-2-of-3\.nvs and .*a-1-of-3\.nvs are of different datasets or runs"):
        join(files, tmp_path / "new.nvs")


def test_shards_of_the_same_sensor_size(animals, tmp_path):
    for i, size in ((1, (34, 34)), (2, [34, 34])):
        pack(EventFolder(animals, sensor_size=size), tmp_path / "b.nvs", shard=(i, 2))
    assert join([tmp_path / f"b-{i}-of-2.nvs" for i in (1, 2)], tmp_path / "b.nvs") == 8


def test_a_shard_is_packed_again_after_a_repair(joined, animals, tmp_path):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    (number,) = [n for n in range(COUNT) if "ant/4.bin" in Store(files[n]).left_out]
    (animals / "ant/4.bin").write_bytes(trees.atis(trees.some(20)))
    pack(EventFolder(animals), joined, shard=(number + 1, COUNT), overwrite=True)
    assert join(files, joined, overwrite=True) == 9
    assert set(Store(joined).left_out) == {"cat/3.bin"}


def test_a_link_stays_and_its_target_is_replaced(joined, tmp_path):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    expected = joined.read_bytes()
    (tmp_path / "large").mkdir()
    (tmp_path / "large/b.nvs").write_bytes(b"old")
    link = tmp_path / "b.nvs"
    link.symlink_to(tmp_path / "large/b.nvs")
    with pytest.raises(FileExistsError, match="--overwrite"):
        join(files, link)
    join(files, link, overwrite=True)
    assert link.is_symlink()
    assert (tmp_path / "large/b.nvs").read_bytes() == expected
    assert not [*tmp_path.glob(".*"), *(tmp_path / "large").glob(".*")]


def test_a_link_to_a_shard_is_not_followed(joined, tmp_path):
    files = [shard_path(joined, (i, COUNT)) for i in range(1, COUNT + 1)]
    before = files[1].read_bytes()
    (tmp_path / "b.nvs").symlink_to(files[1])
    with pytest.raises(ValueError, match="is a shard: choose another name"):
        join(files, tmp_path / "b.nvs", overwrite=True)
    assert files[1].read_bytes() == before
