"""Run over a folder of videos, which resumes where the last run ended: remaining videos, results, and a report."""

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
    """Results of a run over a folder of videos.

    Args:
        done: Number of recordings that the run made.
        kept: Number of recordings that were there before.
        events: Number of events in the recordings that the run made.
        failed: Reasons of failures, by video.
        damaged: Numbers of decoder errors in videos whose recordings were made, by video.
        without_preview: Reasons why previews couldn't be made, by video.
        kept_events: Number of events in the recordings that were there before.
    """

    done: int = 0
    kept: int = 0
    events: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    damaged: dict[str, int] = field(default_factory=dict)
    without_preview: dict[str, str] = field(default_factory=dict)
    kept_events: int = 0

    def count(self, line: dict[str, Any], good: tuple[str, ...]) -> None:
        """Count a line of the manifest; statuses in `good` mean that its recording was made."""
        self.events += line.get("events", 0)
        self.done += line["status"] in good
        if "reason" in line:
            self.failed[line["video"]] = line["reason"]
        elif "decoder_errors" in line:
            self.damaged[line["video"]] = line["decoder_errors"]

    @property
    def total(self) -> str:
        """Numbers of recordings and events of the run's videos, as text."""
        return f"{self.done + self.kept:,} recordings with {self.events + self.kept_events:,} events"

    def messages(self) -> list[str]:
        """Return a line for each video that failed, is damaged, or has no preview."""
        damaged = "its stream is damaged, frames may be smeared: {:,} decoder errors"
        return [
            *(shown(f"{name}: {reason}") for name, reason in self.failed.items()),
            *(shown(f"{name}: {damaged.format(count)}") for name, count in self.damaged.items()),
            *(shown(f"{name}: no preview: {reason}") for name, reason in self.without_preview.items()),
        ]


class FolderRun:
    """Run over a folder of videos, for a `with` block.

    `kept` has the videos that the manifest lists as done, `waiting` the other videos, and `report` the counted results.
    If the block raises, a line on stderr states how many videos are done.

    Args:
        manifest: Manifest to which a line is added for each video.
        videos: All videos of the folder.
        done: Statuses of lines whose recordings were made.
        what: Activity that the progress bar shows.
        resume: Text that says how to continue a run that ended early.
        check: Whether existing recordings are compared with their sha256.
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
        self.manifest, self.videos = manifest, list(videos)
        self._done, self._resume = done, resume
        self.kept = [
            video
            for video in bar(videos, "checking", shown=check, leave=False)
            if manifest.has(video, done, check=check)
        ]
        there = set(self.kept)
        self.waiting = [video for video in videos if video not in there]
        events = sum(manifest.videos[video.name].get("events", 0) for video in self.kept)
        self.report = FolderReport(kept=len(self.kept), kept_events=events)
        self.bar = bar(None, what, total=len(self.waiting), unit="video")
        self._started, self._count = time.monotonic(), 0
        self._targets = {video.target for video in videos}
        self._files = {video.name: video.target.relative_to(manifest.path.parent).as_posix() for video in videos}

    def add(self, line: dict[str, Any]) -> str:
        """Add the line of a video that is done or failed; return its recording's name relative to the folder."""
        line = {"video": line["video"], "file": self._files[line["video"]]} | line
        self.manifest.add(line)
        old = self.manifest.replaced.pop(line["video"], None)
        if line["status"] in self._done and old is not None and old not in self._targets:
            # the earlier recording had another name or format
            old.unlink(missing_ok=True)
        self.report.count(line, self._done)
        seconds = max(time.monotonic() - self._started, 1e-3)
        self.bar.set_postfix_str(f"{self.report.events / seconds:,.0f} events/s", refresh=False)
        self._count += 1
        self.bar.update(self._count - self.bar.n)
        result = line["reason"] if "reason" in line else f"{line.get('events', 0):,} events"
        log.info("%s: %s, %s", shown(line["video"]), shown(line["status"]), shown(result))
        return str(line["file"])

    def within(self, fraction: float) -> None:
        """Show the fraction (0 to 1) of the current video that is done."""
        self.bar.update(round(self._count + min(fraction, 0.99), 2) - self.bar.n)

    def doing(self, what: str) -> None:
        """Show the current activity and the time."""
        self.bar.set_postfix_str(what, refresh=False)
        self.bar.refresh()

    def again(self, video: Video) -> None:
        """Take back the failure of a video that will be tried again."""
        self.report.failed.pop(video.name, None)
        self._count -= 1
        self.bar.update(-1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.bar.close()
        if kind is not None:
            say(f"{self.report.done + self.report.kept:,} of {len(self.videos):,} videos are done: {self._resume}")


@contextmanager
def catch_failure(video: Video, line: dict[str, Any], fatal_too: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Catch the failure of a video in a block that makes its recording.

    The reason of a failure, and the number of decoder errors, are added to `line`. Errors that would affect the next
    video, too, are raised: errors of the disk, and errors of the types `fatal_too`.
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
