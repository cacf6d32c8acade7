"""How accurately recordings are cut to their videos, with a simulated camera in front of a monitor.

    SDL_VIDEODRIVER=dummy python recipes/bench/playing.py --videos 20 --drift 100 --noise 5 --late 0.05

The camera's clock drifts by --drift ppm, the share --late of the pictures comes a refresh later than logged, and each
pixel fires by itself --noise times per second. The true start of a recording is the camera's own time when the video
began. The difference from it is the delay of screen and sensor, the same for all, plus an error. Takes that fail their
checks and are repeated count only as takes.
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

TIMES_BEGIN = 2  # of a camera's clock per take: when the stream starts, and at the reset


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--videos", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=3.0, help="length of a video (default 3)")
    parser.add_argument("--drift", type=float, default=100.0, help="of the camera's clock in ppm (default 100)")
    parser.add_argument("--noise", type=float, default=5.0, help="Hz per pixel (default 5)")
    parser.add_argument("--late", type=float, default=0.05, help="share of pictures that come late (default 0.05)")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    args = parser.parse_args()
    simulation = Simulation(drift=args.drift, noise=args.noise, late=args.late)
    with tempfile.TemporaryDirectory() as place:
        for n in range(args.videos):
            make_video(Path(place) / f"in/class/{n:03}.avi", round(30 * args.seconds), seed=n)
        row = measured(Path(place), simulation)
    row["seconds_beside_the_video"] = round(row["seconds_beside_the_video"] - args.seconds, 2)
    print("  ".join(f"{key} {value}" for key, value in row.items()))
    if args.out:
        args.out.write_text(json.dumps(row, indent=1))


def make_video(path: Path, frames: int, seed: int) -> None:
    """Write a video of a moving disc over moving blots."""
    rng = np.random.default_rng(seed)
    blots = cv2.GaussianBlur(rng.integers(0, 255, (240, 320), dtype=np.uint8), (0, 0), 6)
    blots = cv2.normalize(blots, None, 30, 220, cv2.NORM_MINMAX)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (320, 240))
    for n in range(frames):
        picture = cv2.cvtColor(np.roll(blots, 2 * n, 1), cv2.COLOR_GRAY2BGR)
        cv2.circle(picture, (4 * n % 320, 120), 30, (0, 0, 255), -1)
        writer.write(picture)
    writer.release()


def measured(place: Path, simulation: Simulation) -> dict[str, float]:
    """Play and record all videos of a folder, and compare the fits with the camera's clock."""
    starts: list[float] = []
    drifts: list[float] = []
    began: list[int] = []

    class Known(SimulatedDavis):
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
    backend, look = simulation.watched(Known)
    videos = videos_in(place / "in", place / "out")
    began_at = time.perf_counter()
    with (
        Monitor(window=(640, 480), look=look) as monitor,
    ):
        rig = Rig(lambda: Davis.find(backend=backend), monitor, CameraSettings())
        with batch.manifest_of(place / "out", videos, rig, batch.BatchOptions()) as manifest:
            result = batch.record_videos(videos, manifest, rig, batch.BatchOptions())
    spent = time.perf_counter() - began_at
    return {
        "videos": len(videos),
        "takes": len(began) // TIMES_BEGIN,
        "failed": len(result.failed),
        "start_ms": round(float(np.mean(starts)) / 1e3, 3),
        "worst_start_ms": round(float(np.abs(starts).max()) / 1e3, 3),
        "spread_of_starts_us": round(float(np.std(starts)), 1),
        "worst_drift_error_ppm": round(float(np.abs(drifts).max()), 2),
        "seconds_beside_the_video": spent / (len(began) // TIMES_BEGIN),
    }


if __name__ == "__main__":
    main()
