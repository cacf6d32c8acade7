"""An HTTP server of a folder on this computer, with ranges, delays and a list of faults."""

from __future__ import annotations

import argparse
import itertools
import re
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from random import Random
from urllib.parse import unquote, urlsplit

PAGE = b"<!DOCTYPE html><html><body>Please try again later.</body></html>"
FAULTS = ("drop", "delay", "cut", "altered", "busy", "page")


class Server(ThreadingHTTPServer):
    """Serves `root`; `faults` returns the fault of the n-th request (GET, from 0 on), or None."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, root, faults=lambda n: None, pause=0.0, port=0):
        self.root, self.faults, self.pause = Path(root), faults, pause
        self.count, self.lock = itertools.count(), threading.Condition()
        self._done: Counter[str] = Counter()
        self.sending = 0
        self.late = 30.0  # s of a delay
        self.retry_after = "0"
        super().__init__(("127.0.0.1", port), Handler)

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server_address[1]}"

    @property
    def done(self) -> Counter[str]:
        """Counts of what was done. Waits for answers on their way, which a client may have before they are counted."""
        with self.lock:
            assert self.lock.wait_for(lambda: not self.sending, timeout=60)
            return Counter(self._done)

    def note(self, **numbers):
        with self.lock:
            self._done.update(numbers)

    @contextmanager
    def answer(self):
        """One file on its way, counted when the block ends."""
        with self.lock:
            self.sending += 1
        try:
            yield
        finally:
            with self.lock:
                self.sending -= 1
                self.lock.notify_all()

    def handle_error(self, request, client_address):
        pass  # a client that went away


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def log_message(self, *_):
        pass

    def setup(self):
        super().setup()
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def do_GET(self):
        fault = self.server.faults(next(self.server.count))
        self.server.note(requests=1, **({fault: 1} if fault else {}))
        time.sleep(self.server.pause)
        if fault == "drop":
            self.close_connection = True
            self.connection.shutdown(socket.SHUT_RDWR)
        elif fault == "page":
            self._send(200, PAGE, {"Content-Type": "text/html"})
        elif fault == "busy":
            self._send(503, PAGE, {"Retry-After": self.server.retry_after})
        elif str(fault).isdecimal():
            self._send(int(fault), PAGE)
        else:
            if fault == "delay":
                time.sleep(self.server.late)
            with self.server.answer():
                self._send_file(fault)

    def do_HEAD(self):
        self.server.note(heads=1)
        path = self._path()
        self.send_response(200 if path.is_file() else 404)
        self.send_header("Content-Length", str(path.stat().st_size if path.is_file() else 0))
        self.end_headers()

    def _path(self):
        return self.server.root / unquote(urlsplit(self.path).path).lstrip("/")

    def _send(self, status, body, headers=None):
        self.send_response(status)
        for name, value in {"Content-Length": str(len(body)), **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def _send_file(self, fault):
        path = self._path()
        if not path.is_file():
            self._send(404, PAGE)
            return
        size = path.stat().st_size
        found = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        begin, end = (int(found[1]), min(int(found[2]) + 1, size)) if found and fault != "whole" else (0, size)
        if begin >= size:
            self._send(416, b"")
            return
        ranged = found and fault != "whole"
        self.send_response(206 if ranged else 200)
        if ranged:
            self.send_header("Content-Range", f"bytes {begin}-{end - 1}/{size}")
        self.send_header("Content-Length", str(end - begin))
        self.end_headers()
        if fault == "cut":
            end = (begin + end) // 2
        self.wfile.flush()
        with path.open("rb") as file:
            if fault == "altered":
                file.seek(begin)
                body = bytearray(file.read(end - begin))
                # some bytes, so that what is read meets one of them
                for at in range(0, len(body), 997):
                    body[at] ^= 1 << (at % 8)
                self.connection.sendall(body)
            else:
                self.connection.sendfile(file, begin, end - begin)
        self.server.note(bytes=end - (int(found[1]) if ranged else 0))
        if fault == "cut":
            self.close_connection = True
            with suppress(OSError):
                self.connection.shutdown(socket.SHUT_RDWR)


def some_faults(rate: float, kinds: tuple[str, ...] = FAULTS, seed: int = 0) -> Callable[[int], str | None]:
    """Faults of a fraction `rate` of the requests, each of a random kind."""

    def fault(number: int) -> str | None:
        rng = Random(seed * 1_000_003 + number)
        return rng.choice(kinds) if rng.random() < rate else None

    return fault


@contextmanager
def serving(root, faults=lambda n: None, pause=0.0) -> Iterator[Server]:
    """A server that runs while the block does."""
    server = Server(root, faults, pause)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("root")
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--pause", type=float, default=0.0)
    parser.add_argument("--rate", type=float, default=0.0)
    parser.add_argument("--late", type=float, default=30.0)
    given = parser.parse_args()
    server = Server(given.root, some_faults(given.rate), given.pause, given.port)
    server.late = given.late
    print(server.url, flush=True)
    done = threading.Thread(target=server.serve_forever, daemon=True)
    done.start()
    # a line asks for the numbers so far
    with suppress(EOFError):
        while True:
            input()
            print(dict(server.done), flush=True)
