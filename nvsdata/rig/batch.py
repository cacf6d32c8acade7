"""Recording of folders of videos that are played on a monitor; `EventFolder` reads the recordings."""

from __future__ import annotations

import shutil
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from nvsdata.batch.estimate import Estimate, evenly_spaced
from nvsdata.batch.folder import Video
from nvsdata.batch.manifest import Manifest, file_facts
from nvsdata.batch.run import FolderReport, FolderRun, catch_failure
from nvsdata.common.errors import line_of
from nvsdata.common.files import claimed
from nvsdata.common.progress import say_above_bar
from nvsdata.common.terminal import is_quiet
from nvsdata.common.threads import during_block
from nvsdata.recording.camera import Camera, CameraError
from nvsdata.recording.capture import RESERVE
from nvsdata.rig.calibration import corners_in
from nvsdata.rig.cameras import Cameras, Rig
from nvsdata.rig.clock_fit import flashes
from nvsdata.rig.contact_sheets import Sheets
from nvsdata.rig.content import Inspector
from nvsdata.rig.playback import BRIGHT, DIM, FADE, SETTLE, STEP, STILL
from nvsdata.rig.status import Status
from nvsdata.rig.sync import TakeRejected
from nvsdata.rig.take import HIDDEN, VideoRecorder, ends_all
from nvsdata.rig.watch import Watch, prune
from nvsdata.video.decoder import length_of

TAKES = 3  # takes (attempts to record a video) after which the video counts as failed
LISTED = 50  # videos whose length is read; the others are assumed to be alike
OVERHEAD = 2_000_000  # µs per take for starting, trimming and checking
USUAL = 2_000_000  # bytes per second of video if there are no recordings yet: 250,000 events/s
SHOWN_EVERY = 1.0  # s after which the progress bar is drawn again
KIND = "nvsdata-recordings"
DONE = ("recorded", "truncated")


@dataclass(frozen=True)
class BatchOptions:
    """Options of a batch.

    Args:
        format: Format of the recordings.
        limit: Number of videos to record, the first ones in order of path (default: all).
        resume: Continue a batch that was interrupted.
        calibration: Folder of a calibration, which has the corners of the screen (default: the corners are those of
            most recordings).
        strict: Reject flagged recordings; see `content.Inspector`.
        accept_quiet: Accept recordings with hardly any events; see `content.Inspector`.
        on_alarm: Command for alarms (default: none).
        live: Show events in a window.
        until_full: Start even if the disk seems too small.
    """

    format: str = "hdf5"
    limit: int | None = None
    resume: bool = False
    calibration: Path | None = None
    strict: bool = False
    accept_quiet: bool = False
    on_alarm: str | None = None
    live: bool = False
    until_full: bool = False


@contextmanager
def manifest_of(out: Path, videos: list[Video], rig: Rig, options: BatchOptions) -> Iterator[Manifest]:
    """Yield the manifest of a folder of recordings for a run with these `videos`; create it if it doesn't exist.

    Raises:
        FileExistsError: The folder has recordings, and `options.resume` is false.
        ValueError: The recordings of the folder were made with other settings.
    """
    out.mkdir(parents=True, exist_ok=True)
    monitor = rig.monitor
    made = {"settings": asdict(rig.settings), "format": options.format, "scaling": monitor.scaling}
    facts = {
        "monitor": {
            "size": monitor.size,
            "region": monitor.region,
            "refresh": monitor.refresh,
            "stated": monitor.stated,
            "synced": monitor.synced,
        },
        "flashes": {"dim": DIM, "bright": BRIGHT, "refreshes": STEP},
    }
    with claimed(out):
        manifest = Manifest(out, KIND, made, [video.name for video in videos], facts)
        if manifest.videos and not options.resume:
            raise FileExistsError(f"{out} contains recordings: --resume continues the batch")
        with manifest:
            try:
                yield manifest
            finally:
                _clear(out)


def record_videos(videos: list[Video], manifest: Manifest, rig: Rig, options: BatchOptions) -> FolderReport:
    """Play and record every video that isn't done; the result of each is written to the manifest at once.

    A take is one recording of a video. If a take fails its checks, the video is recorded again after the others; if the
    camera made its first take fail, at once. After three failed takes the video has failed. The last failed take of up
    to 20 videos is kept, untrimmed, in `.takes` of the manifest's folder. If the camera is disconnected, the batch
    waits for it. If takes of several videos fail one after another, the camera is reopened, then a video that was
    recorded before is recorded again. If that fails, too, the batch pauses and runs the alarm (see `watch`). A video
    that can't be decoded fails, and the batch continues with the others. Contact sheets, with forty recordings per
    page, and `status.json` are written to the manifest's folder.

    Raises:
        CameraError: There is no camera at the start.
        OSError: Nothing can be written, or the disk is too small.
        BatchStopped: Nothing could be recorded for hours.
    """
    left = "--resume continues with the others"
    with (
        FolderRun(manifest, manifest.as_before(videos), DONE, "recording", resume=left) as run,
        ended_status(_status_of(run)) as status,
    ):
        _check_disk(run, rig, until_full=options.until_full)
        _record(run, rig, options, status)
    return run.report


