"""A run over a folder of videos: which are left to do, what became of each, and its report."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Self

import cv2

from nvsdata.batch.folder import Video, is_fatal
from nvsdata.batch.manifest import Manifest
from nvsdata.common.errors import shown
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.video.decoder_errors import DecoderErrors

log = logging.getLogger(__name__)


@dataclass
class FolderReport:
    """What a run did with a folder of videos.

    - `done`: recordings that it made
    - `kept`: recordings that were there already
    - `events`: in the recordings that it made
    - `failed`: why videos failed, by their names
    - `damaged`: errors that FFmpeg found in videos whose recordings were made all the same, by their names
    - `without_preview`: why films that were asked for can't be made, by the videos' names
    - `kept_events`: in the recordings that were there already
    """

    done: int = 0
    kept: int = 0
    events: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    damaged: dict[str, int] = field(default_factory=dict)
    without_preview: dict[str, str] = field(default_factory=dict)
    kept_events: int = 0

    def count(self, line: dict[str, Any], good: tuple[str, ...]) -> None:
        """Count a line of the manifest, whose recording was made if its status is one of the `good`."""
        self.events += line.get("events", 0)
        self.done += line["status"] in good
        if "reason" in line:
            self.failed[line["video"]] = line["reason"]
        elif "decoder_errors" in line:
            self.damaged[line["video"]] = line["decoder_errors"]

    @property
    def total(self) -> str:
        """All recordings of the run's videos, in words."""
        return f"{self.done + self.kept:,} recordings with {self.events + self.kept_events:,} events"

    def told(self) -> list[str]:
        """A line for each video that failed, is damaged, or has no preview."""
        damaged = "its stream is damaged, pictures may be smeared: {:,} errors of the decoder"
        return [
            *(shown(f"{name}: {reason}") for name, reason in self.failed.items()),
            *(shown(f"{name}: {damaged.format(count)}") for name, count in self.damaged.items()),
            *(shown(f"{name}: no preview: {reason}") for name, reason in self.without_preview.items()),
        ]


class FolderRun:
    """A run over a folder of videos: which are left to do, and what became of each; use it in a `with` block.

    - `manifest`: gets a line for each video that is done
    - `videos`: all of the folder
    - `done`: statuses of lines whose recordings were made
    - `what`: is being done, for the progress bar
    - `resume`: what the user does after a run that ended early (default: runs the same command)
    - `check`: whether the recordings that are there are compared with their sha256 (default False)

    `waiting` are the videos that the manifest doesn't call done, `report` counts. If the block raises, a line on
    stderr says how many videos are done.
    """

    def __init__(
        self,
        manifest: Manifest,
        videos: Sequence[Video],
        done: tuple[str, ...],
        what: str,
        *,
        resume: str = "the same command resumes",
        check: bool = False,
    ) -> None:
        self._manifest, self._done, self._resume, self._total = manifest, done, resume, len(videos)
        looked_at = bar(videos, "checking", shown=check, leave=False)
        kept = [video for video in looked_at if manifest.has(video, done, check=check)]
        there = set(kept)
        self.waiting = [video for video in videos if video not in there]
        events = sum(manifest.videos[video.name].get("events", 0) for video in kept)
        self.report = FolderReport(kept=len(kept), kept_events=events)
        self.bar = bar(None, what, total=len(self.waiting), unit="video")
        self._started, self._count = time.monotonic(), 0
        self._targets = {video.target for video in videos}
        self._files = {video.name: video.target.relative_to(manifest.path.parent).as_posix() for video in videos}

    def add(self, line: dict[str, Any]) -> str:
        """Keep the line of a video that is done, or that failed; returns its recording's name below the folder."""
        line = {"video": line["video"], "file": self._files[line["video"]]} | line
        self._manifest.add(line)
        old = self._manifest.replaced.pop(line["video"], None)
        if line["status"] in self._done and old is not None and old not in self._targets:
            # it had another name, or was of another format
            old.unlink(missing_ok=True)
        self.report.count(line, self._done)
        seconds = max(time.monotonic() - self._started, 1e-3)
        self.bar.set_postfix_str(f"{self.report.events / seconds:,.0f} events/s", refresh=False)
        self._count += 1
        self.bar.update(self._count - self.bar.n)
        told = f"{line.get('events', 0):,} events" if "reason" not in line else line["reason"]
        log.info("%s: %s, %s", shown(line["video"]), shown(line["status"]), shown(told))
        return str(line["file"])

    def within(self, share: float) -> None:
        """So much of the present video is done, from 0 to 1."""
        self.bar.update(round(self._count + min(share, 0.99), 2) - self.bar.n)

    def doing(self, what: str) -> None:
        """Show what is being done, and the time."""
        self.bar.set_postfix_str(what, refresh=False)
        self.bar.refresh()

    def again(self, video: Video) -> None:
        """A video that failed isn't done yet after all."""
        self.report.failed.pop(video.name, None)
        self._count -= 1
        self.bar.update(-1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.bar.close()
        if kind is not None:
            say(f"{self.report.done + self.report.kept:,} of {self._total:,} videos are done: {self._resume}")


@contextmanager
def catch_failure(video: Video, line: dict[str, Any], fatal_too: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """While the block makes a video's recording, from reading its file on: put into `line` why it failed if it did, and
    how many errors the decoder found in it.

    Errors that the next video would have, too, are raised: those of the disk, and `fatal_too` (default: none more).
    """
    with DecoderErrors() as errors:
        try:
            yield
        except fatal_too:
            raise
        except (ValueError, OSError, cv2.error, MemoryError) as error:
            if isinstance(error, OSError) and is_fatal(error, video.path):
                raise
            line |= {"status": "failed", "reason": str(error)}
    if errors.found:
        line |= {"decoder_errors": errors.found}
