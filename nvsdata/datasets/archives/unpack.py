"""Archives unpacked: whole into a folder that was not there before, or not at all."""

from __future__ import annotations

import lzma
import os
import re
import shutil
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from nvsdata.common.errors import DownloadError

MOST_BYTES = 100 << 30  # that an archive may unpack to, those within it included
MOST_FILES = 1_000_000
MOST_TIMES, SMALL = 100, 1 << 28  # how many times its own size, once that is no longer small; recordings shrink less
DEEPEST = 3  # archives within archives
BLOCK = 4096  # bytes of disk that files are counted in
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
# what Python's readers raise for damaged archives, besides an OSError without a number
_DAMAGE = (
    zipfile.BadZipFile,
    tarfile.TarError,
    EOFError,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    ValueError,
    LookupError,
    OverflowError,
    MemoryError,
    RuntimeError,
)
_ZIP_END, _IN_64_BITS = struct.Struct("<4s4H2LH"), 0xFFFF  # the record that ends a zip
_WINDOWS_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d) *(\..*)?", re.IGNORECASE)


def unpack(path: Path, folder: Path) -> None:
    """Unpack a zip or tar, and the zips in it (each into a folder of its name), into `folder`, which it makes.

    Nothing outside `folder` is written or removed, and what all entries declare is checked before any is written.
    DownloadError, with no folder left behind, if `folder` is there already; if an entry is a link or a device, leads
    out of the folder, is there twice, is encrypted, damaged or compressed by an unknown method; if the archive breaks
    off or fails its checksum; if it unpacks to more than `MOST_BYTES`, `MOST_FILES`, `MOST_TIMES` its size or what
    the disk has room for.
    """
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise DownloadError(f"{path}: not unpacked, because {folder} is there already") from None
    try:
        room = _Room(min(MOST_BYTES, max(SMALL, MOST_TIMES * path.stat().st_size)), MOST_FILES)
        _unpack(path, str(path), folder, room, DEEPEST)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def take_out(path: Path, file: str, target: Path) -> None:
    """Write what a zip holds under the name `file`, in whatever folder, to `target`. DownloadError if it can't."""
    with _told(f"{path}: damaged archive"), _opened(path, str(path)) as archive:
        entries = list(_entries(archive, str(path), target.parent, _Room(MOST_BYTES, MOST_FILES)))
        found = [entry for entry in entries if entry.name.rsplit("/", 1)[-1] == file]
        if not found:
            raise DownloadError(f"{path}: {file!r} is not in it")
        _check_disk(target.parent, found[0].size, str(path))
        with _told(f"{path}: can't unpack {file!r}"):
            _write(archive, found[0], target)


def is_archive(path: Path) -> bool:
    """Whether a file is a zip or a tar, as far as its beginning and a zip's end tell."""
    return zipfile.is_zipfile(path) if _is_zip(path) else tarfile.is_tarfile(path)


def _is_zip(path: Path) -> bool:
    # not by its end alone, which may be that of a zip within a tar
    with path.open("rb") as file:
        return file.read(2) == b"PK"


@dataclass(frozen=True)
class _Entry:
    """A file or folder of an archive, and what Python's module calls it by."""

    name: str
    size: int
    is_folder: bool
    member: zipfile.ZipInfo | tarfile.TarInfo


@dataclass
class _Room:
    """What may still be unpacked."""

    bytes: int
    files: int

    def take(self, size: int, archive: str) -> None:
        """Take a file off it; DownloadError if there is no room for it."""
        self.bytes -= size
        self.files -= 1
        if self.bytes < 0 or self.files < 0:
            raise DownloadError(
                f"{archive}: refused, it unpacks to more than {MOST_BYTES:,} bytes, {MOST_FILES:,} files or "
                f"{MOST_TIMES} times its size"
            )


