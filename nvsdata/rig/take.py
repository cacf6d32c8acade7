"""A take: recording of one video while it plays, and checks and trimming of the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsdata import formats
from nvsdata.batch.folder import Video, is_fatal
from nvsdata.batch.manifest import sha256
from nvsdata.common.files import append_own, json_line, remove_link, write_all
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.data.pieces import cut_pieces
from nvsdata.data.recording import Recording
from nvsdata.recording.camera import Camera, CameraError
from nvsdata.recording.capture import RecordingReport
from nvsdata.recording.live_view import DisplayError, LiveView
from nvsdata.recording.recorder import Recorder
from nvsdata.rig.cameras import Rig
from nvsdata.rig.clock_fit import ClockFit, NoSync
from nvsdata.rig.content import Inspector, Span
from nvsdata.rig.playback import PlaybackLog, perform
from nvsdata.rig.sync import ScreenRecording, TakeRejected, synced

PLAYED = "playback.jsonl"  # times at which the frames of each take were shown
HIDDEN = ".takes"  # subfolder of the recordings' folder: takes that aren't trimmed yet, or that failed
PIECE = 1_000_000  # µs of a recording that are read at once
BIN = 10_000  # µs per bin of the event rate
FULL = 10e6  # events/s above which the readout counts as full in a bin
MOST_FULL = 0.01  # largest fraction of bins with a full readout
# ms for which a screen may show a wrong frame, and the same as a fraction of a longer video
MOST_WRONG, SHARE_WRONG = 50.0, 0.02
# faults of the stream after which times or events are missing, by the names of `RecordingReport.error_counts`
STREAM = {
    "late_resets": "the camera's clock was reset during the recording",
    "lost_wraps": "parts of the camera's stream are missing",
    "usb_errors": "USB transfers failed, and parts of the camera's stream may be missing",
}
WORST_RESIDUAL = 1_000  # µs; largest median distance of flashes from the fit


@dataclass
class Tally:
    """Number of events and of ON events between two times, and the fraction of bins with a full readout."""

    events: int = 0
    on: int = 0
    full: float = 0.0


@dataclass(frozen=True)
class VideoRecorder:
    """Recorder that plays, records, trims and checks videos one by one.

    Args:
        out: Folder of the recordings.
        rig: Camera and monitor.
        inspector: Check of the recordings.
        live: Show events in a window.
        show: Function that is called with the name of each step.
    """

    out: Path
    rig: Rig
    inspector: Inspector
    live: bool
    show: Callable[[str], None]

    def record(self, camera: Camera, video: Video) -> dict[str, Any]:
        """Play and record a video, and return its fields for the manifest."""
        raw = self.out / HIDDEN / f"{video.name}.h5"
        raw.parent.mkdir(parents=True, exist_ok=True)
        try:
            take = record_screen(camera, self.rig, video.path, raw, live=self.live)
        except CameraError:
            raise
        except BaseException:
            raw.unlink(missing_ok=True)
            raise
        self.show("trimming and checking")
        with append_own(self.out / PLAYED) as file:
            write_all(file.fileno(), json_line({"video": video.name, **_log(take.performance)}).encode())
        try:
            line = trim(take, video, self.inspector)
        except (ValueError, cv2.error, MemoryError) as error:
            # the video was played, so the video isn't the cause
            raise TakeRejected(f"the recording can't be read or checked: {error}") from error
        self.inspector.others.append(line["content"])
        raw.unlink()
        if take.performance.truncated:
            line |= {"status": "truncated", "reason": take.performance.truncated}
        return line

    def probe(self, camera: Camera, videos: list[Video], lines: dict[str, dict[str, Any]]) -> bool:
        """Record the shortest video that has an unflagged recording again; return True on success.

        Return False if that fails, or if there is no such video.
        """
        fine = [video for video in videos if lines.get(video.name, {}).get("status") == "recorded"]
        fine = [video for video in fine if "review" not in lines[video.name] and video.path.exists()]
        if not fine:
            return False
        video = min(fine, key=lambda video: lines[video.name]["duration"])
        target = self.out / HIDDEN / "probe" / video.target.name
        try:
            self.record(camera, video._replace(target=target))
        except (TakeRejected, OSError, ValueError, cv2.error) as error:
            # the video may be missing or damaged by now
            if ends_all(error, video):
                raise
            return False
        finally:
            target.unlink(missing_ok=True)
        return True


def _log(done: PlaybackLog) -> dict[str, Any]:
    """Return the log of a playback for JSON, with times in whole µs from the start of the video."""

    def after(times: list[float]) -> list[int]:
        return [round(time - done.start) for time in times]

    return {
        "refresh": round(done.refresh, 1),
        "late": done.late,
        "skipped": done.skipped,
        "wrong": round(done.wrong, 1),
        "flashes": after(done.flashes),
        "due": after(done.due),
        "shown": after(done.shown),
        "stop": round(done.stop - done.start),
        "bright": [int(bright) for bright in done.bright],
    }


def record_screen(camera: Camera, rig: Rig, video: Path, raw: Path, *, live: bool = False) -> ScreenRecording:
    """Record to `raw` while a video plays; an error of the monitor, the video or the camera ends both.

    If `live` is true, events are shown in a window.
    """
    with LiveView((camera.facts.width, camera.facts.height)) if live else nullcontext() as view:
        return _recorded(camera, rig, video, raw, view)


def _recorded(camera: Camera, rig: Rig, video: Path, raw: Path, view: LiveView | None) -> ScreenRecording:
    # no journal, because an incomplete take is recorded again
    watch: dict[str, Any] = {} if view is None else {"watch": lambda report, events: view.add(events)}
    recorder = Recorder(camera, raw, rig.settings, journaled=False, **watch)

    def check() -> None:
        recorder.check()
        if view is not None:
            view.draw()

    recorder.start()
    try:
        recorder.begun.wait()
        rig.monitor.check = check
        performance = perform(rig.monitor, video, camera.dropped)
    except BaseException:
        with suppress(OSError, ValueError):
            recorder.finish()
        raise
    finally:
        rig.monitor.check = lambda: None
    report = recorder.finish()
    if report.failure is not None:
        raise report.failure
    return ScreenRecording(raw, report, performance)


def trim(take: ScreenRecording, video: Video, inspector: Inspector) -> dict[str, Any]:
    """Trim a take to its video, write it with times from 0 on, and return the fields for the manifest.

    Raises:
        TakeRejected: The take must be repeated. Nothing is written.
    """
    report, done = take.report, take.performance
    _check_stream(report, done)
    try:
        line, by, refused = synced(take)
    except NoSync as error:
        raise TakeRejected(str(error)) from None
    span = round(line.camera(done.start)), round(line.camera(done.stop))
    recording = formats.open(take.raw)
    tally = _tally(recording, *span)
    _check(done, line, tally, span[1] - span[0])
    content = inspector.judged(Span(take, recording, line, *span), video.path, tally.events)
    target = video.target
    target.parent.mkdir(parents=True, exist_ok=True)
    remove_link(target)
    formats.write(cut_pieces(recording, *span, every=PIECE), target, format=video.format)
    return {
        "recording": target.stat().st_size,
        "recording_sha256": sha256(target),
        "duration": span[1] - span[0],
        "events": tally.events,
        "on": tally.on,
        "sensor_size": recording.sensor_size,
        "sync": {"by": by, **asdict(line)} | ({"triggers": refused} if refused else {}),
        "frames": done.frames,
        "late": done.late,
        "skipped": done.skipped,
        "wrong": round(done.wrong, 1),
        "dropped": done.dropped if done.dropped is not None else report.dropped,
        "dropped_in_all": report.dropped,
        "errors": {name: count for name, count in report.error_counts.items() if count},
        "temperature": report.temperature,
    } | content


def ends_all(reason: Exception, video: Video) -> bool:
    """Return True for an error of the disk or the monitor, after which nothing can be recorded."""
    return isinstance(reason, DisplayError) or (isinstance(reason, OSError) and is_fatal(reason, video.path))


def _check_stream(report: RecordingReport, done: PlaybackLog) -> None:
    """Raise `TakeRejected` if data was lost, or if the camera's clock was reset."""
    if report.lost:
        raise TakeRejected(f"{report.lost} bytes came faster than they could be decoded and written")
    # events that were dropped before or after the video aren't missing from it
    dropped = report.dropped if done.dropped is None else done.dropped
    if dropped:
        raise TakeRejected(f"the camera dropped {dropped} events")
    for fault, message in STREAM.items():
        if report.error_counts.get(fault):
            raise TakeRejected(message)


