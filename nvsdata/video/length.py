"""How long a video is, by what its file says."""

from __future__ import annotations

from pathlib import Path

import cv2

from nvsdata.video.decoder import quiet


def length_of(path: Path) -> tuple[int, float]:
    """Frames and seconds of a video, by its container; 0 of what that doesn't say."""
    with quiet():
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        try:
            frames, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
        finally:
            capture.release()
    count = int(frames) if frames > 0 else 0
    return count, count / rate if rate > 0 else 0.0
