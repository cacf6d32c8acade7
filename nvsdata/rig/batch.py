"""Folders of videos, played on a monitor and recorded to folders of recordings that `EventFolder` reads."""

from __future__ import annotations

import shutil
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from threading import Event, Thread
from typing import Any

import cv2

from nvsdata.batch.folder import Video, is_fatal
from nvsdata.batch.manifest import Manifest, file_facts
from nvsdata.batch.run import FolderReport, FolderRun, catch_failure
from nvsdata.common.errors import line_of
from nvsdata.common.files import append_own, claimed, json_line, write_all
from nvsdata.common.progress import say_above_bar
from nvsdata.recording.camera import Camera, CameraError, host_time
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.live_view import DisplayError
from nvsdata.rig.contact_sheets import Sheets
from nvsdata.rig.content import Inspector
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.playback import BRIGHT, DIM, STEP
from nvsdata.rig.status import Status
from nvsdata.rig.sync import TakeRejected
from nvsdata.rig.take import record_screen, trim
from nvsdata.rig.watch import Watch, prune

TAKES = 3  # takes of a video before it counts as failed
SHOWN_EVERY = 1.0  # s after which the progress bar is drawn again
RETRY = 1_000_000  # µs between attempts to find a disconnected camera
MISSED = 60_000_000  # µs without a camera after which the alarm runs
KIND = "nvsdata-recordings"
DONE = ("recorded", "truncated")
PLAYED = "playback.jsonl"  # times at which the frames of each take were shown
HIDDEN = ".takes"  # in the folder of recordings: takes that aren't trimmed yet, or that failed


@contextmanager
def manifest_of(
    out: Path, settings: CameraSettings, format: str, monitor: Monitor, videos: list[Video], *, resume: bool
) -> Iterator[Manifest]:
    """Yield the manifest of a folder of recordings, which is created if there is none, for a run with these `videos`.

    FileExistsError for a folder with recordings, unless `resume` is true; ValueError for a folder whose
    recordings were made with other settings.
    """
    out.mkdir(parents=True, exist_ok=True)
    made = {"settings": asdict(settings), "format": format, "scaling": monitor.scaling}
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
        if manifest.videos and not resume:
            raise FileExistsError(f"{out} contains recordings: --resume continues the batch")
        with manifest:
            try:
                yield manifest
            finally:
                _clear(out)


def record_videos(
    videos: list[Video],
    out: Path,
    manifest: Manifest,
    find: Callable[[], Camera],
    monitor: Monitor,
    settings: CameraSettings,
    *,
    corners: list[list[float]] | None = None,
    strict: bool = False,
    accept_quiet: bool = False,
    on_alarm: str | None = None,
    live: bool = False,
) -> FolderReport:
    """Play and record every video that isn't done; each gets its line of the manifest as soon as it is done.

    A video whose take fails its checks is recorded again after the others, at once if the camera was the reason. After
    three failed takes the video has failed. The last 20 failed takes are kept in `out/.takes`, untrimmed. If the camera
    is disconnected, the batch waits for it. If takes of several videos fail one after another, the camera is reopened,
    then a video that was recorded before is tried. If that fails, too, the batch pauses and runs the alarm (see
    `watch`). A video that can't be decoded fails, and the batch continues with the others. `out` gets contact sheets,
    forty recordings per page, and `status.json`.

    Raises CameraError if there is no camera at the start, OSError if nothing can be written, `BatchStopped` if nothing
    could be recorded for hours.

    Args:
        videos: Videos to play.
        out: The folder of recordings.
        manifest: Manifest of `out`; see `manifest_of`.
        find: Opens the camera; called again after the camera was disconnected.
        monitor: Monitor that plays the videos.
        settings: Settings of the camera.
        corners: See `content.Inspector`.
        strict: See `content.Inspector`.
        accept_quiet: See `content.Inspector`.
        on_alarm: A command for alarms (default: none).
        live: Show events in a window (default False).
    """
    takes: Counter[str] = Counter()
    known = [line["content"] for line in manifest.videos.values() if line["status"] in DONE and "content" in line]
    inspector = Inspector(monitor, corners, known, strict, accept_quiet)
    with (
        _Cameras(find, monitor, settings) as cameras,
        Sheets(out, videos, manifest) as sheets,
        FolderRun(manifest, videos, DONE, "recording", resume="--resume continues with the others") as run,
        ended_status(status_before(out, videos, manifest)) as status,
        _shown(run, status) as show,
    ):
        how = (monitor, settings, inspector, live, show)
        watch = Watch(
            status, on_alarm, cameras.drop, monitor.wait, lambda: _probed(videos, out, manifest, cameras.get(), *how)
        )
        cameras.watched_by(watch, status)
        waiting = deque(run.waiting)
        given_up: dict[str, Video] = {}  # since the last good take
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
                    line |= _recorded(video, out, camera, *how)
            except (TakeRejected, OSError) as reason:
                if _ends_all(reason, video):
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
                    say_above_bar(f"{video.name}: {reason}; again {'at once' if first else 'later'}")
                    (waiting.appendleft if first else waiting.append)(video)
                    continue
                line |= {"status": "failed", "reason": str(reason)}
                given_up[video.name] = video
            if line["status"] in DONE:
                watch.succeeded()
                given_up.clear()
            run.add(line | {"takes": takes[video.name]})
            now = {"look": status.look + ("look" in line)}
            if "reason" in line:
                status.set(failed=status.failed + 1, **now)
            else:
                status.success(video.name, done=status.done + 1, **now)
            show("drawing contact sheets")
            sheets.add(video)
    return run.report


