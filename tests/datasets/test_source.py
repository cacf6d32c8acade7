import os
import sys

import pytest
import trees

from nvsdata.common.locks import owner
from nvsdata.datasets import source
from nvsdata.datasets.source import CACHE_TAG, INDEX, Folder, load_facts, recordings_in, save_facts


@pytest.fixture
def tree(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "MANY_FILES", 5)
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


@pytest.mark.parametrize("content", ["", "{", "[]", "{}\n{}", "[2, 0]\n{}", "\0" * 50, "[" * 100_000, "[2, 1e999]\n{}"])
def test_a_damaged_index_is_made_anew(tree, content):
    (tree / INDEX).write_text(content)
    assert Folder(tree).listing() == EXPECTED


def altered(tree, change):
    """The index changed by somebody who knows how it is kept, checksum and all."""
    Folder(tree).listing()
    index = load_facts(tree / INDEX)
    change(index)
    save_facts(tree / INDEX, index)
    os.utime(tree, ns=(10**18, 10**18))


ALTERED = {
    "no times": lambda index: index["times"].clear(),
    "nothing": lambda index: index.clear(),
    "files elsewhere": lambda index: index["files"]["a"].append("../../secret.h5"),
    "a folder elsewhere": lambda index: (index["files"] | index["times"], index["files"].update({"a/../..": ["x.h5"]})),
    "an absolute folder": lambda index: (index["files"].update({"/etc": ["x"]}), index["times"].update({"/etc": 1})),
    "a hidden recording": lambda index: index["files"]["a"].pop(),
    "a hidden folder": lambda index: (index["files"].pop("b"), index["times"].pop("b")),
    "a recording that isn't there": lambda index: index["files"]["b"].append("9.bin"),
    "names that are no text": lambda index: index["files"].update({"a": [1, 2]}),
    "no list of names": lambda index: index["files"].update({"a": None}),
    "a list of folders": lambda index: index.update(files=[], times=[]),
    "times that are no numbers": lambda index: index["times"].update({"a": None}),
    "made at no time": lambda index: index.update(made=None),
}


@pytest.mark.parametrize("how", ALTERED)
def test_an_index_altered_with_its_checksum_is_found_out(tree, how):
    altered(tree, ALTERED[how])
    assert Folder(tree).listing() == EXPECTED


def test_what_is_in_the_place_of_an_index_is_neither_followed_nor_waited_for(tree):
    secret = tree.parent / "secret.txt"
    Folder(tree).listing()
    for content in (b"a secret", (tree / INDEX).read_bytes()):
        secret.write_bytes(content)
        (tree / INDEX).unlink()
        (tree / INDEX).symlink_to(secret)
        assert Folder(tree).listing() == EXPECTED
        assert secret.read_bytes() == content
    (tree / INDEX).unlink()
    if hasattr(os, "mkfifo"):
        os.mkfifo(tree / INDEX)
        assert Folder(tree).listing() == EXPECTED
        (tree / INDEX).unlink()
    with (tree / INDEX).open("wb") as file:
        file.truncate(source.MOST_BYTES + 1)
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
        ("a", 2, 10**18 + 2 * 10**9, True),
        ("a", 2, 10**18 + 2 * 10**9 - 1, False),
        ("a", 1, 10**18 + 10**10, False),
        ("a", 3, 10**18 + 10**10, False),
        ("gone", 2, 10**18 + 10**10, False),
    ],
)
def test_which_index_is_trusted(tmp_path, monkeypatch, folder, version, made, trusted):
    trees.put(tmp_path, {"a/1.bin": b""})
    files = {".": [], folder: ["1.bin"]}
    with monkeypatch.context() as patch:
        patch.setattr(source, "VERSION", version)
        save_facts(tmp_path / INDEX, {"made": made, "times": {".": 10**18, folder: 10**18}, "files": files})
    for path in (tmp_path / "a", tmp_path):
        os.utime(path, ns=(10**18, 10**18))
    walked = []
    monkeypatch.setattr(os, "walk", lambda *given, real=os.walk, **how: walked.append(1) or real(*given, **how))
    assert Folder(tmp_path).listing() == {".": [], "a": ["1.bin"]}
    assert (walked == []) == trusted


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
