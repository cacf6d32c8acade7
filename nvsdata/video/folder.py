"""Folders of videos, and the recordings that they are to become."""

from __future__ import annotations

import errno
import hashlib
import os
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from nvsdata import formats
from nvsdata.common.errors import FormatError

# formats that recordings are written in, and their extensions
FORMATS = {name: formats.FORMATS[name].suffixes[0] for name in ("hdf5", "aedat2", "aedat3", "text")}
VIDEOS = frozenset(".3gp .avi .flv .gif .m2ts .m4v .mkv .mov .mp4 .mpeg .mpg .mts .ogv .ts .webm .wmv".split())
# errors of the disk or the folder, not of one video: the videos after it would fail, too
FATAL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM)


class Video(NamedTuple):
    """A video.

    - `name`: its name below the folder of videos, with slashes
    - `path`: its file
    - `target`: the recording that it is to become
    """

    name: str
    path: Path
    target: Path


def videos_in(source: Path, out: Path, format: str = "hdf5", limit: int | None = None) -> list[Video]:
    """A video, or every video below a folder, sorted; recordings go to `out`, in the same tree of folders.

    FileNotFoundError if there is no video, ValueError for an unknown format, FormatError for a name that isn't UTF-8.
    """
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, not {format!r}")
    if not source.exists():
        raise FileNotFoundError(f"{source}: no such folder or video")
    root = source if source.is_dir() else source.parent
    paths = sorted(p for p in source.rglob("*") if p.suffix.lower() in VIDEOS) if source.is_dir() else [source]
    if not paths:
        raise FileNotFoundError(f"no videos below {source}; they end in {' '.join(sorted(VIDEOS))}")
    for path in paths:
        check_name(path)
    stems = Counter(path.relative_to(root).with_suffix("") for path in paths)
    found = []
    for path in paths[:limit]:
        name = path.relative_to(root)
        # a.avi and a.mp4 side by side keep their extensions
        kept = name if stems[name.with_suffix("")] > 1 else name.with_suffix("")
        found.append(Video(name.as_posix(), path, out / kept.with_name(kept.name + FORMATS[format])))
    return found


def check_name(path: str | os.PathLike[str]) -> None:
    """FormatError for a name that isn't UTF-8: OpenCV would end the process in a crash."""
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        raise FormatError(path, "a name that isn't UTF-8, which OpenCV can't open: rename the file") from None


def fatal(error: OSError, video: Path) -> bool:
    """Whether an error with a video is the disk's or the folder's, so that other videos would have it, too."""
    if error.errno in (errno.EACCES, errno.EPERM) and error.filename == os.fspath(video):
        return False
    return error.errno in FATAL


def sha256(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
