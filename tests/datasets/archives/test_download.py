"""Datasets downloaded from a server on this machine: whole, or not at all, whatever befalls the process."""

from __future__ import annotations

import hashlib
import io
import multiprocessing
import os
import random
import re
import shutil
import signal
import time
import zipfile
from dataclasses import replace

import pytest
import trees
from hosts import hosting

from nvsdata.cli import main
from nvsdata.common.errors import DownloadError
from nvsdata.common.locks import OutputInUse, lock_path, locked
from nvsdata.datasets import DATASETS, NMNIST, DVS128Gesture, NCaltech101
from nvsdata.datasets.archives import download as module
from nvsdata.datasets.archives.download import WORK, download, unneeded_archives
from nvsdata.datasets.facts import Archive, Info

CONTENT = trees.zipped({f"Train/{d}/{i}.bin": random.Random(d).randbytes(10_000) for d in range(10) for i in range(3)})


@pytest.fixture(autouse=True)
def _no_mirror(monkeypatch):
    monkeypatch.delenv("NVSDATA_MIRROR", raising=False)


@pytest.fixture
def host():
    with hosting() as host:
        yield host


@pytest.fixture
def root(tmp_path):
    return tmp_path / "data" / "made-up"


def dataset(*archives):
    return Info("made-up", None, ("a",), "https://example.org", "none", archives)


def archive(url, content=CONTENT, name="Train"):
    return Archive(f"{name}.zip", hashlib.md5(content).hexdigest(), (url,), name)


def left(root):
    return sorted(p.relative_to(root).as_posix() for p in root.iterdir())


def check_whole(root):
    assert len(list((root / "Train").glob("[0-9]/*.bin"))) == 30
    assert all(p.stat().st_size == 10_000 for p in (root / "Train").glob("*/*.bin"))
    assert left(root) == ["Train", "Train.zip"]


def test_download_and_unpack(host, root):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    assert download(info, root) == [root / "Train"]
    check_whole(root)
    host.asked.clear()
    assert download(info, root) == [root / "Train"]
    assert host.asked == []


def test_archives_are_deleted_only_if_asked_and_only_what_is_unpacked(host, root):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    assert download(info, root, keep=False) == [root / "Train"]
    assert left(root) == ["Train"]
    # what is unpacked isn't fetched again
    host.asked.clear()
    assert download(info, root, keep=False) == [root / "Train"]
    assert host.asked == []
    # one that an earlier run kept, or that was put there by hand
    (root / "Train.zip").write_bytes(CONTENT)
    (root / "other.zip").write_bytes(CONTENT)
    assert unneeded_archives(info.archives, root) == [root / "Train.zip"]
    download(info, root)
    assert left(root) == ["Train", "Train.zip", "other.zip"]
    download(info, root, keep=False)
    assert left(root) == ["Train", "other.zip"]
    (root / "Train.zip").write_bytes(CONTENT)
    shutil.rmtree(root / "Train")
    assert unneeded_archives(info.archives, root) == []


def test_what_was_neither_unpacked_nor_is_the_archive_stays(host, root, monkeypatch):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    (root / "Train").mkdir(parents=True)
    (root / "Train/mine.txt").write_text("of the user")
    # not the archive
    (root / "Train.zip").write_bytes(b"another")
    download(info, root, keep=False)
    assert left(root) == ["Train", "Train.zip"]
    # nobody knows what it is
    unknown = dataset(replace(info.archives[0], hash=""))
    (root / "Train.zip").write_bytes(CONTENT)
    download(unknown, root, keep=False)
    assert left(root) == ["Train", "Train.zip"]
    # of a folder of archives that others may need
    monkeypatch.setenv("NVSDATA_MIRROR", str(root))
    download(info, root, keep=False)
    assert left(root) == ["Train", "Train.zip"]
    shutil.rmtree(root / "Train")
    download(info, root, keep=False)
    assert left(root) == ["Train", "Train.zip"]
    monkeypatch.delenv("NVSDATA_MIRROR")
    download(info, root, keep=False)
    assert left(root) == ["Train"]


@pytest.mark.parametrize("how", ["gone", "changed", "cut", "a zip within"])
def test_an_archive_stays_unless_all_of_it_is_in_its_folder(host, root, how):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    content = CONTENT
    if how == "a zip within":
        inner, outer = io.BytesIO(), io.BytesIO()
        with zipfile.ZipFile(inner, "w") as made:
            made.writestr("a.txt", "a")
        with zipfile.ZipFile(outer, "w") as made:
            made.writestr("Train/more.zip", inner.getvalue())
        content = outer.getvalue()
        info = dataset(archive(host.serve("/within", content), content))
    download(info, root)
    (root / "Train.zip").write_bytes(content)
    victim = next(path for path in sorted((root / "Train").rglob("*")) if path.is_file())
    before = victim.read_bytes()
    if how == "gone":
        victim.unlink()
        (root / "Train/other.txt").write_text("so that the folder isn't empty")
    else:
        victim.write_bytes(before[:-1] if how == "cut" else bytes([before[0] ^ 1]) + before[1:])
    with pytest.warns(UserWarning, match=rf"Train\.zip is kept: .*{re.escape(str(victim))} is (missing|different)"):
        download(info, root, keep=False)
    assert left(root) == ["Train", "Train.zip"]
    victim.write_bytes(before)
    download(info, root, keep=False)
    assert left(root) == ["Train"]


