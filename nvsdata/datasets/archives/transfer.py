"""Transfer of files from the first address that has them, with resumption of broken connections.

pooch isn't used, because it has no resumption, takes one address per file, and retries any failure a fixed number of
times.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import shutil
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import quote

import requests
import urllib3

from nvsdata.common.errors import DownloadError, shown
from nvsdata.common.files import append_own, read_own, remove_link, write_all
from nvsdata.common.progress import bar as progress
from nvsdata.datasets.archives.arrival_check import QUOTA, archive_fault, kind_of, page_of
from nvsdata.datasets.archives.unpack import extract_file
from nvsdata.datasets.facts import Archive, Info

MIRROR = "NVSDATA_MIRROR"
MOST_NOTE = 1 << 20  # bytes of a note on an unfinished transfer
TRIES = 3  # in a row without a new byte, before the next address is tried
PAUSE, LONGEST_PAUSE = 1.0, 60.0  # s before the next try; each is twice as long as the one before
MUCH = 16 << 20  # bytes received before a connection broke, after which pauses start again from the shortest
TIMEOUT = (30.0, 60.0)  # s to connect, and s without a byte
CHUNK = 1 << 16
AGAIN = (408, 425, 429, 500, 502, 503, 504)  # HTTP statuses that may be temporary


class _Broken(Exception):
    """A failed try; the next one may succeed."""


class _Changed(_Broken):
    """The bytes downloaded so far are not the beginning of the server's file."""


class _NotHere(Exception):
    """The file isn't available at an address or in a folder; the message says why."""


# errors that end a try; OSError would be too wide, because errors of the disk are OSErrors, too
_FAILURES = (_Broken, requests.RequestException, urllib3.exceptions.HTTPError)


def fetch(archive: Archive, root: Path, work: Path, info: Info) -> Path:
    """Return the path of the intact archive: in `root`, in a local mirror, or downloaded into `root`.

    Sources are tried in order: NVSDATA_MIRROR, the archive's `urls`, the archive that contains it (`within`). No
    existing file is overwritten.

    Args:
        archive: the archive.
        root: folder of the dataset.
        work: a folder on the same disk for unfinished files.
        info: facts about the dataset.

    Raises:
        DownloadError: no place has the archive, the disk is full or fails, or a file with the archive's name in `root`
            is not the archive.
    """
    try:
        return _find_or_download(archive, root, work, info)
    except _NotHere as faults:
        raise DownloadError(_instructions(archive, root, info, str(faults))) from faults


def _find_or_download(archive: Archive, root: Path, work: Path, info: Info) -> Path:
    """Return the path of the archive; _NotHere if no source has it, with the failure of each source as the message."""
    path, part = root / archive.name, _Part(work / archive.name)
    if path.exists():
        if fault := archive_fault(path, archive.hash):
            raise _NotHere(f"{path} {fault}; move it away")
        return path
    faults = []
    for place in _places(archive, info):
        try:
            if isinstance(place, Path):
                if fault := archive_fault(place, archive.hash):
                    raise _NotHere(f"it {fault}")
                return place
            if isinstance(place, Archive):
                _take_from(place, part, archive, work, info)
            else:
                _download(place, part, archive)
        except _NotHere as refused:
            faults.append(shown(f"{place.name if isinstance(place, Archive) else place}: {refused}"))
        except DownloadError:
            raise
        except OSError as error:
            raise DownloadError(f"{error.filename or part.path}: {error.strerror or error}") from error
        else:
            if path.exists():
                raise DownloadError(f"{path} appeared during the download; move it away and try again")
            part.path.rename(path)
            part.discard()
            return path
    raise _NotHere("\n  ".join(faults))


