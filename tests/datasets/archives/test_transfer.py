"""Transfers from a server on this machine that breaks off, lies and changes its mind."""

from __future__ import annotations

import hashlib
import json
import random
import shutil

import pytest
import trees

from nvsdata.common.errors import DownloadError
from nvsdata.datasets.archives import transfer
from nvsdata.datasets.archives.transfer import fetch
from nvsdata.datasets.facts import Archive, Info

INFO = Info("made-up", None, ("a",), "https://example.org/made-up", "none")
CONTENT, OTHER = (trees.zipped({"a/1.bin": random.Random(seed).randbytes(500_000)}) for seed in (1, 2))
DAY, NEXT_DAY = (f"{day}, 2{n} Nov 2026 07:28:00 GMT" for day, n in (("Sat", 1), ("Sun", 2)))


@pytest.fixture
def get(tmp_path):
    """A function that fetches `Train.zip` from addresses; its hash is that of `content`, unknown for None."""

    def run(*urls, content=CONTENT, **facts):
        known = "" if content is None else hashlib.md5(content).hexdigest()
        (tmp_path / "root/work").mkdir(parents=True, exist_ok=True)
        return fetch(Archive("Train.zip", known, urls, "Train", **facts), tmp_path / "root", part.parent, INFO)

    part = tmp_path / "root/work/Train.zip.part"
    run.part, run.root = part, tmp_path / "root"
    return run


def test_a_transfer_goes_on_where_it_broke_after_longer_and_longer_pauses(host, get, pauses):
    url = host.serve("/a", CONTENT, cuts=[100_000] * 4, headers={"ETag": '"1"'})
    assert get(url).read_bytes() == CONTENT
    assert [begin for _, begin in host.asked] == [0, 100_000, 200_000, 300_000, 400_000]
    assert pauses == [1, 2, 4, 8]
    assert list(get.part.parent.iterdir()) == []


def test_pauses_are_bounded_and_short_again_after_much(host, get, pauses, monkeypatch):
    monkeypatch.setattr(transfer, "LONGEST_PAUSE", 4)
    monkeypatch.setattr(transfer, "MUCH", 99_999)
    get(host.serve("/a", CONTENT, cuts=[50_000] * 4 + [100_000, 50_000]))
    assert pauses == [1, 2, 4, 4, 1, 2]


def test_tries_that_bring_nothing_end(host, get, pauses):
    url = host.serve("/a", CONTENT, cuts=[100_000] + [0] * 9)
    with pytest.raises(DownloadError, match=r"/a: .*(broke off|broken|Read)"):
        get(url)
    assert len(host.asked) == 1 + transfer.TRIES
    # what came is kept, and gone on with by the next run
    host.files["/a"].cuts.clear()
    assert get(url).read_bytes() == CONTENT
    assert host.asked[-1] == ("/a", 100_000)


def test_a_server_without_ranges_is_asked_for_all_again_but_not_for_ever(host, get):
    assert get(host.serve("/a", CONTENT, cuts=[100_000, 50_000], ranges=False)).read_bytes() == CONTENT
    shutil.rmtree(get.root)
    host.asked.clear()
    with pytest.raises(DownloadError):
        get(host.serve("/b", CONTENT, cuts=[100_000] * 50, ranges=False))
    assert len(host.asked) == 1 + transfer.TRIES


def test_what_came_whole_before_a_kill_is_not_asked_for_again(host, get):
    url = host.serve("/a", CONTENT)
    get.part.parent.mkdir(parents=True)
    get.part.write_bytes(CONTENT)
    assert get(url).read_bytes() == CONTENT
    assert host.asked == [("/a", len(CONTENT))]


def test_a_part_that_is_longer_than_the_file_is_dropped(host, get):
    get.part.parent.mkdir(parents=True)
    get.part.write_bytes(CONTENT + b"more")
    assert get(host.serve("/a", CONTENT)).read_bytes() == CONTENT
    assert [begin for _, begin in host.asked] == [len(CONTENT) + 4, 0]


