"""Download of datasets: archives are fetched into a folder, checked, and unpacked completely or not at all."""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from nvsdata.common.errors import DownloadError, message_of, shown
from nvsdata.common.files import claimed, remove_link
from nvsdata.common.locks import lock_path, locked
from nvsdata.datasets.archives.arrival_check import archive_fault
from nvsdata.datasets.archives.transfer import MIRROR, fetch
from nvsdata.datasets.archives.unpack import first_difference, unpack
from nvsdata.datasets.facts import Archive, Info

WORK = ".nvsdata-download"  # folder in the root for unfinished work; it contains no files of the user


def download(info: Info, root: Path, *, keep: bool = True) -> list[Path]:
    """Download and unpack the archives of a dataset that are missing in `root`.

    Existing files don't change: an archive that was downloaded manually into `root` is used if its hash is right. An
    interrupted run can be repeated: transfers continue where they broke off, unpacking starts again. A folder gets its
    final name when it is complete.

    The environment variable NVSDATA_MIRROR names a folder of archives, or its address (https://...). The archive is
    looked for there first, as `info.name/ARCHIVE`, then as `ARCHIVE`.

    Args:
        info: facts about the dataset, including its archives.
        root: the dataset's folder, made if needed.
        keep: whether archives stay in `root`. If not, each is deleted once it is unpacked. An archive whose folder
            existed before is deleted if its hash is known and right, and the folder contains all of the archive, byte
            for byte; otherwise a warning says what is missing.

    Returns:
        The folders into which archives were unpacked, now or before.

    Raises:
        DownloadError: an archive can't be fetched or unpacked (a warning if it is `optional`).
        OutputInUse: another process downloads to `root`.
    """
    if not info.archives:
        raise DownloadError(f"{info.name} can't be downloaded by a program: see {info.page}")
    work = root / WORK
    remove_link(work)
    missing = [archive for archive in info.archives if not _is_there(root / archive.folder)]
    for archive in [archive for archive in missing if archive.optional and not _has_a_place(archive, root)]:
        warnings.warn(f"without {archive.folder}: put {archive.name} from {info.page} into {shown(root)}", stacklevel=2)
        missing.remove(archive)
    if missing or work.exists():
        root.mkdir(parents=True, exist_ok=True)
        with claimed(root):
            _get(missing, root, work, info, keep)
    elif lock_path(root).exists():
        # removes the lock of a run that was killed at its very end
        with suppress(OSError), locked(root):
            pass
    if not keep and unneeded_archives(info.archives, root):
        with claimed(root):
            for archive in info.archives:
                for path in unneeded_archives([archive], root):
                    if archive.hash and not archive_fault(path, archive.hash) and not _is_of_mirror(path):
                        _delete_if_unpacked(archive, path, root)
    return [root / archive.folder for archive in info.archives if _is_there(root / archive.folder)]


def _delete_if_unpacked(archive: Archive, path: Path, root: Path) -> None:
    """Delete an archive that was unpacked earlier, if its folder contains all of the archive; otherwise warn."""
    work = root / WORK
    work.mkdir(exist_ok=True)
    try:
        # the archive may contain the folder itself or only its content
        missing = first_difference(path, root / archive.folder, work) and first_difference(path, root, work)
    except DownloadError as error:
        missing = str(error)
    finally:
        # it stays if it contains an unfinished transfer
        with suppress(OSError):
            work.rmdir()
    if missing:
        reason = f"{shown(root / archive.folder)} doesn't contain all of it ({shown(missing)})"
        warnings.warn(f"{shown(path)} is kept: {reason}", stacklevel=3)
    else:
        path.unlink()


def unneeded_archives(archives: Iterable[Archive], root: Path) -> list[Path]:
    """Return the paths of the archives in `root` whose unpacked folder exists, too."""
    places = ((root / archive.name, root / archive.folder) for archive in archives)
    return [path for path, folder in places if path != folder and path.is_file() and _is_there(folder)]


def _is_of_mirror(path: Path) -> bool:
    """Return whether a file is in the user's folder NVSDATA_MIRROR, whose archives other programs may need."""
    mirror = os.environ.get(MIRROR, "")
    if not mirror or mirror.startswith(("http://", "https://")):
        return False
    return Path(mirror).expanduser().resolve() in path.resolve().parents


def _has_a_place(archive: Archive, root: Path) -> bool:
    known = archive.urls or archive.within
    return bool(known or os.environ.get(MIRROR) or (root / archive.name).exists())


def _get(archives: list[Archive], root: Path, work: Path, info: Info, keep: bool) -> None:
    work.mkdir(exist_ok=True)
    failed = False
    try:
        for archive in archives:
            try:
                path = _fetch_and_unpack(archive, root, work, info)
                if not keep and path == root / archive.name and not _is_of_mirror(path):
                    path.unlink()
            except DownloadError as error:
                if not archive.optional:
                    raise
                failed = True
                warnings.warn(f"without {archive.folder}: {message_of(error)}", stacklevel=3)
        if not failed:
            shutil.rmtree(work, ignore_errors=True)
    finally:
        # if it is not empty, the next run continues with its content
        with suppress(OSError):
            work.rmdir()


def _fetch_and_unpack(archive: Archive, root: Path, work: Path, info: Info) -> Path:
    """Unpack an archive into its folder; return the archive's path."""
    path, folder, unpacked = fetch(archive, root, work, info), root / archive.folder, work / "unpacked"
    # left by a run that was killed
    shutil.rmtree(unpacked, ignore_errors=True)
    try:
        unpack(path, unpacked)
    except DownloadError as error:
        again = "" if archive.hash else f"; move {path} away to download it again"
        raise DownloadError(f"{error}{again}") from error
    # the archive may contain the folder itself or only its content
    inner = unpacked / archive.folder
    (inner if [*unpacked.iterdir()] == [inner] and inner.is_dir() else unpacked).rename(folder)
    shutil.rmtree(unpacked, ignore_errors=True)
    return path


def _is_there(folder: Path) -> bool:
    """Return whether the folder exists and isn't empty; DownloadError for a file with that name."""
    if folder.exists() and not folder.is_dir():
        raise DownloadError(f"{shown(folder)} is a file, where a folder is to be unpacked: move it away and try again")
    return folder.is_dir() and any(folder.iterdir())
