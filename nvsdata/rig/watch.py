"""Handling of takes that fail in a row.

The camera is reopened, then a video that was recorded before is recorded again. If that fails, too, the batch pauses
and runs the user's alarm.
"""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from nvsdata.common.progress import say_above_bar
from nvsdata.recording.camera import host_time
from nvsdata.rig.status import Status

REOPEN = 3  # takes that failed in a row after which the camera is reopened
PAUSE = 6  # takes that failed in a row after which the batch pauses, if they were of several videos
DIFFERENT = 3  # number of different videos in these takes from which the videos aren't assumed to be the cause
PAUSED = 600_000_000  # µs; length of a pause
MOST_PAUSES = 36  # pauses in a row, which are six hours, after which the batch stops
TIMEOUT = 60.0  # s that the command of an alarm may take
KEPT = 20  # failed takes that are kept for review


class BatchStopped(OSError):
    """A batch ended because it could record nothing over many pauses; the message has the reason."""


class Watch:
    """Counter of takes that fail in a row, which reopens the camera, pauses, and runs the alarm.

    Args:
        status: Status of the batch.
        command: Shell command to run at an alarm (None: no command). Its environment has the message as `NVSDATA_ALARM`
            and the folder as `NVSDATA_OUT`.
        reopen: Function that reopens the camera.
        wait: Function that waits until a host time (µs).
        probe: Function that records a video again that was recorded before, and returns True on success (default: it
            returns False).
    """

    def __init__(
        self,
        status: Status,
        command: str | None,
        reopen: Callable[[], None],
        wait: Callable[[float], None],
        probe: Callable[[], bool] = lambda: False,
    ) -> None:
        self._status, self._command, self._reopen, self._wait = status, command, reopen, wait
        self._probe = probe
        self._failed: list[str] = []
        self._pauses = 0

    def succeeded(self) -> None:
        """Note a good take."""
        self._failed, self._pauses = [], 0
        self._status.set(in_a_row=0, state="recording")

    def failed(self, video: str, reason: str) -> list[str]:
        """Note a failed take; return the names of videos whose takes don't count, because camera or screen failed.

        Raises:
            BatchStopped: Nothing was recorded over `MOST_PAUSES` pauses.
        """
        self._failed.append(video)
        self._status.failure(video, reason)
        if len(self._failed) == REOPEN:
            self._reopen()
        if len(self._failed) < PAUSE or len(set(self._failed)) < DIFFERENT:
            return []
        if self._probe():
            # camera and screen work, so the videos are the cause
            self.succeeded()
            return []
        spared, self._failed = self._failed, []
        self._pauses += 1
        failure = f"{PAUSE} takes in a row failed, the last one of {video}: {reason}"
        if self._pauses > MOST_PAUSES:
            self.alarm(f"{failure}; the batch ends")
            raise BatchStopped(f"{failure}; the batch ended after {MOST_PAUSES} pauses: --resume continues it")
        self._status.set(state="paused")
        self.alarm(f"{failure}; the batch continues in {PAUSED / 60e6:.0f} minutes")
        self._reopen()
        self._wait(host_time() + PAUSED)
        self._status.set(state="recording")
        return spared

    def alarm(self, text: str) -> None:
        """Print a message, and run the user's command with it."""
        say_above_bar(text)
        if self._command is None:
            return
        given = os.environ | {"NVSDATA_ALARM": text, "NVSDATA_OUT": str(self._status.out)}
        try:
            code = _run(self._command, given)
        except (OSError, subprocess.TimeoutExpired) as error:
            say_above_bar(f"the command for alarms failed: {error}")
        else:
            if code:
                say_above_bar(f"the command for alarms ended with exit code {code}")


def _run(command: str, environment: dict[str, str]) -> int:
    """Run a shell command without input, and return its exit code; it and its children end after `TIMEOUT`."""
    posix = os.name == "posix"
    # stdout is for the results of the batch
    streams: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    with subprocess.Popen(command, shell=True, env=environment, start_new_session=posix, **streams) as process:
        try:
            return int(process.wait(TIMEOUT))
        except BaseException:
            if posix:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            raise


def prune(takes: Path) -> None:
    """Remove all but the `KEPT` newest failed takes of a folder."""
    files = sorted((path for path in takes.rglob("*") if path.is_file()), key=lambda path: path.stat().st_mtime)
    for path in files[:-KEPT]:
        path.unlink()