@pytest.mark.parametrize("known", [True, False], ids=["hash", "no hash"])
@pytest.mark.parametrize("asks_for_version", [True, False], ids=["If-Range", "If-Range ignored"])
@pytest.mark.parametrize(
    ("before", "after"),
    [({"ETag": '"1"'}, {"ETag": '"2"'}), ({"Last-Modified": DAY}, {"Last-Modified": NEXT_DAY}), ({}, {})],
    ids=["ETag", "Last-Modified", "neither"],
)
def test_two_versions_of_a_file_are_never_put_together(host, get, before, after, asks_for_version, known):
    assert len(OTHER) == len(CONTENT)
    url = host.serve("/a", CONTENT, headers=before, cuts=[200_000, 0, 0, 0])
    with pytest.raises(DownloadError):
        get(url, content=OTHER if known else None)
    assert get.part.stat().st_size == 200_000
    host.serve("/a", OTHER, headers=after, asks_for_version=asks_for_version)
    assert get(url, content=OTHER if known else None).read_bytes() == OTHER


@pytest.mark.parametrize("asks_for_version", [True, False], ids=["If-Range", "If-Range ignored"])
def test_a_file_that_changes_at_every_request_ends(host, get, asks_for_version):
    class Renumbered(dict):
        """Headers with another ETag each time."""

        def items(self):
            return [("ETag", f'"{len(host.asked)}"')]

    url = host.serve("/a", CONTENT, headers=Renumbered(), cuts=[100_000] * 100, asks_for_version=asks_for_version)
    with pytest.raises(DownloadError, match=r"changed|broke"):
        get(url, content=None)
    assert len(host.asked) < 10


QUOTA = b"<!DOCTYPE html><html><head><title>Google Drive - Quota exceeded</title></head><body>Too many users"


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        ({"body": CONTENT, "statuses": [202]}, "HTTP 202 Accepted: the server sent no file"),
        ({"body": b"", "statuses": [202]}, "HTTP 202 Accepted: the server sent no file"),
        ({"body": b"", "statuses": [204]}, "HTTP 204 No Content: the server sent no file"),
        ({"body": b""}, "the server sent nothing"),
        ({"body": b"", "length": False}, "the server sent nothing"),
        (
            {"body": b"\n<html><title>Log\n in</title>"},
            "the server sent a web page, 'Log in': the file needs a browser",
        ),
        ({"body": b"<!doctype HTML>"}, "the server sent a web page, without a title"),
        ({"body": QUOTA}, "the server sent Google Drive's page for a used-up quota: try again in a day"),
        ({"body": QUOTA, "statuses": [403]}, "HTTP 403 Forbidden: Google Drive's page for a used-up quota"),
        ({"body": CONTENT, "statuses": [410]}, "HTTP 410 Gone"),
        ({"body": CONTENT, "statuses": [503] * 9}, "HTTP 503 Service Unavailable"),
        ({"body": OTHER}, "the file that the server sent is another file: its md5 is wrong"),
        ({"body": CONTENT[:-1]}, "the file that the server sent is another file: its md5 is wrong"),
    ],
)
def test_what_is_not_the_file_is_said_with_the_way_out(host, get, answer, reason):
    url = host.serve("/a", **answer)
    with pytest.raises(DownloadError) as caught:
        get(url)
    first, second = str(caught.value).split("\n")
    assert "get it with a browser from https://example.org/made-up, put it into " in first
    assert f"{url}: {reason}" in second
    assert not (get.root / "Train.zip").exists()


def test_a_server_that_is_busy_is_asked_again(host, get, pauses):
    assert get(host.serve("/a", CONTENT, statuses=[503, 429])).read_bytes() == CONTENT
    assert pauses == [1, 2]


def test_a_server_that_is_not_there_is_named(get, pauses, monkeypatch):
    monkeypatch.delenv("NVSDATA_MIRROR", raising=False)
    with pytest.raises(DownloadError, match=r"http://127.0.0.1:9/a: .*refused") as caught:
        get("http://127.0.0.1:9/a")
    assert " object at 0x" not in str(caught.value)
    assert len(pauses) == transfer.TRIES - 1


def test_a_web_page_does_not_cost_what_had_come(host, get):
    url = host.serve("/a", CONTENT, cuts=[200_000, 0, 0, 0])
    with pytest.raises(DownloadError):
        get(url)
    host.serve("/a", QUOTA, ranges=False)
    with pytest.raises(DownloadError, match="quota"):
        get(url)
    host.serve("/a", CONTENT)
    assert get(url).read_bytes() == CONTENT
    assert host.asked[-1] == ("/a", 200_000)


