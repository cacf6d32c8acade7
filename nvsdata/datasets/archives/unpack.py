"""Safe unpacking of archives: completely, into a new folder, or not at all."""

from __future__ import annotations

import lzma
import os
import re
import shutil
import stat
import struct
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from nvsdata.common.errors import DownloadError, shown

MOST_BYTES = 100 << 30  # bytes that an archive may unpack to, including the archives inside it
MOST_FILES = 1_000_000
MOST_TIMES, SMALL = 100, 1 << 28  # an archive may unpack to SMALL bytes, or to more if at most this many times its size
DEEPEST = 3  # levels of archives within archives
BLOCK = 4096  # bytes of a disk block, to which the sizes of files are rounded up
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
# exceptions of Python's readers for damaged archives, in addition to an OSError without a number
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
    """Unpack a zip or tar, and the zips in it (each into a folder with its name), into the new folder `folder`.

    Nothing outside `folder` is written or removed, and the headers of all entries are checked before any is written.

    Args:
        path: the archive.
        folder: the new folder.

    Raises:
        DownloadError: `folder` exists; an entry is a link or a device, leads out of the folder, occurs twice, is
            encrypted, damaged or compressed by an unknown method; the archive is truncated or fails its checksum; it
            unpacks to more than `MOST_BYTES`, `MOST_FILES`, `MOST_TIMES` times its size, or more than the free space
            of the disk. No folder is left behind.
    """
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise DownloadError(f"{shown(path)}: not unpacked, because {shown(folder)} already exists") from None
    try:
        budget = _Budget(min(MOST_BYTES, max(SMALL, MOST_TIMES * path.stat().st_size)), MOST_FILES)
        _unpack(path, shown(path), folder, budget, DEEPEST)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def first_difference(path: Path, folder: Path, work: Path) -> str:
    """Return the first difference between an archive and the folder that it was unpacked into; empty if none.

    Args:
        path: the archive.
        folder: folder with its entries; zips in the archive are compared with folders of their names.
        work: a folder for temporary files.

    Returns:
        A message that names the entry that is missing or different, byte for byte.

    Raises:
        DownloadError: the archive can't be read.
    """
    with _as_download_error(f"{path}: damaged archive"), _opened(path, str(path)) as archive:
        for entry in list(_entries(archive, str(path), folder, _Budget(MOST_BYTES, MOST_FILES))):
            target = folder.joinpath(*_parts(entry.name, str(path)))
            if entry.is_folder:
                if not target.is_dir():
                    return f"{target} is missing"
            elif _is_inner(target.name):
                with tempfile.TemporaryDirectory(dir=work) as there:
                    _write(archive, entry, Path(there, target.name))
                    if found := first_difference(Path(there, target.name), target.with_name(_stem(target.name)), work):
                        return found
            elif not target.is_file():
                return f"{target} is missing"
            elif not _is_copy(archive, entry, target):
                return f"{target} is different"
    return ""


def _is_copy(archive: zipfile.ZipFile | tarfile.TarFile, entry: _Entry, target: Path) -> bool:
    if target.stat().st_size != entry.size:
        return False
    with _content(archive, entry) as one, target.open("rb") as other:
        while piece := one.read(1 << 20):
            if piece != other.read(len(piece)):
                return False
    return True


def extract_file(path: Path, file: str, target: Path) -> None:
    """Extract the entry named `file`, in any folder of the archive, to `target`; DownloadError if that fails."""
    with _as_download_error(f"{shown(path)}: damaged archive"), _opened(path, shown(path)) as archive:
        entries = list(_entries(archive, shown(path), target.parent, _Budget(MOST_BYTES, MOST_FILES)))
        found = [entry for entry in entries if entry.name.rsplit("/", 1)[-1] == file]
        if not found:
            raise DownloadError(f"{shown(path)}: {file!r} is not in it")
        _check_disk(target.parent, found[0].size, shown(path))
        with _as_download_error(f"{shown(path)}: can't unpack {file!r}"):
            _write(archive, found[0], target)


def is_archive(path: Path) -> bool:
    """Return whether a file is a zip or a tar, by its beginning and, for a zip, its end."""
    return zipfile.is_zipfile(path) if _is_zip(path) else tarfile.is_tarfile(path)


def _is_zip(path: Path) -> bool:
    # the end alone may belong to a zip within a tar
    with path.open("rb") as file:
        return file.read(2) == b"PK"


@dataclass(frozen=True)
class _Entry:
    """A file or folder in an archive, and the object by which Python's reader describes it."""

    name: str
    size: int
    is_folder: bool
    member: zipfile.ZipInfo | tarfile.TarInfo


@dataclass
class _Budget:
    """Number of bytes and files that may still be unpacked."""

    bytes: int
    files: int

    def take(self, size: int, archive: str) -> None:
        """Subtract a file of `size` bytes; DownloadError, which names `archive`, if that exceeds the limits."""
        self.bytes -= size
        self.files -= 1
        if self.bytes < 0 or self.files < 0:
            raise DownloadError(
                f"{archive}: refused, it unpacks to more than {MOST_BYTES:,} bytes, {MOST_FILES:,} files or "
                f"{MOST_TIMES} times its size"
            )


