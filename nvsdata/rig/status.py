"""Status of a batch, in a file that other terminals and programs can read."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.files import put, read_own
from nvsdata.common.locks import is_locked

STATUS = "status.json"
MOST_STATUS = 1 << 20  # bytes of the file that are accepted; it has about 600
RECENT = 5  # videos whose last reason is kept
GOING = ("recording", "waiting for the camera", "paused")
ENDED = ("done", "verified", "interrupted", "stopped")


@dataclass
class Status:
    """State of a batch; each change is written to `out/status.json`.

    Args:
        out: Folder of the recordings.
        total: Number of videos of the batch.
        state: One of `GOING`, or one of `ENDED`: "done", "verified" (by `--verify`), "interrupted", "stopped" (by an
            error or a disk that is too small, or after alarms).
        reason: Reason for the end, or the fault; None if there is none.
        video: Name of the video that is played.
        done: Number of recorded videos, in this run and earlier ones.
        failed: Number of videos that failed, in this run and earlier ones.
        flagged: Number of recordings that are flagged for review.
        in_a_row: Number of takes that failed in a row.
        recent: Reasons of the last failures of videos that have no good take yet, by video, newest first.
    """

    out: Path
    total: int
    state: str = "recording"
    reason: str | None = None
    video: str | None = None
    done: int = 0
    failed: int = 0
    flagged: int = 0
    in_a_row: int = 0
    recent: dict[str, str] = field(default_factory=dict)
    _began: float = field(default_factory=time.time)

    def __post_init__(self) -> None:
        self._before = self.done

    def set(self, **changed: Any) -> None:
        """Change the state, and write it."""
        for name, value in changed.items():
            setattr(self, name, value)
        summary = {k: v for k, v in asdict(self).items() if k not in ("out", "_began")}
        now = time.time()
        left, tried = self.total - self.done - self.failed, self.done + self.failed - self._before
        each = (now - self._began) / max(tried, 1)
        summary |= {
            "recent": [f"{name}: {reason}" for name, reason in self.recent.items()],
            "left": left,
            "seconds_left": round(each * left) if tried > 0 and self.state in GOING else None,
            "disk_free": shutil.disk_usage(self.out).free,
            "began": _iso(self._began),
            "updated": _iso(now),
        }
        _write(self.out / STATUS, json.dumps(summary, indent=1).encode())

    def failure(self, name: str, reason: str) -> None:
        """Note a failed take."""
        others = [(other, why) for other, why in self.recent.items() if other != name]
        self.set(in_a_row=self.in_a_row + 1, recent=dict([(name, reason), *others][:RECENT]))

    def success(self, name: str, **changed: Any) -> None:
        """Note a good recording, and remove earlier failures of the video."""
        self.set(recent={other: why for other, why in self.recent.items() if other != name}, **changed)


def _write(path: Path, content: bytes) -> None:
    """Replace the file; on a full disk, overwrite it in place, which needs no additional space."""
    try:
        put(path, content)
    except OSError as error:
        try:
            with path.open("r+b", buffering=0) as file:
                file.write(content)
                file.truncate()
        except OSError:
            raise error from None


def _iso(moment: float) -> str:
    return datetime.fromtimestamp(moment, UTC).isoformat(timespec="seconds")


def status_of(out: Path) -> tuple[str, bool]:
    """Return the status of the batch that records to a folder as text, and True if it is running or ended successfully.

    Raises:
        FileNotFoundError: No batch has recorded there.
        FormatError: The file isn't the status of a batch.
    """
    path = out / STATUS
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file, so no batch has recorded there")
    try:
        status = json.loads(read_own(path, MOST_STATUS))
        lines = [_headline(status), *_counts(status)]
        state, reason = status["state"], status.get("reason")
        good = reason is None and status["done"] == status["total"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FormatError(path, f"isn't the status of a batch: {error!r}") from None
    if state not in ENDED and not is_locked(out):
        lines[0] = f"the process of the batch ended without a status after {status['updated']}; --resume continues"
        return "\n".join(map(shown, lines)), False
    return "\n".join(map(shown, lines)), state in ("recording", "waiting for the camera") or (
        state in ("done", "verified") and good
    )


def _headline(status: dict[str, Any]) -> str:
    """Return the state with its times, and the reason, if there is one."""
    state, began, updated = status["state"], status["began"], status["updated"]
    if state not in ENDED:
        return f"{state}: began {began}, last seen {updated}"
    when = updated if began == updated else f"{updated}, began {began}"
    reason = status.get("reason")
    return f"{state} at {when}" + (f": {reason}" if reason else "")


def _counts(status: dict[str, Any]) -> list[str]:
    counts = f"{status['done']:,} of {status['total']:,} recorded, {status['failed']:,} failed"
    lines = [counts + (f", {status['flagged']:,} to review" if status["flagged"] else "")]
    going = status["state"] not in ENDED
    if status["seconds_left"] is not None and going:
        hours, minutes = divmod(status["seconds_left"] // 60, 60)
        lines.append(f"about {hours} h {minutes:02} min left; {status['disk_free'] / 1e9:,.1f} GB of disk are free")
    lines += [f"playing {status['video']}"] if status["video"] and status["state"] == "recording" else []
    what = "failed" if status["state"] in ("done", "verified") else "last take failed"
    return lines + [f"{what}: {reason}" for reason in status["recent"]]
