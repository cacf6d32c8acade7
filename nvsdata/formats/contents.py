"""Contents of files: bytes that are read only when they are decoded, headers, and limits of decompression."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.ondisk import OnDisk
from nvsdata.kernels.decode.store import read_samples

try:
    # takes three quarters of zlib's time
    from isal import isal_zlib as _zlib
except ImportError:  # a platform for which isal has no wheel
    import zlib as _zlib

fast_zlib = _zlib
PIECE = 1 << 20  # bytes that are read and decoded at a time
_BUFFERS: list[
    np.ndarray
] = []  # buffers of a piece each, kept for reuse: fresh memory pages cost more than the reading
HEAD = 1 << 16  # bytes that are read to recognize the format; a shorter head is the entire file
MOST_HEADER = 1 << 22  # bytes of header lines; jAER writes some 100 kB
LAST_LINES = ("#end of ascii header", "#!end-header", "% end")  # lines that end a header
# header lines by their mark. An AEDAT record may begin with the mark by chance, so AEDAT's lines must be printable
# ASCII. Prophesee's records rarely begin with it, and their headers may contain other text
_PRINTABLE = {b"#": re.compile(rb"[\t\r\x20-\x7e]*"), b"%": re.compile(rb"[\t\r\x20-\x7e\x80-\xff]*")}
ALWAYS = 1 << 26  # bytes that any file may expand to
RATIO = 100  # a larger file may expand to this many times its size; events compress to a third or a tenth


class Contents:
    """The bytes of a file that begins with `head`: `head` itself if the file is short, otherwise read on demand.

    No file stays open or mapped. `size` is the file's size at the creation of this object. Every method that reads
    raises FormatError if the file was truncated or changed since then.
    """

    def __init__(self, path: str, head: bytes) -> None:
        self.path = path
        self.head = head
        self._file = None if len(head) < HEAD else OnDisk(path)
        self.size = len(head) if self._file is None else self._file.size

    @property
    def stamp(self) -> tuple[int, ...] | None:
        """Numbers that change with the file, its size first (see `OnDisk.stamp`); None if `head` is the entire file."""
        return None if self._file is None else self._file.stamp

    def drop_head(self) -> None:
        """Free the head unless it is the entire file: the heads of many recordings would take much memory."""
        if self._file is not None:
            self.head = b""

    def read(self, start: int, stop: int) -> np.ndarray:
        """Return bytes start..stop, uint8 and read-only."""
        if stop <= len(self.head):
            return np.frombuffer(self.head, np.uint8, stop - start, start)
        out = np.empty(stop - start, np.uint8)
        assert self._file is not None
        with self._file.opened() as file:
            file.fill(start, out)
        # read-only, like the bytes of `head`
        out.flags.writeable = False
        return out

    def pieces(self, start: int, stop: int, step: int) -> Iterator[np.ndarray]:
        """Yield bytes start..stop in pieces of `step` bytes; as in `ranges`, each array is overwritten by the next."""
        return self.ranges([(at, min(at + step, stop)) for at in range(start, stop, step)])

    def ranges(self, ranges: Sequence[tuple[int, int]]) -> Iterator[np.ndarray]:
        """Yield the bytes of each range (start, stop), uint8 and read-only; each array is overwritten by the next."""
        if max((stop for _, stop in ranges), default=0) <= len(self.head):
            return iter([np.frombuffer(self.head, np.uint8, stop - start, start) for start, stop in ranges])
        return self._from_disk(ranges)

    def _from_disk(self, ranges: Sequence[tuple[int, int]]) -> Iterator[np.ndarray]:
        assert self._file is not None
        longest = max(stop - start for start, stop in ranges)
        try:
            buffer = _BUFFERS.pop() if longest <= PIECE else np.empty(longest, np.uint8)
        except IndexError:
            buffer = np.empty(PIECE, np.uint8)
        view = buffer.view()
        view.flags.writeable = False
        try:
            with self._file.opened() as file:
                for start, stop in ranges:
                    file.fill(start, buffer[: stop - start])
                    yield view[: stop - start]
        finally:
            if longest <= PIECE:
                _BUFFERS.append(buffer)

    @contextmanager
    def handle(self) -> Iterator[int]:
        """Open the file while the block runs, and yield its descriptor; -1 if `head` is the entire file."""
        if self._file is None:
            yield -1
        else:
            with self._file.opened() as file:
                yield file.descriptor

    def samples(self, start: int, stop: int, step: int, size: int) -> np.ndarray:
        """Return `size` bytes at each of the offsets start, start + step, ... below `stop`, uint8 [N, size]."""
        out = np.empty((len(range(start, stop, step)), size), np.uint8)
        if not len(out):
            return out
        if self._file is None:
            rows = np.arange(start, stop, step)[:, None] + np.arange(size)
            out[:] = np.frombuffer(self.head, np.uint8)[rows]
        elif hasattr(os, "pread"):
            with self._file.opened() as file:
                found = read_samples(file.descriptor, start, step, out)
            if found < len(out):
                raise FormatError(self.path, "truncated while it was read", offset=start + found * step)
        else:
            with self._file.opened() as file:
                for row, at in zip(out, range(start, stop, step), strict=True):
                    file.fill(at, row)
        return out

    def header(self, mark: bytes) -> tuple[list[str], int]:
        """Return the printable lines at the start that begin with `mark`, and the offset of the byte after them.

        FormatError if they take much more than `MOST_HEADER` bytes, or if the file ends within a line.
        """
        lines, end, torn = header_lines(self.head, mark)
        size = len(self.head)
        while torn and size < self.size:
            if size >= MOST_HEADER:
                raise FormatError(self.path, f"the header has more than {MOST_HEADER} bytes", offset=0)
            # jAER writes its preferences into the header, which can make it longer than `head`
            begin, size = end, min(4 * size, self.size)
            more, end, torn = header_lines(self.read(begin, size).tobytes(), mark)
            lines, end = lines + more, begin + end
        if torn and end < self.size:
            # the rest of a line would be decoded as events
            raise FormatError(self.path, "cut off within a line of its header", offset=end)
        return lines, end


def header_lines(data: bytes, mark: bytes) -> tuple[list[str], int, bool]:
    """Return the lines at the start of `data` that begin with `mark`, and the offset of the byte after them.

    The third value is True if the header may continue beyond the end of `data`.
    """
    lines: list[str] = []
    end = 0
    while data[end : end + len(mark)] == mark:
        newline = data.find(b"\n", end)
        line = data[end : newline if newline >= 0 else len(data)]
        if not _PRINTABLE[mark].fullmatch(line):
            return lines, end, False
        if newline < 0:
            return lines, end, True
        lines.append(line.decode("latin-1").rstrip("\r"))
        end = newline + 1
        if lines[-1].lower() in LAST_LINES:
            return lines, end, False
    return lines, end, end == len(data)


def most_bytes(size: int) -> int:
    """Return the number of bytes to which a compressed file of `size` bytes may expand.

    A file that expands to more is damaged, or an attack.
    """
    return max(ALWAYS, RATIO * size)


class Allowance:
    """The number of bytes to which the compressed parts of a file of `size` bytes may expand, all parts together.

    Attributes:
        left: Bytes that are left of `most_bytes(size)`.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.left = most_bytes(size)

    def of(self, size: int) -> int:
        """Return the number of bytes that a part of `size` bytes may expand to."""
        return min(self.left, most_bytes(size))

    def take(self, count: int) -> None:
        """Subtract `count` bytes. ValueError if fewer are left."""
        if count > self.left:
            raise ValueError(f"expands too far: {self.reason}")
        self.left -= count

    @property
    def reason(self) -> str:
        """The limit, as text for error messages."""
        return f"a file of {self.size} bytes may expand to {most_bytes(self.size)} at most"
