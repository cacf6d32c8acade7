import os
import stat

import pytest
from processes_of_others import dead_owner

from nvsdata.common.files import atomic, creating, sweep
from nvsdata.common.locks import owner


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


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
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
    with atomic(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "a").read_text() == "new"
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o600
    (tmp_path / "a").unlink()
    with pytest.raises(FileExistsError), creating(tmp_path / "link", overwrite=False):
        pass
