"""Bounds of downloads and archives: what is just allowed, and what is just too much."""

from __future__ import annotations

import hashlib
import io
import random
import shutil
import tarfile
import zipfile
from dataclasses import replace
from types import SimpleNamespace

import pytest
import trees

from nvsdata.common.errors import DownloadError
from nvsdata.datasets.archives import transfer
from nvsdata.datasets.archives import unpack as module
from nvsdata.datasets.archives.arrival_check import archive_fault, page_of
from nvsdata.datasets.archives.download import WORK, download
from nvsdata.datasets.archives.unpack import extract_file, unpack
from nvsdata.datasets.facts import Archive, Info

INFO = Info("made-up", None, ("a",), "https://example.org/made-up", "none")
CONTENT = trees.zipped({"a/1.bin": random.Random(1).randbytes(20_000)})


def zipped(files, comment=b""):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.comment = comment
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


def nested(depth):
    """A zip in a zip in a zip and so on, `depth` of them in all."""
    return zipped({f"{depth}.zip": nested(depth - 1)} if depth > 1 else {"x": b"1"})


def disk_with(monkeypatch, free):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, free))


@pytest.fixture
def get(tmp_path):
    """A function that fetches what an address has; where its part is kept is its `part`."""

    def run(url, content=CONTENT, **facts):
        archive = Archive("a.zip", hashlib.md5(content).hexdigest(), (url,), "a", **facts)
        return transfer.fetch(archive, tmp_path, run.part.parent, INFO).read_bytes()

    run.part = tmp_path / "work/a.zip.part"
    run.part.parent.mkdir()
    return run


@pytest.fixture
def unpacked(tmp_path):
    """A function that unpacks an archive of these bytes, and gives its files by name."""

    def run(raw):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        (tmp_path / "a.zip").write_bytes(raw)
        unpack(tmp_path / "a.zip", tmp_path / "out")
        return {p.relative_to(tmp_path / "out").as_posix(): p for p in (tmp_path / "out").rglob("*") if p.is_file()}

    return run


def test_pauses_grow_to_a_minute(host, get, pauses):
    assert get(host.serve("/a", CONTENT, cuts=[1_000] * 9)) == CONTENT
    assert pauses == [1, 2, 4, 8, 16, 32, 60, 60, 60]


def test_three_tries_without_a_byte_are_enough(host, get, pauses):
    with pytest.raises(DownloadError, match="503"):
        get(host.serve("/a", CONTENT, statuses=[503] * 3))
    assert (len(host.asked), pauses) == (3, [1, 2])
    # each new byte counts
    assert get(host.serve("/b", CONTENT, cuts=[5, 0, 0, 5, 0, 0, 5, 0, 0])) == CONTENT


def test_another_file_is_asked_for_once(host, get, pauses):
    with pytest.raises(DownloadError, match="the file that the server sent is another file"):
        get(host.serve("/a", CONTENT + b"more"))
    assert (host.asked, pauses) == ([("/a", 0)], [])


@pytest.mark.parametrize("optional", [("", "put a.zip from"), ("gone", "can't download a.zip")])
def test_who_downloads_is_told_what_is_left_out(host, tmp_path, pauses, optional):
    url, reason = optional
    archive = Archive("a.zip", "", (f"{host.address}/{url}",) if url else (), "a", optional=True)
    with pytest.warns(UserWarning, match=f"without a: {reason}") as message:
        assert download(replace(INFO, archives=(archive,)), tmp_path / "data") == []
    assert [warning.filename for warning in message] == [__file__]


def test_unfinished_work_goes_once_all_is_there(host, tmp_path, pauses):
    both = trees.zipped({"a.zip": CONTENT})
    outer = Archive("both.zip", hashlib.md5(both).hexdigest(), (host.serve("/both", both),), "")
    inner = Archive("a.zip", hashlib.md5(CONTENT).hexdigest(), (), "a", within=outer)
    assert download(replace(INFO, archives=(inner,)), tmp_path) == [tmp_path / "a"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "a.zip"]
    # what came of an archive that isn't needed is kept, although the others are there
    part = host.serve("/part", CONTENT, cuts=[5_000, 0, 0, 0])
    more = Archive("b.zip", hashlib.md5(CONTENT).hexdigest(), (part,), "b", optional=True)
    with pytest.warns(UserWarning, match="without b: can't download"):
        download(replace(INFO, archives=(inner, more)), tmp_path)
    assert (tmp_path / WORK / "b.zip.part").stat().st_size == 5_000
    host.files["/part"].cuts.clear()
    assert download(replace(INFO, archives=(inner, more)), tmp_path) == [tmp_path / "a", tmp_path / "b"]
    assert not (tmp_path / WORK).exists()
    assert host.asked[-1] == ("/part", 5_000)


