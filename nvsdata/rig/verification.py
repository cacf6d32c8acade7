"""Verification of the recordings in a folder against its manifest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsdata import formats
from nvsdata.batch.folder import Video
from nvsdata.batch.manifest import NAME, as_before, sha256
from nvsdata.common.files import Journal
from nvsdata.common.locks import locked
from nvsdata.common.progress import bar
from nvsdata.rig.batch import DONE, KIND
from nvsdata.rig.report import REPORT, write_batch_report
from nvsdata.rig.status import RECENT, STATUS, Status
from nvsdata.rig.take import PLAYED


@dataclass(frozen=True)
class Verification:
    """Result of a verification of a folder of recordings.

    Args:
        videos: Number of videos that were verified.
        faults: Faults of videos without a sound recording, by name.
        others: Descriptions of other files in the folder, by path relative to the folder.
    """

    videos: int
    faults: dict[str, str]
    others: dict[str, str]

    @property
    def sound(self) -> int:
        """Number of videos that have a sound recording."""
        return self.videos - len(self.faults)

    @property
    def foreign(self) -> list[str]:
        """Other files that datasets would read as recordings."""
        return [name for name in self.others if Path(name).suffix.lower() in formats.suffixes()]

    @property
    def well(self) -> bool:
        """True if all recordings are sound, and datasets would read no other files."""
        return not self.faults and not self.foreign

    def messages(self) -> list[str]:
        """Return a line for each fault and each other file, then a summary."""
        lines = [f"{name}: {what}" for name, what in (self.faults | self.others).items()]
        text = f"{self.sound:,} of {self.videos:,} recordings are sound"
        if self.foreign:
            text += f", but {self.what_is_foreign}"
        elif self.others:
            text += f"; other files, which datasets don't read: {len(self.others):,}"
        return [*lines, text]

    @property
    def what_is_foreign(self) -> str:
        """Message about other files that datasets would read."""
        return f"datasets would read other files in the folder as recordings: {len(self.foreign):,}; move them away"


def recorded_format(out: Path) -> str:
    """Return the format of the recordings in a folder, from its manifest.

    Raises:
        FileNotFoundError: The folder has no manifest.
        ValueError: The manifest isn't one of recordings.
    """
    path = out / NAME
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file, so nothing was recorded there")
    head = Journal(path, {}).head
    if KIND not in head:
        raise ValueError(f"{path} is not a manifest of {KIND}")
    return str(head["format"])


def verify(videos: list[Video], out: Path, limit: int | None = None) -> Verification:
    """Compare the recordings of the first `limit` videos in `out` with its manifest, and with the videos.

    Faults are noted in the manifest, so that the next run records these videos again, and in `status.json` and
    `report.html`.

    Raises:
        FileNotFoundError: The folder has no manifest.
    """
    recorded_format(out)
    with locked(out), Journal(out / NAME, {}) as journal:
        lines = {line["video"]: line for line in journal.lines}
        videos = as_before(videos, journal.lines, out)
        faults = {}
        for video in bar(videos[:limit], "verifying", unit="video"):
            line = lines.get(video.name)
            fault = _fault(video, line)
            if fault is not None:
                faults[video.name] = fault
                if line is not None and line["status"] in DONE:
                    lines[video.name] = line | {"status": "failed", "reason": fault}
                    journal.add(lines[video.name])
        found = Verification(len(videos[:limit]), faults, _others(videos, lines, out))
        _set_status(found, lines, out)
        write_batch_report(list(lines.values()), journal.head, out)
    return found


def _set_status(found: Verification, lines: dict[str, dict[str, Any]], out: Path) -> None:
    missing = [name for name in found.faults if name not in lines]
    flagged = sum("review" in line for line in lines.values() if line["status"] in DONE)
    status = Status(out, found.videos, done=found.sound, failed=len(found.faults) - len(missing), flagged=flagged)
    reason = found.what_is_foreign if found.foreign else None
    status.set(state="verified", reason=reason, recent=dict(list(found.faults.items())[:RECENT]))


def _others(videos: list[Video], lines: dict[str, dict[str, Any]], out: Path) -> dict[str, str]:
    """Return descriptions, by path, of files that are neither recordings of these videos nor output of a batch."""
    ours = {video.target for video in videos}
    gone = {line["file"]: name for name, line in lines.items() if "file" in line}
    found = {}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out)
        hidden = any(part.startswith(".") for part in name.parts)
        written = path.name in (NAME, PLAYED, STATUS, REPORT) or path.match("contact-sheet-*.png")
        if path.is_file() and path not in ours and not hidden and not (written and len(name.parts) == 1):
            video = gone.get(name.as_posix())
            what = "isn't a recording of any of the videos"
            found[name.as_posix()] = f"is a recording of {video}, and that video is gone" if video else what
    return found


def _fault(video: Video, line: dict[str, Any] | None) -> str | None:
    """Return the difference of a recording from its line of the manifest, or None."""
    if line is None:
        return "isn't recorded"
    if line["status"] not in DONE:
        # an earlier verification has noted the fault of a recording that was good before
        return str(line["reason"]) if "recording" in line else f"isn't recorded: {line['reason']}"
    if video.path.stat().st_size != line["bytes"] or sha256(video.path) != line["sha256"]:
        return f"{video.path}: is no longer the video that was recorded"
    if not video.target.exists():
        return f"{video.target}: is missing"
    try:
        events = formats.read(video.target)
    except (OSError, ValueError) as error:
        return str(error)
    if len(events) != line["events"]:
        return f"{video.target}: contains {len(events)} events, not the {line['events']} that were recorded"
    if len(events) and not (events.t[0] >= 0 and events.t[-1] < line["duration"]):
        return f"{video.target}: has times outside the video's {line['duration']} µs"
    if "recording_sha256" in line and sha256(video.target) != line["recording_sha256"]:
        return f"{video.target}: was changed since it was recorded"
    return None