def status_before(out: Path, videos: list[Video], manifest: Manifest) -> Status:
    """Return the status of a batch at the begin of a run, with its earlier recordings."""
    done = [video for video in videos if manifest.has(video, DONE)]
    look = sum("look" in manifest.videos[video.name] for video in done)
    return Status(out, len(videos), done=len(done), look=look)


@contextmanager
def ended_status(status: Status) -> Iterator[Status]:
    """Write the status now, and at the end of the block its outcome and reason."""
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

    Yields a function that takes a description of the present step. A thread draws, because a slow or stopped terminal
    must not delay frames.
    """
    over, phase = Event(), ""

    def show(step: str) -> None:
        nonlocal phase
        phase = step

    def draw() -> None:
        while not over.wait(SHOWN_EVERY):
            # the end of a long name is more distinctive than its beginning
            run.doing(
                f"{status.video[-30:]}: {phase}" if status.state == "recording" and status.video else status.state
            )

    thread = Thread(target=draw, name="nvsdata-progress", daemon=True)
    thread.start()
    try:
        yield show
    finally:
        over.set()
        thread.join(SHOWN_EVERY)


def _probed(videos: list[Video], out: Path, manifest: Manifest, camera: Camera, *how: Any) -> bool:
    """Record the shortest video with an unflagged recording again; return True on success, False if there is none."""
    lines = manifest.videos
    fine = [video for video in videos if lines.get(video.name, {}).get("status") == "recorded"]
    fine = [video for video in fine if "look" not in lines[video.name] and video.path.exists()]
    if not fine:
        return False
    video = min(fine, key=lambda video: lines[video.name]["duration"])
    target = out / HIDDEN / "probe" / video.target.name
    try:
        _recorded(video._replace(target=target), out, camera, *how)
    except (TakeRejected, OSError, ValueError, cv2.error) as error:
        # the video may be missing or damaged by now
        if _ends_all(error, video):
            raise
        return False
    finally:
        target.unlink(missing_ok=True)
    return True


def _ends_all(reason: Exception, video: Video) -> bool:
    """Return True for an error of the disk or the monitor, after which nothing can be recorded."""
    return isinstance(reason, DisplayError) or (isinstance(reason, OSError) and is_fatal(reason, video.path))


def _line(video: Video, camera: Camera) -> dict[str, Any]:
    """Return the fields that each line of the manifest has."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    note = getattr(camera, "note", None)
    line = {"video": video.name, "status": "recorded", "when": now, "camera": camera.facts.serial}
    return line | ({"note": note} if note else {})


def _recorded(
    video: Video,
    out: Path,
    camera: Camera,
    monitor: Monitor,
    settings: CameraSettings,
    inspector: Inspector,
    live: bool,
    show: Callable[[str], None],
) -> dict[str, Any]:
    """Play and record a video, and return its fields for the manifest; `show` is called with each step."""
    raw = out / HIDDEN / f"{video.name}.h5"
    raw.parent.mkdir(parents=True, exist_ok=True)
    try:
        take = record_screen(camera, monitor, video.path, raw, settings, live=live)
    except CameraError:
        raise
    except BaseException:
        raw.unlink(missing_ok=True)
        raise
    show("trimming and checking")
    with append_own(out / PLAYED) as file:
        write_all(file.fileno(), json_line({"video": video.name, **take.performance.log()}).encode())
    try:
        line = trim(take, video, inspector)
    except (ValueError, cv2.error, MemoryError) as error:
        # the video was played, so it isn't the cause
        raise TakeRejected(f"the recording can't be read or checked: {error}") from error
    inspector.others.append(line["content"])
    raw.unlink()
    if take.performance.truncated:
        line |= {"status": "truncated", "reason": take.performance.truncated}
    return line


class _Cameras:
    """Holder of the camera, which is found again after it was disconnected."""

    def __init__(self, find: Callable[[], Camera], monitor: Monitor, settings: CameraSettings) -> None:
        self.monitor, self.settings, self._find = monitor, settings, find
        self._camera: Camera | None = None
        self._had_one = False
        self._watched: tuple[Watch, Status] | None = None

    def watched_by(self, watch: Watch, status: Status) -> None:
        """Set the objects that are notified if the camera is disconnected."""
        self._watched = watch, status

    def get(self) -> Camera:
        """Return the camera; wait for it if it was connected before. ValueError for settings that it doesn't have."""
        reason, since = "", host_time()
        while self._camera is None:
            try:
                self._camera = self._find()
                self._camera.configure(self.settings)
                self._had_one = True
            except CameraError as error:
                self.drop()
                if not self._had_one:
                    raise
                if str(error) != reason:
                    reason = str(error)
                    say_above_bar(f"{reason}: waiting for it")
                if self._watched is not None:
                    watch, status = self._watched
                    status.set(state="waiting for the camera")
                    if host_time() - since > MISSED:
                        watch.alarm(f"the camera has been gone for {MISSED / 60e6:.0f} minutes: {reason}")
                        since = float("inf")
                self.monitor.wait(host_time() + RETRY)
        return self._camera

    def drop(self) -> None:
        """Close the camera because of a fault."""
        if self._camera is not None:
            with suppress(OSError):
                self._camera.close()
            self._camera = None

    def __enter__(self) -> _Cameras:
        return self

    def __exit__(self, *_: object) -> None:
        self.drop()


def _clear(out: Path) -> None:
    """Remove the folder of takes if it is empty."""
    takes = out / HIDDEN
    if takes.is_dir() and not any(path.is_file() for path in takes.rglob("*")):
        shutil.rmtree(takes)
