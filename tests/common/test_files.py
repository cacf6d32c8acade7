import errno
import os
import stat
import threading
import time
from pathlib import Path

import pytest
from processes_of_others import dead_owner

from nvsdata.common import files
from nvsdata.common.files import (
    Journal,
    append_own,
    atomic,
    creating,
    flushed_early,
    named,
    parsed_line,
    put,
    read_own,
    sweep,
)
from nvsdata.common.locks import OutputInUse, locked, owner


def test_the_file_appears_whole(tmp_path):
    with atomic(tmp_path / "a.txt") as temporary:
        temporary.write_text("half")
        assert not (tmp_path / "a.txt").exists()
        temporary.write_text("whole")
    assert (tmp_path / "a.txt").read_text() == "whole"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_nothing_remains_of_a_failure(tmp_path, error):
    (tmp_path / "a.txt").write_text("old")

    def fail_half_way():
        with atomic(tmp_path / "a.txt") as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        fail_half_way()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_failure_is_told_even_if_the_unfinished_file_is_gone(tmp_path):
    with pytest.raises(ValueError, match="half"), atomic(tmp_path / "a.txt") as temporary:  # noqa: PT012  it goes first
        temporary.unlink()
        raise ValueError("half")


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
def test_a_failure_is_told_even_if_the_unfinished_file_cannot_be_removed(tmp_path, monkeypatch):
    def refused(path, missing_ok=False):
        raise PermissionError(13, "open elsewhere", str(path))

    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(ValueError, match=r"^the cause$"), atomic(tmp_path / "a"):
        raise ValueError("the cause")


def test_permissions_are_those_of_a_plain_open(tmp_path):
    (tmp_path / "plain").write_text("")
    with atomic(tmp_path / "a") as temporary:
        temporary.write_text("x")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_a_missing_folder_is_said(tmp_path):
    with pytest.raises(FileNotFoundError), atomic(tmp_path / "no" / "a"):
        pass


def test_only_what_dead_processes_left_is_swept(tmp_path):
    (tmp_path / "deep").mkdir()
    dead, alive, foreign = dead_owner(), owner(), "0a1b2c-1"
    for who in (dead, alive, foreign):
        (tmp_path / f".a.h5.{who}-x1.part").touch()
        (tmp_path / f"deep/.b.h5.{who}-x1.part").touch()
    (tmp_path / ".mine.part").touch()
    assert sweep(tmp_path, "b.h5") == 0
    assert sweep(tmp_path, "a.h5") == 1
    assert not (tmp_path / f".a.h5.{dead}-x1.part").exists()
    assert sweep(tmp_path) == 1
    assert len(list(tmp_path.rglob("*.part"))) == 5


def test_a_name_as_long_as_the_system_allows(tmp_path):
    target = tmp_path / ("n" * 251 + ".txt")
    with atomic(target) as temporary:
        temporary.write_text("x")
    assert target.read_text() == "x"


@pytest.mark.skipif(os.name != "posix", reason="links and permissions as POSIX has them")
def test_links_stay_links_and_permissions_as_they_were(tmp_path):
    (tmp_path / "a").write_text("old")
    os.chmod(tmp_path / "a", 0o600)
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with atomic(tmp_path / "link", through_link=True) as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "a").read_text() == "new"
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o600
    # a name that the user didn't choose: the link itself is replaced, and what it leads to stays
    with atomic(tmp_path / "link") as temporary:
        temporary.write_text("other")
    assert not (tmp_path / "link").is_symlink()
    assert (tmp_path / "a").read_text() == "new"
    (tmp_path / "link").unlink()
    (tmp_path / "link").symlink_to(tmp_path / "a")
    (tmp_path / "a").unlink()
    with pytest.raises(FileExistsError), creating(tmp_path / "link", overwrite=False):
        pass


@pytest.mark.parametrize("size", [0, 1, 9, 10, 11, 25])
def test_bytes_are_put_whole(tmp_path, monkeypatch, size):
    monkeypatch.setattr(files, "_BLOCK", 10)
    content = bytes(range(size))
    put(str(tmp_path / "a"), memoryview(content))
    assert (tmp_path / "a").read_bytes() == content


