import hashlib
import http.server
import io
import tarfile
import threading
import zipfile

import pytest
import trees

from nvsdata.datasets import download
from nvsdata.datasets.base import Archive
from nvsdata.datasets.download import DownloadError, fetch, fetch_and_unpack, unpack


def zipped(entries):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return buffer.getvalue()


CONTENT = zipped({f"Train/{d}/{i:05d}.bin": bytes(range(250)) * 40 for d in range(10) for i in range(3)})


class Handler(http.server.BaseHTTPRequestHandler):
    """Serves CONTENT: /whole, /cut (breaks off half-way), /wrong, /page, /empty, /norange."""

    requests: list

    def do_GET(self):
        begin = int((self.headers.get("Range") or "bytes=0-")[6:-1])
        self.requests.append((self.path, begin))
        if self.path == "/missing":
            return self.send_error(404)
        body = {"/wrong": b"x" * 500, "/page": b"<!DOCTYPE html><html>", "/empty": b""}.get(self.path, CONTENT)
        if self.path == "/norange":
            begin = 0
        if begin >= len(body) > 0:
            return self.send_error(416)
        self.send_response(206 if begin else 200)
        self.send_header("Content-Length", str(len(body) - begin))
        self.end_headers()
        part = body[begin:]
        self.wfile.write(part[: len(part) // 2] if self.path == "/cut" else part)
        return None

    def log_message(self, *_):
        pass


@pytest.fixture
def server():
    Handler.requests = []
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def archive(server, *paths, content=CONTENT):
    return Archive("Train.zip", hashlib.md5(content).hexdigest(), tuple(server + p for p in paths), "Train")


def test_download_and_unpack(server, tmp_path):
    folder = fetch_and_unpack(archive(server, "/whole"), tmp_path / "new")
    assert len(list(folder.glob("*/*.bin"))) == 30
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["Train", "Train.zip"]
    Handler.requests.clear()
    fetch_and_unpack(archive(server, "/whole"), tmp_path / "new")
    assert Handler.requests == []


def test_a_broken_connection_is_resumed_where_it_broke(server, tmp_path):
    assert fetch(archive(server, "/cut", "/whole"), tmp_path).read_bytes() == CONTENT
    path, begin = Handler.requests[-1]
    assert path == "/whole" or begin > 0
    assert begin > 0


def test_a_file_left_by_an_earlier_run_is_resumed(server, tmp_path):
    (tmp_path / "Train.zip.part").write_bytes(CONTENT[:1000])
    assert fetch(archive(server, "/whole"), tmp_path).read_bytes() == CONTENT
    assert Handler.requests == [("/whole", 1000)]


def test_a_server_that_cannot_resume_is_asked_anew(server, tmp_path):
    (tmp_path / "Train.zip.part").write_bytes(CONTENT[:1000])
    assert fetch(archive(server, "/norange"), tmp_path).read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("path", "reason"),
    [("/wrong", "md5 is wrong"), ("/page", "web page"), ("/empty", "sent nothing"), ("/missing", "404")],
)
def test_what_went_wrong_is_said_with_the_way_out(server, tmp_path, path, reason):
    with pytest.raises(DownloadError, match=f"put it into(.|\n)*{reason}"):
        fetch(archive(server, path), tmp_path)
    assert not (tmp_path / "Train.zip").exists()


def test_mirrors_are_tried_in_order(server, tmp_path):
    assert fetch(archive(server, "/missing", "/page", "/whole"), tmp_path).read_bytes() == CONTENT


def test_a_file_put_there_by_hand_is_recognised(server, tmp_path):
    (tmp_path / "Train.zip").write_bytes(CONTENT)
    fetch_and_unpack(archive(server, "/missing"), tmp_path)
    assert Handler.requests == []


def test_an_interrupted_unpack_is_done_again(server, tmp_path):
    (tmp_path / ".Train.part" / "0").mkdir(parents=True)
    (tmp_path / ".Train.part" / "0" / "half.bin").write_bytes(b"x")
    folder = fetch_and_unpack(archive(server, "/whole"), tmp_path)
    assert not list(folder.glob("**/half.bin"))
    assert len(list(folder.glob("*/*.bin"))) == 30


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "..\\evil"])
def test_entries_that_lead_elsewhere_are_refused(tmp_path, name):
    (tmp_path / "a.zip").write_bytes(zipped({name: b"x"}))
    with pytest.raises(DownloadError, match="leads elsewhere"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


def test_links_are_refused(tmp_path):
    entry = zipfile.ZipInfo("link")
    entry.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(entry, "/etc/passwd")
    with pytest.raises(DownloadError, match="leads elsewhere"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE])