def _places(archive: Archive, info: Info) -> Iterator[Path | str | Archive]:
    """Yield the sources to try: the user's mirror (the dataset's folder in it first), then the known addresses."""
    mirror, names = os.environ.get(MIRROR, ""), (f"{info.name}/{archive.name}", archive.name)
    if mirror.startswith(("http://", "https://")):
        yield from (f"{mirror.rstrip('/')}/{quote(name)}" for name in names)
    elif mirror:
        folder = Path(mirror).expanduser()
        if not folder.is_dir():
            raise DownloadError(f"{MIRROR} must be a folder or begin with https:// or http://, not {mirror!r}")
        yield from (folder / name for name in names if (folder / name).is_file())
    yield from archive.urls
    if archive.within is not None:
        yield archive.within


def _take_from(outer: Archive, part: _Part, archive: Archive, work: Path, info: Info) -> None:
    """Extract the archive from the archive `outer`, which is fetched into `work`; _NotHere if that isn't possible."""
    found = _find_or_download(outer, work, work, info)
    part.discard()
    extract_file(found, archive.name, part.path)
    if fault := archive_fault(part.path, archive.hash):
        part.discard()
        raise _NotHere(f"the file in it {fault}")


def _instructions(archive: Archive, root: Path, info: Info, faults: str) -> str:
    """Return how to download the archive with a browser, and why that is necessary."""
    facts = [f"about {archive.size / 1e9:.1f} GB"] if archive.size else []
    facts += [f"{kind_of(archive.hash)} {archive.hash}"] if archive.hash else []
    known = f" ({', '.join(facts)})" if facts else ""
    message = f"can't download {archive.name}: get it with a browser from {info.page}, put it into {shown(root)}{known}"
    return f"{message} and try again" + (f". What went wrong:\n  {faults}" if faults else "")


class _Part:
    """A partly downloaded file, and a second file with a note: address, version and size of the server's file."""

    def __init__(self, path: Path) -> None:
        self.path, self._note = path.with_name(path.name + ".part"), path.with_name(path.name + ".json")

    def __len__(self) -> int:
        return self.path.stat().st_size if self.path.exists() else 0

    def discard(self) -> None:
        self.path.unlink(missing_ok=True)
        self._note.unlink(missing_ok=True)

    @property
    def note(self) -> dict[str, Any]:
        with contextlib.suppress(OSError, ValueError, RecursionError):
            found = json.loads(read_own(self._note, MOST_NOTE))
            if isinstance(found, dict):
                return found
        return {}

    @note.setter
    def note(self, note: dict[str, Any]) -> None:
        remove_link(self._note)
        self._note.write_text(json.dumps(note), encoding="utf-8")


def _download(url: str, part: _Part, archive: Archive) -> None:
    """Download the rest of a part and check the file; _NotHere if that isn't possible, OSError if the disk fails."""
    for last in (False, True):
        in_pieces = _transfer(url, part, archive)
        fault = archive_fault(part.path, archive.hash)
        if not fault:
            return
        part.discard()
        # the pieces may belong to different versions of the file: try once more from the beginning
        if last or not in_pieces:
            raise _NotHere(f"the file that the server sent {fault}")


def _transfer(url: str, part: _Part, archive: Archive) -> bool:
    """Repeat `_one_try`, with growing pauses, as long as new bytes arrive; return whether the part came in pieces."""
    most, fruitless, changes, pause = len(part), 0, 0, PAUSE
    while True:
        before = len(part)
        try:
            return _one_try(url, part, archive)
        except _FAILURES as error:
            have = len(part)
            fruitless = 0 if have > most else fruitless + 1
            changes += isinstance(error, _Changed)
            most = 0 if isinstance(error, _Changed) else max(most, have)
            if TRIES in (fruitless, changes):
                raise _NotHere(_reason(error)) from error
            if have - before > MUCH:
                pause = PAUSE
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)


def _reason(error: BaseException) -> str:
    """Return the reason why a connection failed: urllib3's innermost message."""
    inner = getattr(error, "reason", None) or (error.args[0] if error.args else None)
    if isinstance(inner, BaseException):
        return _reason(inner)
    return re.sub(r"<[^>]*>: ?", "", str(error)) or type(error).__name__


