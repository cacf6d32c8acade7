"""The modes of `nvsdata record` for videos on a monitor: `--monitor`, `--calibrate` and `--status`."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from nvsdata.batch.folder import videos_in
from nvsdata.common.errors import message_of, shown
from nvsdata.common.files import claimed
from nvsdata.common.terminal import remark, say, tell
from nvsdata.recording.capture import check_format
from nvsdata.recording.session import CameraChoice
from nvsdata.rig.batch import BatchOptions, manifest_of, record_videos
from nvsdata.rig.calibrate import calibrate
from nvsdata.rig.calibration import FIGURES, calibration_summary, write_calibration
from nvsdata.rig.cameras import Rig
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.report import REPORT, write_batch_report
from nvsdata.rig.status import STATUS, status_of
from nvsdata.rig.verification import recorded_format, verify
from nvsdata.rig.watch import BatchStopped

GAVE_UP = 3  # exit code of a batch that was aborted
WINDOW = (640, 480)  # pixels of the monitor's window for a simulated camera


def run_calibration(
    out: Path, seconds: float | None, chosen: CameraChoice, screen: dict[str, Any], *, overwrite: bool
) -> int:
    """Calibrate the view of the monitor; write measurements, settings and figures to the folder `out`. Return 0.

    Raises:
        FileExistsError: The folder has measurements already, and `overwrite` is false.
    """
    backend, show = _watched(chosen)
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        if (out / FIGURES).exists() and not overwrite:
            raise FileExistsError(f"{out / FIGURES} already exists: --overwrite replaces it and the files next to it")
        with (
            chosen.find(backend) as camera,
            Monitor(**screen, window=WINDOW if chosen.simulate else None, on_change=show) as monitor,
        ):
            _warn_about_refresh(monitor, chosen)
            say("aim and focus until the image is sharp, then press Enter (Escape to quit)")
            found = calibrate(camera, monitor, chosen.settings, seconds)
            size = (camera.facts.width, camera.facts.height)
        write_calibration(found, replace(chosen.settings, region=found.roi), size, out)
    print(calibration_summary(found, size))
    print(f"figures are in {shown(out)}; record with --settings {shown(out / 'settings.json')}")
    return 0


def run_verification(source: Path, out: Path, limit: int | None = None, *, as_json: bool = False) -> int:
    """Compare the recordings of a batch with its manifest, and record nothing; return 0 if all are sound, else 1."""
    found = verify(videos_in(source, out, recorded_format(out)), out, limit)
    tell("\n".join(map(shown, found.messages())), {"sound": found.sound} | asdict(found), as_json=as_json)
    return 0 if found.well else 1


def run_batch(
    source: Path, out: Path, chosen: CameraChoice, screen: dict[str, Any], options: BatchOptions, *, as_json: bool
) -> int:
    """Play and record a folder of videos.

    Returns:
        0 if all videos were recorded, 3 if the batch was aborted because recording became impossible, else 1.

    Raises:
        OSError: The disk is too small, and `options.until_full` is false.
    """
    videos = videos_in(source, out, options.format)[: options.limit]
    check_format(videos[0].target, chosen.settings)
    backend, show = _watched(chosen)
    with Monitor(**screen, window=WINDOW if chosen.simulate else None, on_change=show) as monitor:
        _warn_about_refresh(monitor, chosen)
        rig = Rig(lambda: chosen.find(backend), monitor, chosen.settings)
        with manifest_of(out, videos, rig, options) as manifest:
            try:
                result = record_videos(videos, manifest, rig, options)
            except BatchStopped as error:
                say(message_of(error))
                return GAVE_UP
            finally:
                # an error of the report must not hide the error that ended the batch
                with suppress(OSError):
                    write_batch_report(list(manifest.videos.values()), manifest.head, out)
    for message in result.messages():
        print(message, file=sys.stderr)
    flagged = {name: line["review"] for name, line in manifest.videos.items() if line.get("review")}
    for name, doubts in flagged.items():
        say(shown(f"{name}: needs review: {'; '.join(doubts)}"))
    text = f"figures, and recordings that need review, are in {shown(out / REPORT)}\n"
    text += f"{result.done:,} recorded, {result.kept:,} already existed, {len(result.failed):,} failed; "
    events = result.events + result.kept_events
    text += f"{result.done + result.kept:,} of {len(videos):,} videos, with {events:,} events, are in {shown(out)}"
    tell(text, asdict(result) | {"review": flagged, "out": out}, as_json=as_json)
    return 1 if result.failed else 0


def _watched(chosen: CameraChoice) -> tuple[Any, Any]:
    """Return backend and `on_change` (see `Monitor`) of a simulated camera; (None, None) for a real one."""
    if chosen.simulate is None:
        return None, None
    remark("preparing the simulated camera; the first time, this may take a minute")
    return chosen.simulate.watched()


def _warn_about_refresh(monitor: Monitor, chosen: CameraChoice) -> None:
    """Print a warning about an unusual refresh of a real screen."""
    if chosen.simulate is None and (warning := monitor.refresh_warning()):
        say(warning)


def run_status(out: Path, *, as_json: bool = False) -> int:
    """Print the status of the batch that records to `out`; return 0 if it is running or ended successfully, else 1."""
    text, well = status_of(out)
    tell(text, json.loads((out / STATUS).read_text("utf-8")) | {"well": well} if as_json else {}, as_json=as_json)
    return 0 if well else 1
