"""Downloads that are killed at any moment, run twice at once, or find the disk full."""

from __future__ import annotations

import os
import random
import shutil
import time

import pytest
import trees
from disks import PAGE, small_disk
from hosts import hosting
from test_kills import MOMENTS, finish, start
from test_two_at_once import refused_while_running

from nvsdata.datasets.archives import transfer
from nvsdata.datasets.archives.download import download
from nvsdata.datasets.facts import Archive, Info

pytestmark = pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
NAME, FILE, FOLDER = "ucf101-dvs", "UCF101-DVS.zip", "UCF101_DVS"  # of an unknown hash
SECONDS = 0.5  # that its transfer takes


def recordings(count: int, size: int) -> dict[str, bytes]:
    return {f"Archery/v_Archery_g01_c{i:02d}.mat": random.Random(i).randbytes(size) for i in range(count)}


def content(root):
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}


@pytest.fixture
def slow_host(monkeypatch):
    files = recordings(40, 20_000)
    packed = {"part.zip": trees.zipped(dict(list(files.items())[:20]))} | dict(list(files.items())[20:])
    with hosting() as host:
        monkeypatch.setenv("NVSDATA_MIRROR", host.address)
        body = trees.zipped(packed)
        host.serve(f"/{NAME}/{FILE}", body, headers={"ETag": '"1"'}, seconds=SECONDS)
        host.expected = {
            f"{FOLDER}/{'part/' if k < 20 else ''}{name}": data for k, (name, data) in enumerate(files.items())
        } | {FILE: body}
        yield host


@pytest.mark.long
def test_downloads_that_are_killed_at_many_moments(slow_host, tmp_path):
    words = ("download", NAME, "--root")
    finish(*words, tmp_path / "unkilled")
    assert content(tmp_path / "unkilled") == slow_host.expected
    moment, gone_on = random.Random(0), 0
    for n in range(MOMENTS):
        root = tmp_path / str(n)
        slow_host.asked.clear()
        process = start(*words, root)
        # what comes before is Python and torch being loaded
        while not slow_host.asked and process.poll() is None:
            time.sleep(0.01)
        time.sleep(moment.uniform(0, 1.5 * SECONDS))
        process.kill()
        process.communicate()
        assert not (root / FOLDER).exists() or len(content(root / FOLDER)) == 40, f"killed at moment {n}"
        slow_host.asked.clear()
        finish(*words, root)
        gone_on += any(begin for _, begin in slow_host.asked)
        assert content(root) == slow_host.expected, f"killed at moment {n}"
        shutil.rmtree(root)
    assert gone_on > 0, "none was killed during its transfer"


@pytest.mark.long
def test_two_downloads(slow_host, tmp_path):
    refused_while_running(tmp_path / "data/.nvsdata.lock", "download", NAME, "--root", tmp_path / "data")
    assert content(tmp_path / "data") == slow_host.expected


@pytest.mark.parametrize("message", [True, False], ids=["room is checked", "room is found out"])
def test_disks_of_any_size(tmp_path, monkeypatch, message):
    monkeypatch.delenv("NVSDATA_MIRROR", raising=False)
    monkeypatch.setattr(transfer.time, "sleep", lambda _: None)
    if not message:
        plenty = shutil.disk_usage("/")._replace(free=1 << 40)
        monkeypatch.setattr(shutil, "disk_usage", lambda _: plenty)
    files = recordings(4, 6_000)
    body = trees.zipped({"in.zip": trees.zipped(files), "list.txt": b"1"})
    with hosting() as host, small_disk(tmp_path / "disk") as resize:
        info = Info("a", None, ("a",), "", "", (Archive("a.zip", "", (host.serve("/a", body),), "a"),))
        outcomes = []
        for size in range(PAGE, 60 * PAGE, PAGE):
            resize(size)
            root = tmp_path / "disk" / "root"
            reason = ""
            try:
                download(info, root)
            except OSError as error:
                reason = str(error)
            outcomes.append(not reason)
            if reason:
                assert "left" in reason or "No space left on device" in reason
                assert not (root / "a").exists()
                assert not (root / "a.zip").exists() or (root / "a.zip").read_bytes() == body
            # with more room it goes on with what is there
            resize(400 * PAGE)
            download(info, root)
            assert content(root) == {"a.zip": body, "a/list.txt": b"1"} | {f"a/in/{n}": d for n, d in files.items()}
            shutil.rmtree(root)
    assert outcomes == sorted(outcomes)
    assert {*outcomes} == {False, True}
