"""Measure how accurately recordings are trimmed to their videos, with a simulated camera in front of a monitor.

    SDL_VIDEODRIVER=dummy python recipes/bench/synchronization.py --videos 20 --drift 100 --noise 5 --late 0.05

The camera's clock drifts by --drift ppm, the fraction --late of the frames is shown a refresh later than logged, and
each pixel has --noise noise events per second. The true start of a recording is the time in the camera's clock at which
the video began. Measured starts differ from it by the delay of screen and sensor, which is the same for all, and an
error. Screen recordings that fail their checks and are repeated are counted as takes, but not measured.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsdata.batch.folder import videos_in
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.options import Simulation
from nvsdata.rig import batch, take
from nvsdata.rig.cameras import Rig
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.sync import ScreenRecording

CLOCK_STARTS = 2  # per take: at the start of the stream, and at the reset


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--videos", type=int, default=10, help="number of videos (default 10)")
    parser.add_argument("--seconds", type=float, default=3.0, help="duration of a video in s (default 3)")
    parser.add_argument("--drift", type=float, default=100.0, help="drift of the camera's clock in ppm (default 100)")
    parser.add_argument("--noise", type=float, default=5.0, help="rate of noise events in Hz per pixel (default 5)")
    parser.add_argument(
        "--late", type=float, default=0.05, help="fraction of frames that are shown late (default 0.05)"
    )
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    args = parser.parse_args()
    simulation = Simulation(drift=args.drift, noise=args.noise, late=args.late)
    with tempfile.TemporaryDirectory() as place:
        for n in range(args.videos):
            make_video(Path(place) / f"in/class/{n:03}.avi", round(30 * args.seconds), seed=n)
        row = measure(Path(place), simulation)
    row["overhead_seconds"] = round(row["overhead_seconds"] - args.seconds, 2)
    print("  ".join(f"{key} {value}" for key, value in row.items()))
    if args.out:
        args.out.write_text(json.dumps(row, indent=1))


def make_video(path: Path, frames: int, seed: int) -> None:
    """Write a video of a disk that moves over a moving texture."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (240, 320), dtype=np.uint8), (0, 0), 6)
    texture = cv2.normalize(texture, None, 30, 220, cv2.NORM_MINMAX)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (320, 240))
    for n in range(frames):
        image = cv2.cvtColor(np.roll(texture, 2 * n, 1), cv2.COLOR_GRAY2BGR)
        cv2.circle(image, (4 * n % 320, 120), 30, (0, 0, 255), -1)
        writer.write(image)
    writer.release()


def measure(place: Path, simulation: Simulation) -> dict[str, float]:
    """Play and record all videos of a folder, and compare the fitted clocks with the camera's clock."""
    starts: list[float] = []
    drifts: list[float] = []
    began: list[int] = []

    class ObservedDavis(SimulatedDavis):
        def _begin(self) -> None:
            super()._begin()
            began.append(self._began or 0)

    cut = take.trim

    def trim(one: ScreenRecording, *how: Any) -> dict[str, Any]:
        fields = cut(one, *how)
        line = take.synced(one).line
        true = (one.performance.start - began[-1]) * (1 + simulation.drift * 1e-6)
        starts.append(line.camera(one.performance.start) - true)
        drifts.append(line.drift * 1e6 - simulation.drift)
        return fields

    take.trim = trim
    backend, show = simulation.watched(ObservedDavis)
    videos = videos_in(place / "in", place / "out")
    began_at = time.perf_counter()
    with (
        Monitor(window=(640, 480), on_change=show) as monitor,
    ):
        rig = Rig(lambda: Davis.find(backend=backend), monitor, CameraSettings())
        with batch.manifest_of(place / "out", videos, rig, batch.BatchOptions()) as manifest:
            result = batch.record_videos(videos, manifest, rig, batch.BatchOptions())
    spent = time.perf_counter() - began_at
    if not starts:
        raise ValueError(f"no recording passed its checks: {'; '.join(result.messages())}")
    return {
        "videos": len(videos),
        "takes": len(began) // CLOCK_STARTS,
        "failed": len(result.failed),
        "start_ms": round(float(np.mean(starts)) / 1e3, 3),
        "worst_start_ms": round(float(np.abs(starts).max()) / 1e3, 3),
        "spread_of_starts_us": round(float(np.std(starts)), 1),
        "worst_drift_error_ppm": round(float(np.abs(drifts).max()), 2),
        "overhead_seconds": spent / (len(began) // CLOCK_STARTS),
    }


if __name__ == "__main__":
    main()
