"""Small videos that tests make for themselves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np


def moving_square(length: int = 12, size: tuple[int, int] = (64, 48), seed: int = 0) -> list[np.ndarray]:
    """Frames [H, W, 3] of a bright square that moves over a dim, textured ground."""
    rng = np.random.default_rng(seed)
    ground = rng.integers(40, 60, (size[1], size[0], 3), dtype=np.uint8)
    frames = []
    for n in range(length):
        frame = ground.copy()
        x = (3 * n + seed) % (size[0] - 10)
        frame[10:20, x : x + 10] = 220
        frames.append(frame)
    return frames


def write_video(path: Path, frames: list[np.ndarray] | None = None, fps: float = 25) -> Path:
    """An AVI of JPEG pictures."""
    frames = moving_square() if frames is None else frames
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, frames[0].shape[1::-1])
    for frame in frames:
        writer.write(np.ascontiguousarray(frame))
    writer.release()
    return path


def write_stream(path: Path, frames: list[np.ndarray]) -> Path:
    """An MPEG-4 stream, whose pictures are told as changes of those before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25, frames[0].shape[1::-1])
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


def damage(path: Path) -> None:
    """Overwrite ten bytes in the middle of the stream of `write_stream`; as many frames come out of it as before."""
    content = bytearray(path.read_bytes())
    stream = content.index(b"mdat")
    start = stream + int.from_bytes(content[stream - 4 : stream], "big") // 2
    content[start : start + 10] = np.random.default_rng(0).integers(0, 256, 10, np.uint8).tobytes()
    path.write_bytes(content)