@pytest.mark.parametrize(
    "corrupt", [lambda c: c[:-1], lambda c: c + b"x", lambda c: c[:-1] + b"x", lambda c: c[:-10] + b"x" + c[-9:]]
)
@pytest.mark.parametrize("size", [10, 25])
def test_a_disk_that_keeps_something_else_is_noticed(tmp_path, monkeypatch, corrupt, size):
    write = Path.write_bytes
    monkeypatch.setattr(files, "_BLOCK", 10)
    monkeypatch.setattr(Path, "write_bytes", lambda path, content: write(path, corrupt(content)))
    (tmp_path / "a").write_text("old")
    with pytest.raises(OSError, match="doesn't contain what was written to it: is the disk full, or broken") as raised:
        put(tmp_path / "a", b"0123456789abcdefghijklmnop"[:size])
    assert (raised.value.errno, raised.value.filename) == (errno.EIO, str(tmp_path / "a"))
    assert (tmp_path / "a").read_text() == "old"
    assert os.listdir(tmp_path) == ["a"]


def test_errors_without_a_file_get_one():
    def raised(error):
        with pytest.raises(OSError) as caught, named("a.h5"):  # noqa: PT011  which one is asked below
            raise error
        return caught.value

    full, other, odd = OSError(errno.ENOSPC, "full"), OSError(errno.ENOSPC, "full", "b"), OSError("odd")
    assert (raised(full).errno, raised(full).strerror, raised(full).filename) == (errno.ENOSPC, "full", "a.h5")
    assert raised(other) is other
    assert raised(odd) is odd


def test_what_is_there_is_replaced_only_if_wanted(tmp_path):
    (tmp_path / "a").touch()
    (tmp_path / "folder").mkdir()
    left = tmp_path / f".a.{dead_owner()}-x1.part"
    left.touch()
    for overwrite in (False, True):
        with pytest.raises(IsADirectoryError) as raised, creating(tmp_path / "folder", overwrite=overwrite):
            pass
        assert (raised.value.errno, raised.value.filename) == (errno.EISDIR, str(tmp_path / "folder"))
    with pytest.raises(FileExistsError, match="a already exists"), creating(tmp_path / "a", overwrite=False):
        pass
    with locked(tmp_path / "a"), pytest.raises(OutputInUse), creating(tmp_path / "a", overwrite=True):
        pass
    assert left.exists()
    with creating(tmp_path / "a", overwrite=True):
        assert not left.exists()


def test_names_of_unfinished_files(tmp_path):
    for name in ("n" * 100, "n" * 101):
        with atomic(tmp_path / name) as temporary:
            assert temporary.parent == tmp_path
            assert temporary.name.startswith(f".{'n' * 100}.{owner()}-")
            assert temporary.suffix == ".part"
    with pytest.raises(FileNotFoundError) as raised, atomic(tmp_path / "no" / "a"):
        pass
    assert (raised.value.errno, raised.value.filename) == (errno.ENOENT, str(tmp_path / "no"))


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
@pytest.mark.parametrize("umask", [0o000, 0o022, 0o077])
def test_a_new_file_is_readable_as_the_umask_says(tmp_path, umask):
    before = os.umask(umask)
    try:
        put(tmp_path / "a", b"x")
        assert os.umask(umask) == umask
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o666 & ~umask


@pytest.mark.skipif(not hasattr(os, "fdatasync"), reason="no fdatasync here")
def test_what_is_written_is_flushed_early(tmp_path, monkeypatch):
    flushed, path = [], tmp_path / "a"
    path.touch()
    monkeypatch.setattr(files, "FLUSH_EVERY", 0.0)
    monkeypatch.setattr(os, "fdatasync", lambda handle: flushed.append(os.path.samestat(os.fstat(handle), path.stat())))
    deadline = time.monotonic() + 30
    with flushed_early(path):
        while len(flushed) < 3:
            assert time.monotonic() < deadline
    assert all(flushed)
    # it ends with the block
    assert "nvsdata-flush" not in [thread.name for thread in threading.enumerate()]
    monkeypatch.delattr(os, "fdatasync")
    with flushed_early(path):
        pass


