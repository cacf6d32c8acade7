"""Calibration before a batch: aim and focus, find the monitor on the sensor, and measure its flicker."""

from __future__ import annotations

import numpy as np

from nvsdata.data.events import Events, concatenate
from nvsdata.recording.camera import Camera, host_time
from nvsdata.recording.capture import RecordingReport
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.live_view import LiveView
from nvsdata.recording.recorder import Recorder
from nvsdata.rig.calibration import ScreenCalibration, corners_of, lines_of, rectangles, response, spectrum_of
from nvsdata.rig.clock_fit import fit_clock
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.playback import BRIGHT, DIM, STILL, pattern
from nvsdata.video.frames import VideoFrame

BLINK = 250_000  # µs between inversions of the target
WATCHED = 4_000_000  # µs of a still screen whose flicker is measured
MAINS = (100.0, 120.0)  # Hz at which lamps on mains flicker


def calibrate(camera: Camera, monitor: Monitor, settings: CameraSettings, seconds: float | None) -> ScreenCalibration:
    """Show a target, then flashes and a still screen, and measure the screen from the camera's events.

    Events are shown in a window all the time. The target is shown until Enter is pressed, at most for `seconds` (None:
    no limit).

    Raises:
        NoSync: The camera doesn't see the screen.
    """
    pieces: list[Events] = []
    aimed = False
    size = (camera.facts.width, camera.facts.height)
    with LiveView(size) as live:

        def watch(report: RecordingReport, events: Events) -> None:
            live.add(events)
            # events during aiming, which may take an hour, are not kept
            if aimed:
                pieces.append(events)

        recorder = Recorder(camera, None, settings, watch=watch)

        def check() -> None:
            recorder.check()
            live.draw()

        recorder.start()
        try:
            recorder.begun.wait()
            monitor.check = check
            _aim(monitor, seconds)
            aimed = True
            whole = _flashed(monitor, 1)
            corner = _flashed(monitor, 2)
            still = monitor.fill(BRIGHT) + STILL
            monitor.wait(still + WATCHED + STILL)
        finally:
            monitor.check = lambda: None
            recorder.finish()
    events = Events.trusted(concatenate([piece.columns for piece in pieces]), size, 0)
    line = fit_clock(events, np.array(whole[0]), np.array(whole[1]))
    seen = response(events, line, *whole)
    corners = corners_of(seen, response(events, line, *corner))
    moment = round(line.camera(still))
    frequencies, spectrum = spectrum_of(events.window(moment, moment + WATCHED), moment, WATCHED)
    flicker = lines_of(frequencies, spectrum, (1e6 / monitor.refresh, *MAINS))
    return ScreenCalibration(seen, corners, *rectangles(corners, size), frequencies, spectrum, flicker)


def _aim(monitor: Monitor, seconds: float | None) -> None:
    """Show a target whose bright and dark parts alternate, so that all its edges cause events."""
    target = _target(monitor.region[2:])
    until = host_time() + (np.inf if seconds is None else seconds * 1e6)
    due, monitor.confirmed = host_time(), False
    while host_time() < until and not monitor.confirmed:
        monitor.show(VideoFrame(0, target), due)
        target, due = 255 - target, due + BLINK
        monitor.wait(due - 2 * monitor.refresh)


def _target(size: tuple[int, int]) -> np.ndarray:
    """Return the target, a star of 18 rays with a border, uint8 [H, W]."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    dx, dy = x - (width - 1) / 2, y - (height - 1) / 2
    star = (np.sin(18 * np.arctan2(dy, dx)) > 0) & (np.hypot(dx, dy) < 0.48 * height)
    edge = min(width, height) // 40
    frame = (np.minimum(x, width - 1 - x) < edge) | (np.minimum(y, height - 1 - y) < edge)
    return np.where(star | frame, 255, 0).astype(np.uint8)


def _flashed(monitor: Monitor, part: int) -> tuple[list[float], list[bool]]:
    """Flash the upper left part of the region, 1 / `part` of its width and height; return the result of `pattern`."""
    width, height = monitor.region[2:]
    dim = np.full((height, width), DIM, np.uint8)
    bright = dim.copy()
    bright[: height // part, : width // part] = BRIGHT
    return pattern(monitor, lambda lit, due: monitor.show(VideoFrame(0, bright if lit else dim), due))
