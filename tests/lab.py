"""What the tests of playing and recording share: small videos, and patterns that are over sooner."""

import cv2
import numpy as np

from nvsdata.rig import clock_fit, playback, take


def make_video(path, frames=12, fps=30, size=(80, 60), seed=0):
    """A disc that moves over blots."""
    rng = np.random.default_rng(seed)
    blots = cv2.GaussianBlur(rng.integers(0, 255, size[::-1], dtype=np.uint8), (0, 0), 3)
    blots = cv2.normalize(blots, None, 40, 200, cv2.NORM_MINMAX)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, size)
    for n in range(frames):
        picture = cv2.cvtColor(blots, cv2.COLOR_GRAY2BGR)
        cv2.circle(picture, (10 + 4 * n, 30), 8, (0, 0, 255), -1)
        writer.write(picture)
    writer.release()
    return path


def hurry():
    """Shorter patterns and waits; and pictures may be late, on a machine that does other things besides."""
    playback.STEP, playback.STILL, playback.SETTLE, playback.FADE = 2, 120_000, 400_000, 150_000
    playback.flashes = lambda: clock_fit.flashes(17)
    take.MOST_WRONG = 1e6