def test_more_than_16_mib_make_pauses_short_again(pauses, monkeypatch):
    steps = iter([1, 1, 2**24, 2**24 + 1, 1])

    class Growing:
        size = 0

        def __len__(self):
            return self.size

    def breaks_off(url, part, archive):
        for step in steps:
            part.size += step
            raise transfer._Broken("off")
        return True

    monkeypatch.setattr(transfer, "_one_try", breaks_off)
    assert transfer._transfer("url", Growing(), Archive("a.zip", "", (), "a"))
    assert pauses == [1, 2, 4, 1, 2]


@pytest.mark.parametrize(
    ("status", "first", "reason"),
    [
        # of the rest of a file, the first bytes may look like anything; with 416, no bytes count
        (206, b"<html>", None),
        (416, b"<html>", None),
        (200, b"PK", None),
        (206, b"", None),
        (200, b"<html>", "the server sent a web page, without a title"),
        (200, b"", "the server sent nothing"),
        (415, b"PK", "HTTP 415"),
        (417, b"PK", "HTTP 417"),
        (503, b"<html>", "HTTP 503"),
        (403, b"<html>", "HTTP 403"),
    ],
)
def test_what_bytes_a_server_sends(status, first, reason):
    raw = SimpleNamespace(stream=lambda *_, **__: iter([first, b"rest"]))
    response = SimpleNamespace(status_code=status, reason="", raw=raw)
    if reason is None:
        assert b"".join(transfer._bytes_of(response)) == first + b"rest"
    else:
        with pytest.raises((transfer._NotHere, transfer._Broken), match=f"^{reason}(: the file needs a browser)?$"):
            transfer._bytes_of(response)


def test_what_is_optional_may_come_from_a_mirror(tmp_path, monkeypatch):
    archive = Archive("a.zip", hashlib.md5(CONTENT).hexdigest(), (), "a", optional=True)
    (tmp_path / "mirror").mkdir()
    (tmp_path / "mirror/a.zip").write_bytes(CONTENT)
    monkeypatch.setenv("NVSDATA_MIRROR", str(tmp_path / "mirror"))
    assert download(replace(INFO, archives=(archive,)), tmp_path / "data") == [tmp_path / "data/a"]
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["a"]


def test_a_page_is_known_by_its_first_64_kib(tmp_path):
    for length, found in ((65_536, True), (65_537, False)):
        (tmp_path / "a").write_bytes(b"<!--" + b"x" * (length - 12) + b"--><html rest")
        assert archive_fault(tmp_path / "a", "").startswith("is a web page") == found


@pytest.mark.parametrize("status", [408, 425, 429, 500, 502, 503, 504])
def test_what_may_be_over_soon_is_asked_again(host, get, pauses, status):
    assert get(host.serve("/a", CONTENT, statuses=[status])) == CONTENT
    assert pauses == [1]


@pytest.mark.parametrize("status", [400, 403, 404, 407, 409, 417, 424, 426, 428, 430, 499, 501, 505])
def test_what_will_not_be_over_soon_is_not(host, get, pauses, status):
    with pytest.raises(DownloadError, match=f"HTTP {status}"):
        get(host.serve("/a", CONTENT, statuses=[status]))
    assert pauses == []


@pytest.mark.parametrize("status", [201, 202, 203, 205, 207])
def test_what_is_neither_an_error_nor_the_file(host, get, pauses, status):
    with pytest.raises(DownloadError, match=f"HTTP {status}.*: the server sent no file"):
        get(host.serve("/a", CONTENT, statuses=[status]))
    assert pauses == []


def test_how_long_a_silent_server_is_waited_for(host, get, monkeypatch):
    asked = []
    real = transfer.requests.get
    monkeypatch.setattr(transfer.requests, "get", lambda url, **how: asked.append(how) or real(url, **how))
    get(host.serve("/a", CONTENT))
    assert asked[0]["timeout"] == (30, 60)