def _record(run: FolderRun, rig: Rig, options: BatchOptions, status: Status) -> None:
    """Play and record the videos as described in `record_videos`, and update the status."""
    lines, out = run.manifest.videos, run.manifest.path.parent
    takes: Counter[str] = Counter()
    known = [line["content"] for line in lines.values() if line["status"] in DONE and "content" in line]
    corners = None if options.calibration is None else corners_in(options.calibration)
    inspector = Inspector(rig.monitor, corners, known, options.strict, options.accept_quiet)
    with (
        Cameras(rig) as cameras,
        Sheets(out, run.videos, run.manifest) as sheets,
        _shown(run, status) as show,
    ):
        recorder = VideoRecorder(out, rig, inspector, options.live, show)

        def probe() -> bool:
            return recorder.probe(cameras.get(), run.videos, lines)

        watch = Watch(status, options.on_alarm, cameras.drop, rig.monitor.wait, probe)
        cameras.watched_by(watch, status)
        waiting = deque(run.waiting)
        given_up: dict[str, Video] = {}  # videos that failed since the last good take
        while waiting:
            video = waiting.popleft()
            takes[video.name] += 1
            camera = cameras.get()
            status.set(video=video.name, state="recording")
            show("playing")
            line = _line(video, camera)
            try:
                with catch_failure(video, line, (OSError,)):
                    line |= file_facts(video)
                    line |= recorder.record(camera, video)
            except (TakeRejected, OSError) as reason:
                if ends_all(reason, video):
                    raise
                prune(out / HIDDEN)
                if isinstance(reason, CameraError):
                    cameras.drop()
                spared = watch.failed(video.name, str(reason))
                takes.subtract(spared)
                for other in [given_up.pop(name) for name in dict.fromkeys(spared) if name in given_up]:
                    # its last take failed for the same reason as those of the other videos
                    run.again(other)
                    status.set(failed=status.failed - 1)
                    waiting.append(other)
                if takes[video.name] < TAKES:
                    first = isinstance(reason, CameraError) and takes[video.name] == 1
                    say_above_bar(f"{video.name}: {reason}; it is recorded again {'at once' if first else 'later'}")
                    (waiting.appendleft if first else waiting.append)(video)
                    continue
                line |= {"status": "failed", "reason": str(reason)}
                given_up[video.name] = video
            if line["status"] in DONE:
                watch.succeeded()
                given_up.clear()
            run.add(line | {"takes": takes[video.name]})
            now = {"flagged": status.flagged + ("review" in line)}
            if "reason" in line:
                status.set(failed=status.failed + 1, **now)
            else:
                status.success(video.name, done=status.done + 1, **now)
            show("drawing contact sheets")
            sheets.add(video)


def estimate_recording(videos: Sequence[Video], lines: Sequence[dict[str, Any]], out: Path, refresh: float) -> Estimate:
    """Return the time and disk space that the recording of videos will need.

    Args:
        videos: Videos to record.
        lines: Lines of the manifest, whose recordings give the bytes per second of video.
        out: Folder of the recordings.
        refresh: Time in µs from one image of the screen to the next.
    """
    known = [length for video in evenly_spaced(videos, LISTED) if (length := length_of(video.path)[1])]
    each = float(np.mean(known)) if known else 0.0
    pattern = 2 * STILL + (flashes().size + 1) * STEP * refresh
    seconds = len(videos) * (each + (2 * pattern + SETTLE + 2 * FADE + OVERHEAD) / 1e6)
    recorded = [(line["recording"], line["duration"] / 1e6) for line in lines if line.get("duration")]
    rate = sum(size for size, _ in recorded) / sum(time for _, time in recorded) if recorded else USUAL
    return Estimate.on_disk(out, len(videos), seconds, round(each * len(videos) * rate), reserve=RESERVE)


def _check_disk(run: FolderRun, rig: Rig, *, until_full: bool) -> None:
    """Print the needed time and disk space; raise OSError if the disk is too small, unless `until_full` is true."""
    lines = list(run.manifest.videos.values())
    expected = estimate_recording(run.waiting, lines, run.manifest.path.parent, rig.monitor.refresh)
    if not is_quiet():
        say_above_bar(str(expected))
    if expected.short and not until_full:
        raise OSError(f"{expected}: free some space, choose another disk, or record until it is full by --until-full")


def _status_of(run: FolderRun) -> Status:
    """Return the status of a batch at the start of a run, including the recordings of earlier runs."""
    flagged = sum("review" in run.manifest.videos[video.name] for video in run.kept)
    return Status(run.manifest.path.parent, len(run.videos), done=len(run.kept), flagged=flagged)


@contextmanager
def ended_status(status: Status) -> Iterator[Status]:
    """Write the status now, and its outcome and reason at the end of the block."""
    status.set()
    try:
        yield status
    except BaseException as error:
        by_user = isinstance(error, KeyboardInterrupt)
        with suppress(OSError):
            status.set(state="interrupted" if by_user else "stopped", reason=None if by_user else line_of(error))
        raise
    status.set(state="done", video=None)


@contextmanager
def _shown(run: FolderRun, status: Status) -> Iterator[Callable[[str], None]]:
    """Show the state of the batch in the progress bar, each second.

    Yield a function that takes a description of the current step. A thread draws the bar, because a slow or stopped
    terminal must not delay frames.
    """
    phase = ""

    def show(step: str) -> None:
        nonlocal phase
        phase = step

    def draw(over: Event) -> None:
        while not over.wait(SHOWN_EVERY):
            # the end of a long name is more distinctive than its beginning
            run.doing(
                f"{status.video[-30:]}: {phase}" if status.state == "recording" and status.video else status.state
            )

    with during_block(draw, "nvsdata-progress", patience=SHOWN_EVERY):
        yield show


def _line(video: Video, camera: Camera) -> dict[str, Any]:
    """Return the fields that a line of the manifest always has."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    note = getattr(camera, "note", None)
    line = {"video": video.name, "status": "recorded", "when": now, "camera": camera.facts.serial}
    return line | ({"note": note} if note else {})


def _clear(out: Path) -> None:
    """Remove the folder of takes if it is empty."""
    takes = out / HIDDEN
    if takes.is_dir() and not any(path.is_file() for path in takes.rglob("*")):
        shutil.rmtree(takes)
