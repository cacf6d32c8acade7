"""Archives: fetched by pooch, checked, resumed where they broke off, unpacked whole or not at all."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import pooch

from nvsdata.datasets.base import Archive


class DownloadError(RuntimeError):
    """An archive that could not be had; says how to get it by hand."""


def fetch_and_unpack(archive: Archive, root: Path) -> Path:
    """Make sure that `root/archive.folder` exists, downloading and unpacking where needed; return it.

    An archive that was put into `root` by hand is recognised by its md5. Raises DownloadError if
    no URL gives a file of that md5.
    """
    folder = root / archive.folder
    if folder.is_dir():
        return folder
    root.mkdir(parents=True, exist_ok=True)
    path = fetch(archive, root)
    partial = root / f".{archive.folder}.part"
    shutil.rmtree(partial, ignore_errors=True)
    unpack(path, partial)
    # the archive may hold the folder itself or only what belongs into it
    inner = partial / archive.folder
    (inner if inner.is_dir() else partial).rename(folder)
    shutil.rmtree(partial, ignore_errors=True)
    return folder


def fetch(archive: Archive, root: Path) -> Path:
    """Download the archive into `root` unless it lies there intact; return its path."""
    path = root / archive.name
    if _intact(path, archive.md5):
        return path
    partial = root / f"{archive.name}.part"
    faults: list[str] = []
    for url in archive.urls:
        # a second try starts anew, for when what was there was wrong or the server can't resume
        for _ in range(2):
            try:
                _resume(url, partial)
            except OSError as error:
                faults.append(f"{url}: {error}")
                continue
            if _intact(partial, archive.md5):
                partial.replace(path)
                return path
            faults.append(f"{url}: {_what_came(partial)}")
            partial.unlink(missing_ok=True)
    raise DownloadError(
        f"can't download {archive.name}; get it with a browser, put it into {root} "
        f"(md5 {archive.md5}) and try again. What went wrong:\n  " + "\n  ".join(faults)
    )


def unpack(path: Path, folder: Path) -> None:
    """Unpack a zip into `folder`. DownloadError if an entry is a link or leads out of the folder."""
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            parts = Path(entry.filename.replace("\\", "/")).parts
            is_link = (entry.external_attr >> 16) & 0o170000 == 0o120000
            if is_link or ".." in parts or Path(entry.filename).is_absolute():
                raise DownloadError(f"{path}: refused to unpack {entry.filename!r}, which leads elsewhere")
        archive.extractall(folder)


def _resume(url: str, partial: Path) -> None:
    """Append to `partial` what is missing of it. OSError if the connection or the server fails."""
    have = partial.stat().st_size if partial.exists() else 0
    headers = {"Range": f"bytes={have}-"} if have else {}
    with partial.open("ab") as file:
        pooch.HTTPDownloader(progressbar=True, headers=headers)(url, file, None)


def _intact(path: Path, md5: str) -> bool:
    return path.is_file() and pooch.file_hash(str(path), alg="md5") == md5


def _what_came(partial: Path) -> str:
    """Why the file is not the one: nothing, a web page, or other bytes."""
    with partial.open("rb") as file:
        head = file.read(64)
    if not head:
        return "the server sent nothing"
    if head.lstrip().lower().startswith((b"<!doctype", b"<html")):
        return "the server sent a web page: the file needs a browser"
    return "the file's md5 is wrong"