def test_mirrors_are_asked_in_turn_and_go_on_with_what_another_sent(host, get):
    broken = host.serve("/b", CONTENT, headers={"ETag": '"1"'}, cuts=[300_000, 0, 0, 0])
    whole = host.serve("/c", CONTENT, headers={"ETag": '"2"'})
    assert get(host.address + "/missing", broken, whole).read_bytes() == CONTENT
    assert host.asked[-1] == ("/c", 300_000)


@pytest.mark.parametrize("content", [CONTENT, None], ids=["hash", "no hash"])
def test_another_file_on_a_mirror_does_not_spoil_the_next(host, get, content):
    wrong = host.serve("/b", OTHER, cuts=[300_000, 0, 0, 0])
    assert get(wrong, host.serve("/c", CONTENT), content=content).read_bytes() == CONTENT


def test_a_file_that_is_wrong_on_two_tries_is_not_gone_on_with(host, get):
    url = host.serve("/b", OTHER, cuts=[300_000])
    with pytest.raises(DownloadError, match="md5 is wrong"):
        get(url)
    assert [begin for _, begin in host.asked] == [0, 300_000, 0]
    assert list(get.part.parent.iterdir()) == []


def test_a_server_that_only_now_says_how_much_there_is_is_gone_on_with(host, get):
    url = host.serve("/a", CONTENT, headers={"ETag": '"1"'})
    get.part.parent.mkdir(parents=True)
    get.part.write_bytes(CONTENT[:200_000])
    get.part.with_suffix(".json").write_text(json.dumps({"url": url, "version": '"1"', "total": None}))
    assert get(url, content=None).read_bytes() == CONTENT
    assert host.asked == [("/a", 200_000)]


def test_a_torn_note_costs_no_more_than_the_part(host, get):
    get.part.parent.mkdir(parents=True)
    get.part.write_bytes(OTHER[:200_000])
    get.part.with_suffix(".json").write_text('{"url": "')
    assert get(host.serve("/a", CONTENT), content=None).read_bytes() == CONTENT


def test_a_file_of_another_size_is_not_brought(host, get):
    url = host.serve("/a", CONTENT + bytes(100))
    with pytest.raises(DownloadError, match=f"has {len(CONTENT) + 100:,} bytes, not {len(CONTENT):,}"):
        get(url, size=len(CONTENT))
    assert not get.part.exists()


def test_a_file_that_is_sent_as_packed_on_the_way_stays_packed(host, get):
    packed = trees.tarred({"a": b"1"})
    url = host.serve("/a", packed, headers={"Content-Encoding": "gzip"})
    assert get(url, content=packed).read_bytes() == packed


def test_without_a_hash_only_an_archive_is_taken(host, get):
    with pytest.raises(DownloadError, match="not an archive"):
        get(host.serve("/a", b"junk"), content=None)
    with pytest.raises(DownloadError, match="is incomplete"):
        get(host.serve("/b", CONTENT[:-30], length=False), content=None)
    with pytest.raises(DownloadError, match="RAR or 7z"):
        get(host.serve("/c", b"7z\xbc\xaf\x27\x1c rest"), content=None)
    assert get(host.serve("/d", CONTENT), content=None).read_bytes() == CONTENT


def test_a_sha256(host, tmp_path):
    archive = Archive("a.zip", hashlib.sha256(CONTENT).hexdigest(), (host.serve("/a", CONTENT),), "a")
    assert fetch(archive, tmp_path, tmp_path, INFO).read_bytes() == CONTENT


def test_a_file_that_is_there_is_used_or_left_alone(host, get):
    url = host.serve("/a", CONTENT)
    get.root.mkdir()
    (get.root / "Train.zip").write_bytes(b"<html><title>Please log in</title></html>")
    with pytest.raises(DownloadError, match=r"Train.zip is a web page, 'Please log in'.*; move it away"):
        get(url)
    (get.root / "Train.zip").write_bytes(OTHER)
    with pytest.raises(DownloadError, match=r"Train.zip is another file: its md5 is wrong, .*; move it away"):
        get(url)
    assert (get.root / "Train.zip").read_bytes() == OTHER
    (get.root / "Train.zip").write_bytes(CONTENT)
    get(url)
    assert host.asked == []


