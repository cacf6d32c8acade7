import json
import os
import sys

import pytest
import trees

from nvsdata.common.locks import owner
from nvsdata.datasets import source
from nvsdata.datasets.source import INDEX, Folder


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