def test_what_is_still_to_come_must_fit_the_disk(host, get, monkeypatch):
    url = host.serve("/a", CONTENT)
    get.part.write_bytes(CONTENT[:5_000])
    disk_with(monkeypatch, len(CONTENT) - 5_001)
    with pytest.raises(DownloadError, match=f"{len(CONTENT) - 5_000:,} bytes are missing, but the disk has 1"):
        get(url)
    disk_with(monkeypatch, len(CONTENT) - 5_000)
    assert get(url) == CONTENT
    # where the server doesn't say, what is known counts
    disk_with(monkeypatch, len(CONTENT) - 1)
    (get.part.parent.parent / "a.zip").unlink()
    with pytest.raises(DownloadError, match=f"{len(CONTENT):,} bytes are missing"):
        get(host.serve("/b", CONTENT, length=False), size=len(CONTENT))


@pytest.mark.parametrize(
    ("header", "extent"),
    [
        ("bytes 5-9/10", (5, 10)),
        ("bytes 0-9/*", (0, None)),
        ("bytes */10", (-1, 10)),
        (" bytes 5-9/10 ", (5, 10)),
        ("bytes 5/10", (-1, None)),
        ("", (-1, None)),
    ],
)
def test_which_part_of_how_much_a_server_sends(header, extent):
    assert transfer._extent(SimpleNamespace(status_code=206, headers={"Content-Range": header})) == extent


def test_three_levels_of_zips_in_a_zip_are_unpacked(unpacked):
    assert list(unpacked(nested(4))) == ["4/3/2/x"]
    assert list(unpacked(nested(5))) == ["5/4/3/2.zip"]


def test_as_many_files_and_bytes_as_are_allowed(unpacked, monkeypatch):
    raw = zipped({"1": b"abc", "2": b"de"})
    monkeypatch.setattr(module, "MOST_FILES", 2)
    monkeypatch.setattr(module, "MOST_BYTES", 5)
    assert len(unpacked(raw)) == 2
    monkeypatch.setattr(module, "MOST_FILES", 1)
    with pytest.raises(DownloadError, match="more than 5 bytes, 1 files"):
        unpacked(raw)
    monkeypatch.setattr(module, "MOST_FILES", 2)
    monkeypatch.setattr(module, "MOST_BYTES", 4)
    with pytest.raises(DownloadError, match="more than 4 bytes, 2 files"):
        unpacked(raw)


def bomb(size):
    """A zip of a file that claims to be of some size."""
    raw = bytearray(zipped({"x": b"1"}))
    at = raw.find(b"PK\1\2") + 24
    raw[at : at + 4] = size.to_bytes(4, "little")
    return bytes(raw)


def test_a_small_archive_may_hold_268_mb(unpacked):
    limits = "107,374,182,400 bytes, 1,000,000 files or 100 times its size"
    with pytest.raises(DownloadError, match=f"refused, it unpacks to more than {limits}$"):
        unpacked(bomb(268_435_457))
    # this one would fit, if it were what it claims to be
    assert unpacked(bomb(268_435_456))["x"].read_bytes() == b"1"


def test_a_large_archive_may_hold_100_times_its_size(unpacked, monkeypatch):
    monkeypatch.setattr(module, "SMALL", 10)
    raw = bomb(100 * len(bomb(1)))
    assert unpacked(raw)["x"].read_bytes() == b"1"
    with pytest.raises(DownloadError, match="refused"):
        unpacked(bomb(100 * len(raw) + 1))


@pytest.mark.parametrize(("sizes", "needed"), [((4_096, 1), 8_192), ((4_097, 0), 8_192), ((8_192, 4_095), 12_288)])
def test_files_take_whole_blocks_of_the_disk(unpacked, monkeypatch, sizes, needed):
    raw = zipped({str(size): bytes(size) for size in sizes})
    disk_with(monkeypatch, needed - 1)
    with pytest.raises(DownloadError, match=f"unpacks to {needed:,} bytes, but the disk has {needed - 1:,} left"):
        unpacked(raw)
    disk_with(monkeypatch, needed)
    assert {path.stat().st_size for path in unpacked(raw).values()} == set(sizes)


