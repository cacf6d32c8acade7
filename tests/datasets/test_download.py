import hashlib
import http.server
import io
import threading
import zipfile

import pytest

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