def test_links_and_devices_in_tars_are_refused(tmp_path, kind):
    entry = tarfile.TarInfo("link")
    entry.type, entry.linkname = kind, "../../etc/passwd"
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as archive:
        archive.addfile(entry)
    with pytest.raises(DownloadError, match="leads elsewhere"):
        unpack(tmp_path / "a.tar.gz", tmp_path / "out")


def test_tars_and_zips_in_zips_are_unpacked(tmp_path):
    (tmp_path / "a.tar.gz").write_bytes(trees.tarred({"d/one.aedat": b"1", "d/sub/two.aedat": b"2"}))
    unpack(tmp_path / "a.tar.gz", tmp_path / "tar")
    assert (tmp_path / "tar/d/sub/two.aedat").read_bytes() == b"2"
    inner = zipped({"a/a_0001.mat": b"x"})
    (tmp_path / "b.zip").write_bytes(zipped({"Yin Bi - a.zip": inner, "deep.zip": zipped({"deeper.zip": inner})}))
    unpack(tmp_path / "b.zip", tmp_path / "zip")
    found = sorted(str(p.relative_to(tmp_path / "zip")) for p in (tmp_path / "zip").rglob("*") if p.is_file())
    assert found == ["Yin Bi - a/a/a_0001.mat", "deep/deeper/a/a_0001.mat"]


def test_bombs_are_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(download, "MOST_BYTES", 1_000_000)
    (tmp_path / "a.zip").write_bytes(zipped({"zeros": bytes(2_000_000)}))
    with pytest.raises(DownloadError, match="unpacks to more than 1000000 bytes"):
        unpack(tmp_path / "a.zip", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    # those in archives within count, too
    (tmp_path / "b.zip").write_bytes(zipped({f"{i}.zip": zipped({"zeros": bytes(400_000)}) for i in range(3)}))
    with pytest.raises(DownloadError, match="unpacks to more"):
        unpack(tmp_path / "b.zip", tmp_path / "out")
    monkeypatch.setattr(download, "MOST_FILES", 5)
    (tmp_path / "c.zip").write_bytes(zipped({str(i): b"" for i in range(6)}))
    with pytest.raises(DownloadError, match="or 5 files"):
        unpack(tmp_path / "c.zip", tmp_path / "out")


def test_a_damaged_archive_is_named(tmp_path):
    raw = bytearray(zipped({"a": bytes(range(256)) * 50}))
    raw[60] ^= 0xFF
    (tmp_path / "a.zip").write_bytes(raw)
    with pytest.raises(DownloadError, match="damaged archive"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


def test_where_a_browser_is_needed_everything_is_said(tmp_path):
    by_hand = Archive("cars.zip", "0" * 64, (), "cars", 450_543_128)
    with pytest.raises(DownloadError) as caught:
        fetch_and_unpack(by_hand, tmp_path, "https://example.org/cars")
    for part in ("cars.zip", "https://example.org/cars", str(tmp_path), "about 0.5 GB", "sha256 " + "0" * 64):
        assert part in str(caught.value)
    (tmp_path / "cars.zip").write_bytes(b"<html>please log in</html>")
    with pytest.raises(DownloadError, match="web page"):
        fetch_and_unpack(by_hand, tmp_path)


def test_a_sha256_and_no_hash_at_all(server, tmp_path):
    sha = Archive("Train.zip", hashlib.sha256(CONTENT).hexdigest(), (server + "/wrong", server + "/whole"), "Train")
    assert fetch(sha, tmp_path).read_bytes() == CONTENT
    unknown = Archive("other.zip", "", (), "other")
    (tmp_path / "other.zip").write_bytes(CONTENT)
    assert fetch(unknown, tmp_path).name == "other.zip"
    (tmp_path / "other.zip").write_bytes(b"junk")
    with pytest.raises(DownloadError, match="no archive"):
        fetch(unknown, tmp_path)
