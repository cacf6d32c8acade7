"""Archives: fetched by pooch, checked, resumed where they broke off, unpacked whole or not at all."""

from __future__ import annotations

import shutil
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import pooch

from nvsdata.datasets.base import Archive

MOST_BYTES = 100 << 30  # that an archive may unpack to, nested ones included
MOST_FILES = 1_000_000
DEEPEST = 3  # archives within archives


class DownloadError(OSError):
    """An archive that could not be had; says how to get it by hand."""


def fetch_and_unpack(archive: Archive, root: Path, page: str = "") -> Path:
    """Make sure that `root/archive.folder` exists, downloading and unpacking where needed; return it.

    An archive that was put into `root` by hand is recognised by its hash. What was half unpacked
    is unpacked anew. Raises DownloadError if no URL gives a file of that hash, or the archive can't
    be unpacked safely.
    """
    folder = root / archive.folder
    if folder.is_dir():
        return folder
    root.mkdir(parents=True, exist_ok=True)
    path = fetch(archive, root, page)
    partial = root / f".{archive.folder}.part"
    shutil.rmtree(partial, ignore_errors=True)
    unpack(path, partial)
    # the archive may hold the folder itself or only what belongs into it
    inner = partial / archive.folder
    (inner if inner.is_dir() and len(list(partial.iterdir())) == 1 else partial).rename(folder)
    shutil.rmtree(partial, ignore_errors=True)
    return folder


def fetch(archive: Archive, root: Path, page: str = "") -> Path:
    """Download the archive into `root` unless it lies there intact; return its path."""
    path = root / archive.name
    if _intact(path, archive.hash):
        return path
    partial = root / f"{archive.name}.part"
    faults: list[str] = []
    if path.exists():
        faults.append(f"{path}: {_what_came(path, archive.hash)}")
    for url in archive.urls:
        # a second try starts anew, for when what was there was wrong or the server can't resume
        for _ in range(2):
            try:
                _resume(url, partial)
            except OSError as error:
                faults.append(f"{url}: {error}")
                continue
            if _intact(partial, archive.hash):
                partial.replace(path)
                return path
            faults.append(f"{url}: {_what_came(partial, archive.hash)}")
            partial.unlink(missing_ok=True)
    raise DownloadError(_by_hand(archive, root, page, faults))


def _by_hand(archive: Archive, root: Path, page: str, faults: list[str]) -> str:
    """What to do where a browser is needed."""
    kind = {32: "md5", 64: "sha256"}.get(len(archive.hash))
    facts = [f"about {archive.size / 1e9:.1f} GB"] if archive.size else []
    facts += [f"{kind} {archive.hash}"] if kind else []
    where = f" from {page}" if page else ""
    known = f" ({', '.join(facts)})" if facts else ""
    words = f"can't download {archive.name}: get it with a browser{where}, put it into {root}{known} and try again"
    return "\n  ".join([words + (". What went wrong:" if faults else ""), *faults])


def unpack(path: Path, folder: Path) -> None:
    """Unpack a zip or tar, and the zips in it (each into a folder of its name), into `folder`.

    DownloadError, before anything of an archive is written, if an entry of it is a link or leads
    out of the folder, or it unpacks to more than `MOST_BYTES` or `MOST_FILES`.
    """
    _unpack(path, folder, [MOST_BYTES, MOST_FILES], DEEPEST)


def _unpack(path: Path, folder: Path, room: list[int], depth: int) -> None:
    try:
        with _opened(path) as archive:
            for name, size, is_file, is_folder, _ in _entries(archive):
                parts = Path(name.replace("\\", "/")).parts
                if not (is_file or is_folder) or ".." in parts or Path(name).is_absolute() or ":" in parts[:1]:
                    raise DownloadError(f"{path}: refused to unpack {name!r}, which leads elsewhere")
                room[0] -= size
                room[1] -= 1
            if min(room) < 0:
                raise DownloadError(
                    f"{path}: refused, it unpacks to more than {MOST_BYTES} bytes or {MOST_FILES} files"
                )
            for name, _, is_file, _, file in _entries(archive, contents=True):
                target = folder / name.replace("\\", "/")
                (target.parent if is_file else target).mkdir(parents=True, exist_ok=True)
                if file is not None:
                    with file, target.open("wb") as out:
                        shutil.copyfileobj(file, out, 1 << 20)
    except (zipfile.BadZipFile, tarfile.TarError, EOFError) as error:
        raise DownloadError(f"{path}: damaged archive: {error}") from error
    for inner in sorted(folder.rglob("*.zip")) if depth else ():
        _unpack(inner, inner.with_suffix(""), room, depth - 1)
        inner.unlink()


def _opened(path: Path) -> zipfile.ZipFile | tarfile.TarFile:
    if zipfile.is_zipfile(path):
        return zipfile.ZipFile(path)
    return tarfile.open(path)


def _entries(
    archive: zipfile.ZipFile | tarfile.TarFile, contents: bool = False
) -> Iterator[tuple[str, int, bool, bool, IO[bytes] | None]]:
    """Name, size, whether it is a file or a folder, and the opened file if asked for."""
    if isinstance(archive, zipfile.ZipFile):
        for entry in archive.infolist():
            is_link = (entry.external_attr >> 16) & 0o170000 == 0o120000
            is_file = not (is_link or entry.is_dir())
            file = archive.open(entry) if contents and is_file else None
            yield entry.filename, entry.file_size, is_file, entry.is_dir(), file
        return
    for member in archive:
        file = archive.extractfile(member) if contents and member.isfile() else None
        yield member.name, member.size, member.isfile(), member.isdir(), file


def _resume(url: str, partial: Path) -> None:
    """Append to `partial` what is missing of it. OSError if the connection or the server fails."""
    have = partial.stat().st_size if partial.exists() else 0
    headers = {"Range": f"bytes={have}-"} if have else {}
    with partial.open("ab") as file:
        pooch.HTTPDownloader(progressbar=True, headers=headers)(url, file, None)


def _intact(path: Path, expected: str) -> bool:
    """Whether the file has the hash or, where none is known, is an archive."""
    if not path.is_file():
        return False
    if not expected:
        return zipfile.is_zipfile(path) or tarfile.is_tarfile(path)
    found: str = pooch.file_hash(str(path), alg="md5" if len(expected) == 32 else "sha256")
    return found == expected


def _what_came(partial: Path, expected: str) -> str:
    """Why the file is not the one: nothing, a web page, or other bytes."""
    with partial.open("rb") as file:
        head = file.read(64)
    if not head:
        return "the server sent nothing"
    if head.lstrip().lower().startswith((b"<!doctype", b"<html")):
        return "the server sent a web page: the file needs a browser"
    kind = {32: "md5", 64: "sha256"}.get(len(expected))
    return f"the file's {kind} is wrong" if kind else "it is no archive"