def _check(done: PlaybackLog, line: ClockFit, tally: Tally, duration: int) -> None:
    """Raise `TakeRejected` unless the entire video was shown in time and recorded."""
    if line.residual > WORST_RESIDUAL:
        raise TakeRejected(f"the median distance of the flashes from the fit is {line.residual:.0f} µs")
    if done.wrong > max(MOST_WRONG, SHARE_WRONG * duration / 1e3):
        missed = f"{done.late + done.skipped} of {done.frames} frames were late or left out"
        raise TakeRejected(f"the screen showed a wrong frame for {done.wrong:.0f} ms ({missed}): is the computer busy?")
    if tally.full > MOST_FULL:
        raise TakeRejected(
            f"the readout is full for {tally.full:.0%} of the time: lower the contrast, or raise thresholds"
        )


def _pieces(recording: Recording, start: int, stop: int) -> Iterator[Events]:
    for begin in range(start, stop, PIECE):
        yield recording.read(begin, min(begin + PIECE, stop))


def _tally(recording: Recording, start: int, stop: int) -> Tally:
    tally, full = Tally(), 0
    for piece in _pieces(recording, start, stop):
        tally.events += len(piece)
        tally.on += int(np.count_nonzero(piece.p))
        full += int((np.bincount((piece.t - piece.start) // BIN) > FULL * BIN / MICROSECONDS).sum())
    tally.full = full * BIN / max(stop - start, 1)
    return tally
