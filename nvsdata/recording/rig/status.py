"""How a batch is going, in a file that other terminals and programs can read."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.files import put
from nvsdata.common.locks import is_locked

STATUS = "status.json"
RECENT = 5  # reasons that are kept
ENDED = ("done", "interrupted", "stopped")


@dataclass
class Status:
    """The state of a batch; each change of it is written to `out/status.json`.

    - `out`: the folder of recordings
    - `total`: videos of this run
    - `state`: "recording", "waiting for the camera", "paused", "done", "interrupted" or "stopped" (after alarms)
    - `video`: what is being played
    - `done`, `failed`: videos of this run; `look`: how many of them are odd
    - `in_a_row`: takes that failed, one after another
    - `recent`: why the last takes failed, newest first
    """

    out: Path
    total: int
    state: str = "recording"
    video: str | None = None
    done: int = 0
    failed: int = 0
    look: int = 0
    in_a_row: int = 0
    recent: list[str] = field(default_factory=list)
    _began: float = field(default_factory=time.time)

    def set(self, **changed: Any) -> None:
        """Change the state, and write it."""
        for name, value in changed.items():
            setattr(self, name, value)
        told = {k: v for k, v in asdict(self).items() if k not in ("out", "_began")}
        now = time.time()
        each = (now - self._began) / max(self.done + self.failed, 1)
        left = self.total - self.done - self.failed
        told |= {
            "left": left,
            "seconds_left": round(each * left) if self.done + self.failed else None,
            "disk_free": shutil.disk_usage(self.out).free,
            "began": _iso(self._began),
            "updated": _iso(now),
        }
        put(self.out / STATUS, json.dumps(told, indent=1).encode())

    def failure(self, name: str, reason: str) -> None:
        """Note a take that failed."""
        self.set(in_a_row=self.in_a_row + 1, recent=[f"{name}: {reason}", *self.recent][:RECENT])


def _iso(moment: float) -> str:
    return datetime.fromtimestamp(moment, UTC).isoformat(timespec="seconds")


def told(out: Path) -> tuple[str, bool]:
    """How the batch that records to a folder is going, in a few lines, and whether it is going or ended well.

    FileNotFoundError if none has recorded there, FormatError for a file that isn't its status.
    """
    path = out / STATUS
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file, so no batch has recorded there")
    try:
        status = json.loads(path.read_text(encoding="utf-8"))
        state = status["state"]
        counts = f"{status['done']:,} of {status['total']:,} recorded, {status['failed']:,} failed"
        lines = [f"{state} since {status['began']}, last seen {status['updated']}", counts]
        lines[1] += f", {status['look']:,} to look at" if status["look"] else ""
        if status["seconds_left"] is not None and state not in ENDED:
            hours, minutes = divmod(status["seconds_left"] // 60, 60)
            lines.append(f"about {hours} h {minutes:02} min left; {status['disk_free'] / 1e9:,.1f} GB of disk are free")
        lines += [f"playing {status['video']}"] if status["video"] and state == "recording" else []
        lines += [f"failed: {reason}" for reason in status["recent"]]
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(path, f"isn't the status of a batch: {error!r}") from None
    if state not in ENDED and not is_locked(out):
        lines[0] = f"gone: its process ended without a word after {status['updated']}; --resume goes on"
        return "\n".join(map(shown, lines)), False
    return "\n".join(map(shown, lines)), state in ("recording", "waiting for the camera") or (
        state == "done" and not status["failed"]
    )