def _one_try(url: str, part: _Part, archive: Archive) -> bool:
    """Request the missing bytes and append them; return whether the part had bytes before. Raises _FAILURES."""
    have, note = len(part), part.note
    version = note.get("version", "") if note.get("url") == url else ""
    headers = {"Accept-Encoding": "identity"}
    # without a version or a hash, the bytes of another version of the file would go unnoticed
    if have and (version or archive.hash):
        headers["Range"] = f"bytes={have}-"
        if version:
            headers["If-Range"] = version
    with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT) as response:
        chunks = _bytes_of(response)
        begin, total = _extent(response)
        now = _version(response)
        is_same = not (now and version and now != version) and total in (None, note.get("total") or total)
        if response.status_code == 416 and total == have and is_same:
            return True
        if response.status_code != 200 and not (begin == have and is_same):
            part.discard()
            raise _Changed("the server's file changed during the download")
        if archive.hash and archive.size and total not in (None, archive.size):
            raise _NotHere(f"the server has {total:,} bytes, not {archive.size:,}")
        _check_disk(part.path.parent, (total or archive.size) - begin)
        if not begin:
            part.discard()
        part.note = {"url": url, "version": now or version, "total": total}
        _append(part.path, chunks, begin, total, archive.name)
    if total is not None and len(part) != total:
        raise _Broken(f"the connection broke off after {len(part):,} of {total:,} bytes")
    return begin > 0


def probe(url: str) -> tuple[str, int | None]:
    """Return why a file isn't available at an address (empty if it is), and its size in bytes (None if unknown)."""
    headers = {"Accept-Encoding": "identity"}
    try:
        with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT) as response:
            _bytes_of(response)
            return "", _extent(response)[1]
    except (_NotHere, *_FAILURES) as error:
        return _reason(error), None


def _append(path: Path, chunks: Iterator[bytes], begin: int, total: int | None, name: str) -> None:
    shown: dict[str, Any] = {"initial": begin, "total": total, "desc": name, "unit": "B", "unit_scale": True}
    with append_own(path) as file, progress(**shown) as bar:
        for chunk in chunks:
            write_all(file.fileno(), chunk)
            bar.update(len(chunk))
        os.fsync(file.fileno())


def _bytes_of(response: requests.Response) -> Iterator[bytes]:
    """Return the bytes that a server sends, in chunks; _Broken or _NotHere if they don't belong to the file."""
    code = response.status_code
    status = f"HTTP {code} {response.reason or ''}".strip()
    # not decoded, because a compressed file may be declared as a compressed transfer
    chunks: Iterator[bytes] = response.raw.stream(CHUNK, decode_content=False)
    first = next(chunks, b"")
    page = "" if code == 206 else page_of(first)
    if code in AGAIN:
        raise _Broken(f"{status}: {page}" if page == QUOTA else status)
    if code >= 400 and code != 416:
        raise _NotHere(f"{status}: {page}" if page == QUOTA else status)
    if page and code != 416:
        raise _NotHere(f"the server sent {page}")
    if code not in (200, 206, 416):
        raise _NotHere(f"{status}: the server sent no file")
    if code == 200 and not first:
        raise _NotHere("the server sent nothing")
    return chain((first,), chunks)


def _extent(response: requests.Response) -> tuple[int, int | None]:
    """Return the position in the file of an answer's first byte (-1 if unknown), and the file's size if stated."""
    if response.status_code == 200:
        length = response.headers.get("Content-Length", "")
        return 0, int(length) if length.isdecimal() else None
    found = re.fullmatch(r"bytes (?:(\d+)-\d+|\*)/(?:(\d+)|\*)", response.headers.get("Content-Range", "").strip())
    begin, total = found.groups() if found else (None, None)
    return -1 if begin is None else int(begin), int(total) if total else None


def _version(response: requests.Response) -> str:
    """Return the version of the file: a strong ETag, otherwise the time of the last change, otherwise ""."""
    tag: str = response.headers.get("ETag", "")
    return tag if tag.startswith('"') else response.headers.get("Last-Modified", "")


def _check_disk(folder: Path, needed: int) -> None:
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OSError(errno.ENOSPC, f"{needed:,} bytes are missing, but the disk has {free:,} left", str(folder))