@pytest.mark.parametrize("name", ["Train.zip", "made-up/Train.zip"])
def test_a_folder_of_archives_is_asked_first(host, get, tmp_path, monkeypatch, name):
    mirror = tmp_path / "mirror" / name
    mirror.parent.mkdir(parents=True)
    mirror.write_bytes(CONTENT)
    monkeypatch.setenv("NVSDATA_MIRROR", str(tmp_path / "mirror"))
    # where it is: recordings need no second copy of it
    assert get(host.serve("/a", CONTENT)) == mirror
    assert host.asked == []
    mirror.write_bytes(OTHER)
    assert get(host.address + "/a") == get.root / "Train.zip"
    assert mirror.read_bytes() == OTHER


@pytest.mark.parametrize("path", ["/base/made-up/Train.zip", "/base/Train.zip"])
def test_a_host_of_archives_is_asked_first(host, get, monkeypatch, path):
    host.serve(path, CONTENT)
    monkeypatch.setenv("NVSDATA_MIRROR", f"{host.address}/base/")
    assert get(host.serve("/a", CONTENT)).read_bytes() == CONTENT
    assert ("/a", 0) not in host.asked
    (get.root / "Train.zip").unlink()
    host.files.pop(path)
    assert get(host.address + "/a").read_bytes() == CONTENT


def test_a_mirror_that_is_neither_is_said(get, monkeypatch):
    monkeypatch.setenv("NVSDATA_MIRROR", "mirror.example.org")
    with pytest.raises(DownloadError, match="NVSDATA_MIRROR must be a folder or begin with https://"):
        get()


def test_where_a_browser_is_needed_everything_is_said(tmp_path, monkeypatch):
    monkeypatch.delenv("NVSDATA_MIRROR", raising=False)
    by_hand = Archive("cars.zip", "0" * 64, (), "cars", 450_543_128)
    with pytest.raises(DownloadError) as caught:
        fetch(by_hand, tmp_path, tmp_path, INFO)
    for part in ("cars.zip", "https://example.org/made-up", str(tmp_path), "about 0.5 GB", "sha256 " + "0" * 64):
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_archive_is_taken_out_of_the_one_it_is_within(host, tmp_path):
    both = trees.zipped({"all/Train.zip": CONTENT, "all/Test.zip": OTHER})
    url = host.serve("/both", both, cuts=[100_000])
    outer = Archive("both.zip", hashlib.md5(both).hexdigest(), (url,), "")
    work = tmp_path / "work"
    work.mkdir()
    for name, content in (("Train.zip", CONTENT), ("Test.zip", OTHER)):
        archive = Archive(name, hashlib.md5(content).hexdigest(), (host.address + "/gone",), "", within=outer)
        assert fetch(archive, tmp_path, work, INFO).read_bytes() == content
    assert [path for path, _ in host.asked] == ["/gone", "/both", "/both", "/gone"]
    other = Archive("c.zip", "0" * 32, (), "", within=outer)
    with pytest.raises(DownloadError, match=r"'c.zip' is not in it"):
        fetch(other, tmp_path, work, INFO)


def test_a_full_disk_is_said_before_the_transfer(host, get, monkeypatch):
    monkeypatch.setattr(transfer.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 100_000))
    with pytest.raises(DownloadError, match=f"{len(CONTENT):,} bytes are missing, but the disk has 100,000 left"):
        get(host.serve("/a", CONTENT))


def test_a_disk_that_fills_up_during_the_transfer_keeps_what_came(host, get, pauses):
    resource = pytest.importorskip("resource")
    url = host.serve("/a", CONTENT)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
    try:
        with pytest.raises(DownloadError, match=r"Train.zip.part: File too large"):
            get(url)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not (get.root / "Train.zip").exists()
    assert pauses == []
    assert get.part.stat().st_size == 200_000
    assert get(url).read_bytes() == CONTENT
    assert host.asked[-1] == ("/a", 200_000)