def test_the_command_deletes_archives_or_says_that_it_may(host, root, capsys, monkeypatch):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    monkeypatch.setattr(NMNIST, "info", info)
    assert main(["download", "n-mnist", "--root", str(root)]) == 0
    output = "1 archives with 0.00 GB are still in {}: --delete-archives deletes them\n"
    assert output.format(root) in capsys.readouterr().err
    assert main(["download", "n-mnist", "--root", str(root), "--delete-archives"]) == 0
    assert capsys.readouterr() == (f"{root / 'Train'}\n", "")
    assert left(root) == ["Train"]


def test_a_mirror_may_be_given_to_the_command(host, root, capsys, monkeypatch):
    monkeypatch.setenv("NVSDATA_MIRROR", "")
    gone = archive(f"{host.address}/gone")
    monkeypatch.setattr(NMNIST, "info", dataset(gone))
    (root / "mirror").mkdir(parents=True)
    (root / "mirror/Train.zip").write_bytes(CONTENT)
    how = ["download", "n-mnist", "--root", str(root / "data"), "--mirror", str(root / "mirror")]
    assert main([*how, "--dry-run"]) == 0
    assert f"tried first: {root / 'mirror'}\n" in capsys.readouterr().out
    assert main([*how, "--delete-archives"]) == 0
    assert left(root / "data") == ["Train"]
    # a mirror is not ours to delete from
    assert left(root / "mirror") == ["Train.zip"]


def test_an_archive_may_hold_the_folder_or_what_belongs_into_it(host, root):
    bare = trees.zipped({"0/a.bin": b"1", "1/b.bin": b"2"})
    download(dataset(archive(host.serve("/bare", bare), bare)), root)
    assert left(root / "Train") == ["0", "1"]


def test_what_is_unpacked_needs_no_lock(host, root):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    download(info, root)
    with locked(root):
        assert download(info, root) == [root / "Train"]
        assert lock_path(root).exists()
    # one that a killed process left goes
    lock_path(root).touch()
    download(info, root)
    check_whole(root)


def test_two_downloads_to_one_folder(host, root, capsys, monkeypatch):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    monkeypatch.setattr(NMNIST, "info", info)
    root.mkdir(parents=True)
    with locked(root):
        with pytest.raises(OutputInUse, match=f"is being written by process {os.getpid()} on "):
            download(info, root)
        assert main(["download", "n-mnist", "--root", str(root)]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"nvsdata download: {root} is being written by process")
    assert error.count("\n") == 1
    assert host.asked == []
    assert main(["download", "NMNIST", "--root", str(root)]) == 0
    assert capsys.readouterr().out == f"{root / 'Train'}\n"
    check_whole(root)


def killed(work, when):
    """Run `work` in a process of its own and end it by SIGKILL once `when()` holds."""
    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    until = time.monotonic() + 20
    while not when() and process.is_alive():
        assert time.monotonic() < until
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert process.exitcode == -signal.SIGKILL


needs_fork = pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")


@needs_fork
def test_a_kill_during_the_transfer_costs_nothing_that_came(host, root):
    part = root / WORK / "Train.zip.part"
    # the connection breaks at 100,000 bytes; the process dies in the pause that follows
    info = dataset(archive(host.serve("/whole", CONTENT, cuts=[100_000])))
    killed(lambda: download(info, root), lambda: part.exists() and part.stat().st_size == 100_000)
    assert not (root / "Train").exists()
    assert not (root / "Train.zip").exists()
    download(info, root)
    assert host.asked == [("/whole", 0), ("/whole", 100_000)]
    check_whole(root)


@needs_fork
def test_a_kill_during_unpacking_leaves_nothing_half_done(host, root, monkeypatch):
    info = dataset(archive(host.serve("/whole", CONTENT)))
    unpacked = root / WORK / "unpacked"

    def slow(path, folder):
        folder.mkdir()
        (folder / "half.bin").write_bytes(b"x")
        time.sleep(60)

    with monkeypatch.context() as patched:
        patched.setattr(module, "unpack", slow)
        killed(lambda: download(info, root), lambda: (unpacked / "half.bin").exists())
    assert not (root / "Train").exists()
    download(info, root)
    assert [path for path, _ in host.asked] == ["/whole"]
    assert not list(root.rglob("half.bin"))
    check_whole(root)