def _unpack(path: Path, name: str, folder: Path, room: _Room, depth: int) -> None:
    """Unpack an archive that messages call `name`."""
    with _told(f"{name}: damaged archive"), _opened(path, name) as archive:
        entries = list(_entries(archive, name, folder, room))
        if not entries:
            raise DownloadError(f"{name}: there is nothing in it")
        _check_disk(folder, sum(-(-entry.size // BLOCK) * BLOCK for entry in entries), name)
        for entry in entries:
            with _told(f"{name}: can't unpack {entry.name!r}"):
                _write(archive, entry, folder.joinpath(*_parts(entry.name, name)))
    for inner in sorted(p for p in folder.rglob("*") if depth and _is_inner(p.name) and p.is_file()):
        there = inner.with_name(_stem(inner.name))
        _unpack(inner, f"{name}: {str(inner.relative_to(folder))!r}", there, room, depth - 1)
        inner.unlink()


def _opened(path: Path, name: str) -> zipfile.ZipFile | tarfile.TarFile:
    if _is_zip(path):
        return zipfile.ZipFile(path)
    try:
        return tarfile.open(path)
    except tarfile.ReadError:
        raise DownloadError(f"{name}: neither a zip nor a tar, or damaged at its beginning") from None


def _write(archive: zipfile.ZipFile | tarfile.TarFile, entry: _Entry, target: Path) -> None:
    (target if entry.is_folder else target.parent).mkdir(parents=True, exist_ok=True)
    if entry.is_folder:
        return
    file: IO[bytes] | None
    if isinstance(archive, zipfile.ZipFile):
        assert isinstance(entry.member, zipfile.ZipInfo)
        file = archive.open(entry.member)
    else:
        assert isinstance(entry.member, tarfile.TarInfo)
        file = archive.extractfile(entry.member)
    assert file is not None, "what is not a folder is a file"
    # x: another entry of that name, or on some systems of that name in another case, is not written over
    with file, target.open("xb") as out:
        shutil.copyfileobj(file, out, 1 << 20)


def _entries(archive: zipfile.ZipFile | tarfile.TarFile, name: str, folder: Path, room: _Room) -> Iterator[_Entry]:
    """What is in an archive; DownloadError if any of it can't be unpacked."""
    listed = _of_zip(archive, name) if isinstance(archive, zipfile.ZipFile) else _of_tar(archive, name, folder)
    for entry in listed:
        parts = _parts(entry.name, name)
        if parts and _is_inner(parts[-1]) and not _stem(parts[-1]).strip(". "):
            raise _refused(name, entry.name, "leads elsewhere")
        room.take(entry.size, name)
        yield entry


def _of_zip(archive: zipfile.ZipFile, name: str) -> Iterator[_Entry]:
    # Python reads a directory as far as it makes sense; its end says how many entries there are, in 16 bits
    file, listed = archive.fp, archive.infolist()
    assert file is not None
    file.seek(-_ZIP_END.size - len(archive.comment), os.SEEK_END)
    end = _ZIP_END.unpack(file.read(_ZIP_END.size))
    if end[0] == b"PK\5\6" and end[4] not in (_IN_64_BITS, len(listed) & 0xFFFF):
        raise DownloadError(f"{name}: damaged archive: {len(listed):,} entries can be found, of {end[4]:,}")
    for info in listed:
        if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise _refused(name, info.filename, "a link or a device")
        if info.flag_bits & 1:
            raise DownloadError(f"{name}: {info.filename!r} is encrypted; unpack the archive by hand")
        if info.compress_type not in METHODS:
            method = "Deflate64" if info.compress_type == 9 else f"method {info.compress_type}"
            raise DownloadError(
                f"{name}: {info.filename!r} is compressed by {method}, which Python can't read; unpack it by hand"
            )
        yield _Entry(info.filename, info.file_size, info.is_dir(), info)


def _of_tar(archive: tarfile.TarFile, name: str, folder: Path) -> Iterator[_Entry]:
    for member in archive:
        if not (member.isfile() or member.isdir()):
            raise _refused(name, member.name, "a link or a device")
        try:
            tarfile.data_filter(member, str(folder))
        except tarfile.FilterError as error:
            raise _refused(name, member.name, str(error)) from None
        yield _Entry(member.name, member.size, member.isdir(), member)
    # Python takes a damaged header for the end, and does not read on to the checksum of what is compressed
    file = archive.fileobj
    assert file is not None
    file.seek(archive.offset)
    if file.read(tarfile.BLOCKSIZE) != bytes(tarfile.BLOCKSIZE):
        raise DownloadError(f"{name}: damaged archive: no entry and no end at byte {archive.offset:,} of the tar")
    while file.read(1 << 20):
        pass


def _parts(entry: str, archive: str) -> tuple[str, ...]:
    """The folders and the file of an entry's name; DownloadError if it leads out of a folder on any system."""
    flat = entry.replace("\\", "/")
    parts = tuple(part for part in flat.split("/") if part not in ("", "."))
    # Windows drops dots and spaces at the end; it has drives, streams (a:b), and devices in every folder
    odd = any(not part.strip(". ") or ":" in part or _WINDOWS_DEVICE.fullmatch(part) for part in parts)
    if odd or flat.startswith("/"):
        raise _refused(archive, entry, "leads elsewhere")
    return parts


def _refused(archive: str, entry: str, why: str) -> DownloadError:
    return DownloadError(f"{archive}: refused to unpack {entry!r}: {why}")


def _is_inner(file: str) -> bool:
    """Whether a file's name is that of a zip, and not of what macOS adds beside each file."""
    return file.lower().endswith(".zip") and not file.startswith("._")


def _stem(file: str) -> str:
    return file[: -len(".zip")]


def _check_disk(folder: Path, needed: int, archive: str) -> None:
    there = next(parent for parent in (folder, *folder.parents) if parent.is_dir())
    free = shutil.disk_usage(there).free
    if needed > free:
        raise DownloadError(f"{archive}: unpacks to {needed:,} bytes, but the disk has {free:,} left")


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Turn whatever goes wrong with an archive or the disk into one line."""
    try:
        yield
    except DownloadError:
        raise
    except _DAMAGE as error:
        raise DownloadError(f"{what}: {error or type(error).__name__}") from error
    except OSError as error:
        raise DownloadError(f"{what}: {error.strerror or error}") from error