def test_what_is_taken_out_must_fit_the_disk(tmp_path, monkeypatch):
    (tmp_path / "a.zip").write_bytes(zipped({"a/x": b"12345", "b/x": b"6", "y": bytes(99)}))
    disk_with(monkeypatch, 4)
    with pytest.raises(DownloadError, match="unpacks to 5 bytes, but the disk has 4 left"):
        extract_file(tmp_path / "a.zip", "x", tmp_path / "x")
    disk_with(monkeypatch, 5)
    extract_file(tmp_path / "a.zip", "x", tmp_path / "x")
    assert (tmp_path / "x").read_bytes() == b"12345"


@pytest.mark.parametrize("comment", [b"", b"a comment of the maker"])
def test_a_zip_says_how_many_entries_it_has(unpacked, comment):
    raw = bytearray(zipped({f"f{i}": b"1" for i in range(5)}, comment))
    assert len(unpacked(bytes(raw))) == 5
    end = raw.rfind(b"PK\5\6")
    # those of more than it can say
    raw[end + 8 : end + 12] = b"\xff" * 4
    assert len(unpacked(bytes(raw))) == 5
    for count in (4, 6, 0xFFFE):
        raw[end + 10 : end + 12] = count.to_bytes(2, "little")
        with pytest.raises(DownloadError, match=f"damaged archive: 5 entries can be found, of {count:,}"):
            unpacked(bytes(raw))


def test_names_of_any_script_are_unpacked(unpacked):
    assert {name: path.read_bytes() for name, path in unpacked(zipped({"\u00e4/\u2603": b"1", "b/": b""})).items()} == {
        "\u00e4/\u2603": b"1"
    }


@pytest.mark.parametrize(
    ("files", "found"),
    [
        ({"a/x": b"1", "a/y/z": b"2"}, {"x", "y/z"}),
        ({"a/x": b"1", "b/y": b"2"}, {"a/x", "b/y"}),
        ({"x": b"1"}, {"x"}),
        ({"a": b"1"}, {"a"}),
    ],
)
def test_the_folder_of_an_archive_may_be_in_it(tmp_path, monkeypatch, files, found):
    monkeypatch.delenv("NVSDATA_MIRROR", raising=False)
    (tmp_path / "a.zip").write_bytes(zipped(files))
    (folder,) = download(replace(INFO, archives=(Archive("a.zip", "", (), "a"),)), tmp_path)
    assert {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} == found
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "a.zip"]


def test_folders_in_archives(unpacked, tmp_path):
    assert list(unpacked(zipped({"x.zip/1": b"1", "empty/": b""}))) == ["x.zip/1"]
    assert (tmp_path / "out/empty").is_dir()
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        for name in (".", "./empty"):
            entry = tarfile.TarInfo(name)
            entry.type = tarfile.DIRTYPE
            archive.addfile(entry)
        archive.addfile(tarfile.TarInfo("./x"))
    assert list(unpacked(out.getvalue())) == ["x"]
    assert (tmp_path / "out/empty").is_dir()


def test_titles_of_web_pages_are_told_briefly(tmp_path):
    for length, result in ((80, 80), (81, 80)):
        page = f"<html><title>{'x' * length}</title>".encode()
        assert page_of(page) == f"a web page, '{'x' * result}': the file needs a browser"
    (tmp_path / "a").write_bytes(b"<!-- one -->\n<HTML>")
    assert archive_fault(tmp_path / "a", "0" * 32) == "is a web page, without a title: the file needs a browser"
    (tmp_path / "a").write_bytes(b"<htmlx>")
    assert archive_fault(tmp_path / "a", "") == "is not an archive, or is incomplete"
    (tmp_path / "a").write_bytes(b"")
    assert archive_fault(tmp_path / "a", "") == "is empty"


@pytest.mark.parametrize("head", [b"Rar!\x1a\7", b"7z\xbc\xaf\x27\x1c"])
def test_archives_that_python_can_not_read_are_named_where_no_hash_is_known(tmp_path, head):
    (tmp_path / "a").write_bytes(head)
    assert archive_fault(tmp_path / "a", "") == "is a RAR or 7z archive, which has to be unpacked manually"
    for digest in ("md5", "sha256"):
        assert archive_fault(tmp_path / "a", hashlib.new(digest, head).hexdigest()) == ""
        wrong = archive_fault(tmp_path / "a", hashlib.new(digest, b"").hexdigest())
        assert wrong == f"is another file: its {digest} is wrong, {hashlib.new(digest, head).hexdigest()}"
