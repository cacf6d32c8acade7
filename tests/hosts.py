"""A web server on this machine that fails as the hosts of datasets do."""

from __future__ import annotations

import http.server
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

PIECES = 20  # that a slow answer is sent in


@dataclass
class Served:
    """What the server has at an address, and how it goes about it.

    `cuts`: bytes after which answers break off, one after the other; later ones are whole. `statuses`: codes of the
    first answers. `headers` are sent in addition, an ETag or Last-Modified as a version of the file.
    """

    body: bytes
    headers: dict[str, str] = field(default_factory=dict)
    cuts: list[int] = field(default_factory=list)
    statuses: list[int] = field(default_factory=list)
    ranges: bool = True
    asks_for_version: bool = True  # whether If-Range counts
    length: bool = True
    seconds: float = 0  # that an answer takes


class Host:
    """Files by their path; `asked` are the path and the first byte of each request."""

    def __init__(self) -> None:
        self.files: dict[str, Served] = {}
        self.asked: list[tuple[str, int]] = []
        self.address = ""

    def serve(self, path: str, body: bytes, **how) -> str:
        self.files[path] = Served(body, **how)
        return self.address + path


@contextmanager
def hosting() -> Iterator[Host]:
    """A host that answers while the block runs."""
    host = Host()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked = self.headers.get("Range")
            begin = int(asked[6:-1]) if asked else 0
            host.asked.append((self.path, begin))
            served = host.files.get(self.path)
            if served is None:
                return self.send_error(404)
            version = served.headers.get("ETag") or served.headers.get("Last-Modified")
            wanted = self.headers.get("If-Range")
            if not served.ranges or (served.asks_for_version and wanted and wanted != version):
                asked, begin = None, 0
            whole, status = served.body, served.statuses.pop(0) if served.statuses else 200
            if status == 200 and asked:
                status = 206 if begin < len(whole) else 416
            self.send_response(status)
            for name, value in served.headers.items():
                self.send_header(name, value)
            if status == 206:
                self.send_header("Content-Range", f"bytes {begin}-{len(whole) - 1}/{len(whole)}")
            if status == 416:
                self.send_header("Content-Range", f"bytes */{len(whole)}")
            part = b"" if status in (416, 204) else whole[begin:]
            if served.length:
                self.send_header("Content-Length", str(len(part)))
            self.end_headers()
            part = part[: served.cuts.pop(0)] if served.cuts else part
            pieces = PIECES if served.seconds else 1
            size = len(part) // pieces + 1
            with suppress(OSError):  # who asked may be killed
                for k in range(pieces):
                    self.wfile.write(part[k * size : (k + 1) * size])
                    if served.seconds:
                        time.sleep(served.seconds / pieces)
            return None

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        host.address = f"http://127.0.0.1:{server.server_address[1]}"
        yield host
        server.shutdown()
