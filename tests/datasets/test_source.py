import json
import os
import sys

import pytest
import trees

from nvsdata.common.locks import owner
from nvsdata.datasets import source
from nvsdata.datasets.source import CACHE_TAG, INDEX, Folder, recordings_in


@pytest.fixture
def tree(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "REMEMBERED", 5)
    root = trees.put(tmp_path / "data", {f"{c}/{i}.bin": b"" for c in "ab" for i in range(4)} | {"list.txt": b"x"})
    for folder in (root, root / "a", root / "b"):
        os.utime(folder, ns=(10**18, 10**18))
    return root


EXPECTED = {".": ["list.txt"], "a": ["0.bin", "1.bin", "2.bin", "3.bin"], "b": ["0.bin", "1.bin", "2.bin", "3.bin"]}


def test_a_listing_is_remembered(tree, monkeypatch):
    assert Folder(tree).listing() == EXPECTED
    assert (tree / INDEX).exists()
    monkeypatch.setattr(os, "walk", lambda *_, **__: pytest.fail("walked again"))
    assert Folder(tree).listing() == EXPECTED


@pytest.mark.parametrize("change", ["add", "remove", "folder"])
def test_a_changed_folder_is_listed_anew(tree, change):
    Folder(tree).listing()
    if change == "add":
        (tree / "b" / "9.bin").write_bytes(b"")
    elif change == "remove":
        (tree / "a" / "2.bin").unlink()
    else:
        trees.put(tree, {"c/0.bin": b""})
    listing = Folder(tree).listing()
    assert listing != EXPECTED
    assert listing == Folder(tree).listing()


def test_a_folder_that_changed_just_before_it_was_listed_is_not_trusted(tree):
    (tree / "a" / "new.bin").write_bytes(b"")
    Folder(tree).listing()
    before = os.stat(tree / "a").st_mtime_ns
    (tree / "a" / "late.bin").write_bytes(b"")
    os.utime(tree / "a", ns=(before, before))
    assert "late.bin" in Folder(tree).listing()["a"]


def test_what_a_killed_process_left_of_an_index_is_swept(tree):
    host = owner().rpartition("-")[0]
    left = tree / f".{INDEX}.{host}-4194304-abc.part"
    left.write_bytes(b"half")
    os.utime(tree, ns=(10**18, 10**18))
    assert Folder(tree).listing() == EXPECTED
    assert not left.exists()


@pytest.mark.parametrize("content", ["", "{", "[]", json.dumps({"version": 0}), json.dumps({"version": 1})])
def test_a_damaged_index_is_made_anew(tree, content):
    (tree / INDEX).write_text(content)
    assert Folder(tree).listing() == EXPECTED


def test_small_folders_hidden_files_and_links_in_a_circle(tmp_path):
    root = trees.put(tmp_path / "data", {"a/0.bin": b"", "a/.hidden": b"", ".git/x": b""})
    os.symlink(root, root / "a" / "again")
    listing = Folder(root).listing()
    assert listing["a"] == ["0.bin"]
    assert not (root / INDEX).exists()


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names must be text there")
def test_names_of_any_bytes_are_remembered(tree, monkeypatch):
    odd = ["a\nb.bin", "\udcff.bin", "\u00e4.bin"]
    trees.put(tree, {f"c\n\udc80/{name}": b"" for name in odd})
    for folder in (tree, tree / "c\n\udc80"):
        os.utime(folder, ns=(10**18, 10**18))
    assert Folder(tree).listing()["c\n\udc80"] == sorted(odd)
    monkeypatch.setattr(os, "walk", lambda *_, **__: pytest.fail("walked again"))
    assert Folder(tree).listing()["c\n\udc80"] == sorted(odd)


def test_2000_files_are_worth_an_index(tmp_path):
    for number in range(1_999):
        (tmp_path / f"{number}.bin").touch()
    for files in (1_999, 2_000):
        (tmp_path / f"{files - 1}.bin").touch()
        assert len(Folder(tmp_path).listing()["."]) == files
        assert (tmp_path / INDEX).exists() == (files == 2_000)


@pytest.mark.parametrize(
    ("folder", "version", "made", "trusted"),
    [
        # of ns since 1970: an index counts if it was made more than 2 s after the last change
        ("a", 1, 10**18 + 2 * 10**9, True),
        ("a", 1, 10**18 + 2 * 10**9 - 1, False),
        ("a", 0, 10**18 + 10**10, False),
        ("a", 2, 10**18 + 10**10, False),
        ("gone", 1, 10**18 + 10**10, False),
    ],
)
def test_which_index_is_trusted(tmp_path, folder, version, made, trusted):
    trees.put(tmp_path, {"a/1.bin": b""})
    files = {".": [], folder: ["of the index.bin"]}
    index = {"version": version, "made": made, "times": {".": 10**18, folder: 10**18}, "files": files}
    (tmp_path / INDEX).write_text(json.dumps(index))
    for path in (tmp_path / "a", tmp_path):
        os.utime(path, ns=(10**18, 10**18))
    assert Folder(tmp_path).listing() == (files if trusted else {".": [], "a": ["1.bin"]})


def test_an_index_that_can_not_be_written_is_no_fault(tree):
    (tree / INDEX).mkdir()
    for _ in range(2):
        assert Folder(tree).listing() == EXPECTED


def test_folders_of_caches_and_those_far_below_are_left_out(tmp_path):
    deep = "/".join("123456789abc")
    files = {f"{deep[:n]}/x.bin": b"" for n in range(1, 24, 2)} | {"kept/1.bin": b"", "kept/x/2.bin": b""}
    trees.put(tmp_path, files | {f"kept/{CACHE_TAG}": b"", CACHE_TAG: b"", "__pycache__/1.bin": b""})
    listing = Folder(tmp_path).listing()
    # the root is what was asked for
    assert listing["."] == [CACHE_TAG]
    assert [name for name in listing if "kept" in name or "__" in name] == []
    assert max(name.count("/") for name in listing) == 8


def test_what_recordings_are_called_in_any_case():
    found = recordings_in({".": ["1.BIN", "2.bin", "bin", "3.bin.txt2"], "a": ["4.Aedat4", "5.jpg"]})
    assert list(found) == ["1.BIN", "2.bin", "a/4.Aedat4"]


def test_a_file_is_settled_two_seconds_before_and_after_its_change(tmp_path):
    (tmp_path / "1.bin").write_bytes(b"abc")
    os.utime(tmp_path / "1.bin", ns=(10**18, 10**18))
    folder = Folder(tmp_path)
    assert (folder.size("1.bin"), folder.stamp("1.bin")) == (3, (3, 10**18))
    assert (folder.split, folder.left_out) == ("all", {})
    for sign in (-1, 1):
        assert not folder.settled("1.bin", 10**18 + sign * 2 * 10**9)
        assert folder.settled("1.bin", 10**18 + sign * (2 * 10**9 + 1))