def test_what_killed_writers_left_in_the_folder_is_swept(host, root):
    from processes_of_others import dead_owner

    root.mkdir(parents=True)
    (root / f".labels.csv.{dead_owner()}-abc.part").touch()
    (root / ".mine.part").touch()
    download(dataset(archive(host.serve("/whole", CONTENT))), root)
    assert left(root) == [".mine.part", "Train", "Train.zip"]


def test_nothing_of_the_users_is_written_over_or_removed(host, root):
    wrong = trees.zipped({"...zip": trees.zipped({"x": b"1"}), "a": b"1"})
    mine = {"notes.zip": CONTENT, "Train.zip.part": b"a browser's", ".Train.part/x": b"1", "Test/0.bin": b"mine"}
    for name, data in mine.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(data)

    def check(more=()):
        assert {name: (root / name).read_bytes() for name in mine} == mine
        assert set(left(root)) == {name.split("/")[0] for name in mine} | set(more)

    with pytest.raises(DownloadError, match=r"refused to unpack '...zip'"):
        download(dataset(archive(host.serve("/wrong", wrong), wrong)), root)
    check(["Train.zip"])
    (root / "Train.zip").unlink()
    (root / "Train").write_bytes(b"a file")
    info = dataset(archive(host.serve("/whole", CONTENT)), archive(host.address + "/none", name="Test"))
    with pytest.raises(DownloadError, match="Train is a file, where a folder is to be unpacked"):
        download(info, root)
    assert (root / "Train").read_bytes() == b"a file"
    (root / "Train").unlink()
    # an empty folder of the name is as good as none, one that holds something is taken as it is
    (root / "Train").mkdir()
    assert download(info, root) == [root / "Train", root / "Test"]
    check(["Train", "Train.zip"])
    assert [path for path, _ in host.asked] == ["/wrong", "/whole"]


def test_an_archive_of_unknown_hash_that_is_damaged_can_be_had_again(host, root):
    raw = bytearray(CONTENT)
    raw[60:70] = bytes(10)
    info = dataset(replace(archive(host.serve("/a", bytes(raw))), hash=""))
    with pytest.raises(DownloadError, match=f"Train.zip: can't unpack .*; move {root}/Train.zip away to download"):
        download(info, root)
    assert left(root) == ["Train.zip"]


def test_what_is_optional_only_gives_a_warning(host, root):
    needed = archive(host.serve("/whole", CONTENT))
    by_hand = replace(archive("", name="More"), urls=(), optional=True)
    with pytest.warns(UserWarning, match=f"without More: put More.zip from https://example.org into {root}"):
        assert download(dataset(needed, by_hand), root) == [root / "Train"]
    check_whole(root)
    gone = replace(by_hand, urls=(host.address + "/gone",))
    with pytest.warns(UserWarning, match="without More: can't download More.zip.*\n.*404"):
        assert download(dataset(needed, gone), root) == [root / "Train"]
    assert left(root) == ["Train", "Train.zip"]
    (root / "More.zip").write_bytes(CONTENT)
    assert download(dataset(needed, by_hand), root) == [root / "Train", root / "More"]


def test_datasets_download_themselves_and_stores_do_not(tmp_path, monkeypatch):
    for part in ("Train", "Test"):
        files = {name: data for name, data in trees.nmnist().items() if name.startswith(part)}
        (tmp_path / f"{part}.zip").write_bytes(trees.zipped(files))
    known = tuple(
        replace(a, hash=hashlib.md5((tmp_path / a.name).read_bytes()).hexdigest()) for a in NMNIST.info.archives
    )
    monkeypatch.setattr(NMNIST, "info", replace(NMNIST.info, archives=known))
    monkeypatch.setenv("NVSDATA_MIRROR", str(tmp_path))
    assert len(NMNIST(tmp_path / "new", download=True)) == 30
    assert left(tmp_path / "new") == ["Test", "Train"]
    assert main(["pack", str(tmp_path / "new"), "--dataset", "n-mnist", "--out", str(tmp_path / "n.h5")]) == 0
    assert len(NMNIST(tmp_path / "n.h5", download=True)) == 30


def test_archives_are_declared_so_that_they_can_be_had():
    for name, kind in DATASETS.items():
        archives = kind.info.archives
        assert len({a.name for a in archives}) == len({a.folder for a in archives}) == len(archives), name
        for a in (*archives, *(a.within for a in archives if a.within)):
            assert len(a.hash) in (0, 32, 64)
            assert all(url.startswith(("https://", "http://")) for url in a.urls)
            assert a.within is None or (a.hash and a.within.hash and a.within.urls)
    assert DVS128Gesture.info.archives[0].urls
    assert not NCaltech101.info.archives[0].optional
    assert NCaltech101.info.archives[1].optional
