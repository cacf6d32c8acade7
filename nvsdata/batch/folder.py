"""Folders of videos, and the names of their recordings."""

from __future__ import annotations

import errno
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from nvsdata import formats
from nvsdata.video.video_frame import check_name

# formats that recordings are written in, and their extensions
WRITTEN = "hdf5", "hdf5-gzip", "aedat2", "aedat3", "aedat4", "text"
FORMATS = {name: formats.FORMATS[name].suffixes[0] for name in WRITTEN}
VIDEOS = frozenset(".3gp .avi .flv .gif .m2ts .m4v .mkv .mov .mp4 .mpeg .mpg .mts .ogv .ts .webm .wmv".split())
# errors of the disk or the folder, after which all other videos would fail, too
FATAL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM)


class Video(NamedTuple):
    """A video, and the recording that will be made of it.

    Args:
        name: Name relative to the folder of videos, with slashes.
        path: File of the video.
        target: File of the recording.
        format: Format of the recording; None for the format of the extension of `target`.
    """

    name: str
    path: Path
    target: Path
    format: str | None = None


def videos_in(source: Path, out: Path, format: str = "hdf5", limit: int | None = None) -> list[Video]:
    """Return a video, or every video in a folder and its subfolders, sorted.

    Hidden files and folders are skipped, such as those that macOS adds.

    Args:
        source: A video or a folder of videos.
        out: Folder of the recordings, which gets the same tree of folders. A recording has its video's name, without
            the extension unless two would have the same name.
        format: Format of the recordings.
        limit: Number of videos to return, the first ones (default: all).

    Raises:
        FileNotFoundError: There is no video.
        ValueError: The format is unknown.
        FormatError: A name isn't UTF-8.
    """
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, not {format!r}")
    if not source.exists():
        raise FileNotFoundError(f"{source}: no such folder or video")
    root = source if source.is_dir() else source.parent
    paths = sorted(_below(source)) if source.is_dir() else [source]
    if not paths:
        raise FileNotFoundError(
            f"no videos in {source} and its subfolders; known extensions are {' '.join(sorted(VIDEOS))}"
        )
    for path in paths:
        check_name(path)
    names = {path.relative_to(root) for path in paths}
    stems = Counter(name.with_suffix("") for name in names)
    found = []
    for path in paths[:limit]:
        name = path.relative_to(root)
        # a.avi, a.mp4 and a.avi.mp4 in one folder keep their extensions
        short = name.with_suffix("")
        kept = name if stems[short] > 1 or short in names else short
        found.append(Video(name.as_posix(), path, out / kept.with_name(kept.name + FORMATS[format]), format))
    return found


def _below(source: Path) -> Iterator[Path]:
    """Yield the videos in a folder and its subfolders; hidden files and folders are skipped."""
    for folder, folders, files in os.walk(source):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if not name.startswith(".") and Path(name).suffix.lower() in VIDEOS:
                yield Path(folder) / name


def is_fatal(error: OSError, video: Path) -> bool:
    """Return whether an error with a video is one of the disk or the folder, which would fail other videos, too."""
    if error.errno in (errno.EACCES, errno.EPERM) and error.filename == os.fspath(video):
        return False
    return error.errno in FATAL