def _unpack(path: Path, name: str, folder: Path, budget: _Budget, depth: int) -> None:
    """Unpack an archive, which messages call `name`."""
    with _as_download_error(f"{name}: damaged archive"), _opened(path, name) as archive:
        entries = list(_entries(archive, name, folder, budget))
        if not entries:
            raise DownloadError(f"{name}: there is nothing in it")
        _check_disk(folder, sum(-(-entry.size // BLOCK) * BLOCK for entry in entries), name)
        for entry in entries:
            with _as_download_error(f"{name}: can't unpack {entry.name!r}"):
                _write(archive, entry, folder.joinpath(*_parts(entry.name, name)))
    for inner in sorted(p for p in folder.rglob("*") if depth and _is_inner(p.name) and p.is_file()):
        there = inner.with_name(_stem(inner.name))
        _unpack(inner, f"{name}: {str(inner.relative_to(folder))!r}", there, budget, depth - 1)
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
    # mode x doesn't overwrite an entry of the same name, or of one that differs in case only and is the same file
    with _content(archive, entry) as file, target.open("xb") as out:
        shutil.copyfileobj(file, out, 1 << 20)


def _content(archive: zipfile.ZipFile | tarfile.TarFile, entry: _Entry) -> IO[bytes]:
    """Return a stream of the bytes of a file in an archive."""
    file: IO[bytes] | None
    if isinstance(archive, zipfile.ZipFile):
        assert isinstance(entry.member, zipfile.ZipInfo)
        file = archive.open(entry.member)
    else:
        assert isinstance(entry.member, tarfile.TarInfo)
        file = archive.extractfile(entry.member)
    assert file is not None, "what is not a folder is a file"
    return file


def _entries(archive: zipfile.ZipFile | tarfile.TarFile, name: str, folder: Path, budget: _Budget) -> Iterator[_Entry]:
    """Yield the entries of an archive; DownloadError if any of them can't be unpacked."""
    listed = _of_zip(archive, name) if isinstance(archive, zipfile.ZipFile) else _of_tar(archive, name, folder)
    for entry in listed:
        parts = _parts(entry.name, name)
        if parts and _is_inner(parts[-1]) and not _stem(parts[-1]).strip(". "):
            raise _refused(name, entry.name, "its path leads out of the folder")
        budget.take(entry.size, name)
        yield entry


def _of_zip(archive: zipfile.ZipFile, name: str) -> Iterator[_Entry]:
    # Python reads the directory until it is damaged; the end record has the number of entries, in 16 bits
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
            raise DownloadError(f"{name}: {info.filename!r} is encrypted; unpack the archive manually")
        if info.compress_type not in METHODS:
            method = "Deflate64" if info.compress_type == 9 else f"method {info.compress_type}"
            raise DownloadError(
                f"{name}: {info.filename!r} is compressed by {method}, which Python can't read; unpack it manually"
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
    # Python takes a damaged header for the end, and doesn't read to the checksum of compressed data
    file = archive.fileobj
    assert file is not None
    file.seek(archive.offset)
    if file.read(tarfile.BLOCKSIZE) != bytes(tarfile.BLOCKSIZE):
        raise DownloadError(f"{name}: damaged archive: no entry and no end at byte {archive.offset:,} of the tar")
    while file.read(1 << 20):
        pass


def _parts(entry: str, archive: str) -> tuple[str, ...]:
    """Return the parts of an entry's path; DownloadError if it leads out of the folder on any operating system."""
    flat = entry.replace("\\", "/")
    parts = tuple(part for part in flat.split("/") if part not in ("", "."))
    # Windows drops dots and spaces at the end, and has drives, streams (a:b) and devices in every folder
    leads_elsewhere = any(not part.strip(". ") or ":" in part or _WINDOWS_DEVICE.fullmatch(part) for part in parts)
    if leads_elsewhere or flat.startswith("/"):
        raise _refused(archive, entry, "its path leads out of the folder")
    return parts


def _refused(archive: str, entry: str, why: str) -> DownloadError:
    return DownloadError(f"{archive}: refused to unpack {entry!r}: {why}")


def _is_inner(file: str) -> bool:
    """Return whether a file's name is that of a zip, and not of a file that macOS adds (._NAME)."""
    return file.lower().endswith(".zip") and not file.startswith("._")


def _stem(file: str) -> str:
    return file[: -len(".zip")]


def _check_disk(folder: Path, needed: int, archive: str) -> None:
    existing = next(parent for parent in (folder, *folder.parents) if parent.is_dir())
    free = shutil.disk_usage(existing).free
    if needed > free:
        raise DownloadError(f"{archive}: unpacks to {needed:,} bytes, but the disk has {free:,} left")


@contextmanager
def _as_download_error(action: str) -> Iterator[None]:
    """Turn any error of an archive or the disk into a DownloadError of one line that begins with `action`."""
    try:
        yield
    except DownloadError:
        raise
    except _DAMAGE as error:
        raise DownloadError(f"{action}: {error or type(error).__name__}") from error
    except OSError as error:
        raise DownloadError(f"{action}: {error.strerror or error}") from error