@pytest.mark.parametrize(
    ("text", "head", "lines", "repaired"),
    [
        (None, {"new": 1}, [], '{"new": 1}\n'),
        ("", {}, [], ""),
        ('{"a": 1}\n', {"a": 1}, [], '{"a": 1}\n'),
        ('{"a": 1}\n{"b": 2}\n{"c": 3}\n', {"a": 1}, [{"b": 2}, {"c": 3}], None),
        ('{"a": 1}\n{"b": 2}\n{"c": ', {"a": 1}, [{"b": 2}], '{"a": 1}\n{"b": 2}\n'),
        ('{"a": 1}\n{"b": 2}', {"a": 1}, [{"b": 2}], '{"a": 1}\n{"b": 2}\n'),
        ('{"a": 1}\n[5]\n{"c": 3}\n', {"a": 1}, [{"c": 3}], '{"a": 1}\n{"c": 3}\n'),
    ],
)
def test_a_journal_goes_on_after_a_torn_line(tmp_path, text, head, lines, repaired):
    path = tmp_path / "a.jsonl"
    if text is not None:
        path.write_text(text)
    journal = Journal(path, {"new": 1})
    assert (journal.head, journal.lines) == (head, lines)
    with journal:
        assert path.read_text() == (text if repaired is None else repaired)
        journal.add({"d": 4})
        # at once, not at the end
        assert path.read_text().endswith('{"d": 4}\n')
    assert path.read_text() == (text if repaired is None else repaired) + '{"d": 4}\n'
    with pytest.raises(ValueError, match="closed"):
        journal.add({"e": 5})


def test_lines_that_say_nothing():
    assert parsed_line(b'{"a": 1}') == {"a": 1}
    for torn in ('{"a":', "[1]", "", b"\xff", "5", "[" * 100_000, '{"a": ' * 100_000):
        assert parsed_line(torn) is None


@pytest.mark.parametrize("kind", ["link", "pipe", "folder", "huge"])
def test_a_file_of_our_own_is_a_regular_one_of_bounded_size(tmp_path, kind):
    path = tmp_path / "own"
    if kind == "link":
        (tmp_path / "a").write_bytes(b"secret")
        path.symlink_to(tmp_path / "a")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.write_bytes(b"x" * 11)
    with pytest.raises(OSError, match="own"):
        read_own(path, 10)
    if kind != "huge":
        with pytest.raises(OSError, match="own"):
            append_own(path)
    else:
        assert read_own(path, 11) == b"x" * 11
    if kind == "link":
        assert (tmp_path / "a").read_bytes() == b"secret"


def test_a_journal_is_not_kept_through_a_link(tmp_path):
    (tmp_path / "a").write_text("a text")
    (tmp_path / "j.jsonl").symlink_to(tmp_path / "a")
    with pytest.raises(OSError, match=r"j\.jsonl.*is a link|is a link.*j\.jsonl"):
        Journal(tmp_path / "j.jsonl", {"a": 1})
    assert (tmp_path / "a").read_text() == "a text"


def test_a_full_disk_is_an_error_of_the_file_also_of_journals(tmp_path):
    from disks import file_limit

    def fills(journal):
        journal.add({"b": "x" * 100})

    with Journal(tmp_path / "j.jsonl", {"a": 1}):
        pass
    with file_limit(40):
        with pytest.raises(OSError, match="large") as refused, atomic(tmp_path / "a") as temporary:
            temporary.write_bytes(bytes(100))
        assert refused.value.filename == str(tmp_path / "a")
        # closing writes again what wasn't taken
        with pytest.raises(OSError, match="large") as refused, Journal(tmp_path / "j.jsonl", {}) as journal:
            fills(journal)
        assert refused.value.filename == str(tmp_path / "j.jsonl")
