"""The modes of `nvsdata record` for videos on a monitor: `--monitor`, `--calibrate` and `--status`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.batch.estimate import Estimate, evenly_spaced
from nvsdata.batch.folder import Video, videos_in
from nvsdata.common.errors import message_of, shown
from nvsdata.common.files import claimed
from nvsdata.common.terminal import remark, say, tell
from nvsdata.recording.capture import RESERVE, check_format
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.simulated.options import Simulation
from nvsdata.rig.batch import DONE, manifest_of, record_videos, status_before
from nvsdata.rig.calibrate import calibrate
from nvsdata.rig.calibration import FIGURES, calibration_summary, corners_in, write_calibration
from nvsdata.rig.clock_fit import flashes
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.playback import FADE, SETTLE, STEP, STILL
from nvsdata.rig.report import REPORT, write_report
from nvsdata.rig.status import STATUS, status_of
from nvsdata.rig.verification import format_of, verify
from nvsdata.rig.watch import BatchStopped
from nvsdata.video.decoder import length_of

GAVE_UP = 3  # exit code
WINDOW = (640, 480)  # of a monitor that a simulated camera looks at
LISTED = 50  # videos whose length is read; the others are assumed to be alike
OVERHEAD = 2_000_000  # µs per take for starting, trimming and checking
USUAL = 2_000_000  # bytes per second of video if there are no recordings yet: 250,000 events/s


def run_calibration(
    out: Path,
    seconds: float | None,
    serial: str | None,
    settings: CameraSettings,
    simulate: Simulation | None,
    screen: dict[str, Any],
    *,
    overwrite: bool,
) -> int:
    """Calibrate the view of the monitor; measurements, settings and figures go to the folder `out`. Returns 0.

    FileExistsError if there are some already, unless `overwrite` is true.
    """
    backend, look = _watched(simulate)
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        if (out / FIGURES).exists() and not overwrite:
            raise FileExistsError(f"{out / FIGURES} already exists: --overwrite replaces it and the files next to it")
        with (
            Davis.find(serial, backend=backend) as camera,
            Monitor(**screen, window=WINDOW if simulate else None, look=look) as monitor,
        ):
            _warn_about_refresh(monitor, simulate)
            say("aim and focus until the image is sharp, then press Enter (Escape to leave)")
            found = calibrate(camera, monitor, settings, seconds)
            size = (camera.facts.width, camera.facts.height)
        write_calibration(found, replace(settings, region=found.roi), size, out)
    print(calibration_summary(found, size))
    print(f"figures are in {shown(out)}; record with --settings {shown(out / 'settings.json')}")
    return 0


def run_verification(source: Path, out: Path, limit: int | None = None, *, as_json: bool = False) -> int:
    """Compare the recordings of a batch with its manifest, and record nothing; return 0 if all are sound, else 1."""
    found = verify(videos_in(source, out, format_of(out)), out, limit)
    tell("\n".join(map(shown, found.messages())), {"sound": found.sound} | asdict(found), as_json=as_json)
    return 0 if found.well else 1


def run_batch(
    source: Path,
    out: Path,
    serial: str | None,
    settings: CameraSettings,
    simulate: Simulation | None,
    screen: dict[str, Any],
    *,
    format: str,
    limit: int | None,
    resume: bool,
    calibration: Path | None = None,
    strict: bool = False,
    accept_quiet: bool = False,
    on_alarm: str | None = None,
    note: str | None = None,
    live: bool = False,
    until_full: bool = False,
    as_json: bool = False,
) -> int:
    """Play and record a folder of videos.

    Returns 0 if all videos were recorded, 3 if the batch was aborted because recording became impossible, else 1.
    OSError if the disk is too small, unless `until_full`.
    """
    videos = videos_in(source, out, format)[:limit]
    check_format(videos[0].target, settings)
    how: dict[str, Any] = {"corners": calibration and corners_in(calibration)}
    how |= {"strict": strict, "accept_quiet": accept_quiet, "on_alarm": on_alarm, "live": live}
    backend, look = _watched(simulate)
    window = WINDOW if simulate else None
    with (
        Monitor(**screen, window=window, look=look) as monitor,
        manifest_of(out, settings, format, monitor, videos, resume=resume) as manifest,
    ):
        _warn_about_refresh(monitor, simulate)

        def find() -> Davis:
            camera = Davis.find(serial, backend=backend)
            camera.note = note
            return camera

        videos = manifest.as_before(videos)
        left = [video for video in videos if not manifest.has(video, DONE)]
        expected = estimate_recording(left, list(manifest.videos.values()), out, monitor.refresh)
        remark(str(expected))
        if expected.short and not until_full:
            reason = f"{expected}: free some, choose another disk, or record until it is full by --until-full"
            status_before(out, videos, manifest).set(state="stopped", reason=reason)
            raise OSError(reason)
        try:
            result = record_videos(videos, out, manifest, find, monitor, settings, **how)
        except BatchStopped as error:
            say(message_of(error))
            return GAVE_UP
        finally:
            # an error that ended the batch must not be hidden by one of the report
            with suppress(OSError):
                write_report(list(manifest.videos.values()), manifest.head, out)
    for message in result.messages():
        print(message, file=sys.stderr)
    for name, line in manifest.videos.items():
        if doubts := line.get("look"):
            say(shown(f"{name}: needs review: {'; '.join(doubts)}"))
    done = [line for video in videos if (line := manifest.videos.get(video.name, {})).get("status") in DONE]
    text = f"figures, and recordings that need review, are in {shown(out / REPORT)}\n"
    text += f"{result.done:,} recorded, {result.kept:,} already existed, {len(result.failed):,} failed; "
    events = sum(line["events"] for line in done)
    text += f"{len(done):,} of {len(videos):,} videos, with {events:,} events, are in {shown(out)}"
    flagged = {name: line["look"] for name, line in manifest.videos.items() if line.get("look")}
    tell(text, asdict(result) | {"look": flagged, "out": out}, as_json=as_json)
    return 1 if result.failed else 0


def estimate_recording(videos: Sequence[Video], lines: Sequence[dict[str, Any]], out: Path, refresh: float) -> Estimate:
    """Return the time and disk that recording videos will need.

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


def _watched(simulate: Simulation | None) -> tuple[Any, Any]:
    """Return the backend of a simulated camera and the function that shows it the monitor, see `Simulation.watched`."""
    if simulate is None:
        return None, None
    remark("preparing the simulated camera; the first time, this may take a minute")
    return simulate.watched()


def _warn_about_refresh(monitor: Monitor, simulate: Simulation | None) -> None:
    """Print a warning about an unusual refresh of a real screen."""
    if simulate is None and (warning := monitor.refresh_warning()):
        say(warning)


def run_status(out: Path, *, as_json: bool = False) -> int:
    """Print the status of the batch that records to `out`; return 0 if it is running or ended well, else 1."""
    text, well = status_of(out)
    tell(text, json.loads((out / STATUS).read_text("utf-8")) | {"well": well} if as_json else {}, as_json=as_json)
    return 0 if well else 1
