"""Scenes of the figures in thesis_figure.py: frames and events of one scene, drawn letters, and drawn gestures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from string import ascii_uppercase

import cv2
import numpy as np
from pairs import read_arrays

import nvsdata
from nvsdata import Events
from nvsdata.batch.folder import VIDEOS
from nvsdata.emulation import DVS
from nvsdata.emulation.example import FPS, example_frames
from nvsdata.video.frames import frames_of

LETTERS = ascii_uppercase
STATIC = tuple(letter for letter in LETTERS if letter not in "JZ")  # J and Z are signed by a motion
MOST_FRAMES = 60  # frames that are read of a video or a recording
CAMERA = DVS(noise_rate=1.0, mismatch=0.05)  # simulates the recording where there is none
SIMULATED = "simulated camera"
SLOWER = 10  # the example has 250 frames per second for its events, and every tenth is that of a frame camera
SIDE = 64  # pixels of a drawn letter's sensor


@dataclass(frozen=True)
class Scene:
    """Frames and events of one scene.

    Args:
        frames: Gray [H, W] or RGB [H, W, 3], uint8.
        times: Times of the frames in µs, in the clock of the events.
        events: Events, recorded or simulated.
        about: Words for a caption.
        camera: "recorded", or "simulated camera".
    """

    frames: list[np.ndarray]
    times: list[int]
    events: Events
    about: str
    camera: str = "recorded"


def scene_of(root: Path | None) -> Scene:
    """Return a scene: the example's for None, else that of a recording with frames, a file of arrays, or a video.

    Raises:
        FormatError: A file of arrays (`.npz`) without `frames`, `frame_times`, `t`, `x`, `y` and `p`.
        ValueError: The recording has no frames.
    """
    if root is None:
        every = list(example_frames())
        times = [round(n * 1e6 / FPS) for n in range(len(every))]
        return Scene(every[::SLOWER], times[::SLOWER], nvsdata.example(), "the example scene", SIMULATED)
    if root.suffix == ".npz":
        return _of_arrays(root)
    if root.suffix.lower() in VIDEOS:
        frames, times = _read(root)
        return Scene(frames, times, CAMERA.emulate(frames, times=times), root.name, SIMULATED)
    recording = nvsdata.open(root)
    return Scene(*_read(recording), recording.read(), root.name)


def events_of(root: Path) -> Events:
    """Return the events of a recording, or of a file of arrays (see `scene_of`)."""
    return read_arrays(root)[2] if root.suffix == ".npz" else nvsdata.read(root)


def _read(video: object) -> tuple[list[np.ndarray], list[int]]:
    frames = list(islice(frames_of(video), MOST_FRAMES))  # type: ignore[arg-type]
    colors = [one.pixels if one.pixels.ndim == 2 or one.red_first else one.pixels[..., ::-1] for one in frames]
    return colors, [one.time for one in frames]


def _of_arrays(path: Path) -> Scene:
    frames, times, events = read_arrays(path)
    return Scene(list(frames), times.tolist(), events, path.stem)


def letter(name: str, side: int = SIDE) -> np.ndarray:
    """Draw a letter, white on dark gray, uint8 [side, side]."""
    scale = side / 40
    width, height = cv2.getTextSize(name, cv2.FONT_HERSHEY_DUPLEX, scale, 1)[0]
    at = round((side - width) / 2), round((side + height) / 2)
    image = np.zeros((side, side), np.uint8)
    cv2.putText(image, name, at, cv2.FONT_HERSHEY_DUPLEX, scale, 170, max(1, side // 20), cv2.LINE_AA)
    # the size that OpenCV states doesn't center a letter
    y, x = (round((side - 1 - where.min() - where.max()) / 2) for where in np.nonzero(image))
    return np.roll(image, (y, x), (0, 1)) + np.uint8(40)


def shaken(still: np.ndarray, seconds: float = 0.3, fps: float = 240.0, seed: int = 0) -> list[np.ndarray]:
    """Move an image on an ellipse of random phase, size, scale and turn, as a hand that isn't still."""
    rng = np.random.default_rng(seed)
    phase, turn, scale = rng.uniform(0, 2 * np.pi), rng.uniform(-12, 12), rng.uniform(0.85, 1.1)
    size, center = rng.uniform(2, 4, 2) * len(still) / SIDE, (len(still) - 1) / 2
    way = cv2.getRotationMatrix2D((center, center), turn, scale)
    frames = []
    for share in np.linspace(0, 1, round(seconds * fps) + 1):
        angle = phase + 2 * np.pi * share
        moved = way + np.array([[0, 0, size[0] * np.cos(angle)], [0, 0, size[1] * np.sin(angle)]])
        frames.append(cv2.warpAffine(still, moved, still.shape[::-1], borderMode=cv2.BORDER_REPLICATE))
    return frames


def letter_events(name: str, seed: int = 0) -> Events:
    """Return events of a drawn letter that moves, by the simulated camera."""
    return DVS(noise_rate=1.0, mismatch=0.05, seed=seed).emulate(shaken(letter(name), seed=seed), fps=240)


# names, and (x, y) of each hand in fractions of the sensor at the time from 0 to 1
GESTURES = {
    "hand clap": lambda s: [
        (0.5 - 0.25 * abs(np.cos(2 * np.pi * s)), 0.5),
        (0.5 + 0.25 * abs(np.cos(2 * np.pi * s)), 0.5),
    ],
    "right hand clockwise": lambda s: [(0.35 + 0.2 * np.cos(4 * np.pi * s), 0.5 + 0.2 * np.sin(4 * np.pi * s))],
    "air drums": lambda s: [(0.35, 0.5 + 0.2 * np.sin(4 * np.pi * s)), (0.65, 0.5 - 0.2 * np.sin(4 * np.pi * s))],
    "forearm roll": lambda s: [
        (0.5 + 0.1 * k, 0.5 + 0.15 * k * np.sin(6 * np.pi * s)) for k in (-np.cos(6 * np.pi * s), np.cos(6 * np.pi * s))
    ],
}


def gesture_events(name: str, size: tuple[int, int], *, cluttered: bool) -> Events:
    """Return 0.5 s of events of hands (discs) on a still ground, or on a textured ground that moves."""
    return CAMERA.emulate(_gesture_frames(name, size, cluttered), fps=240)


def _gesture_frames(name: str, size: tuple[int, int], cluttered: bool) -> Iterator[np.ndarray]:
    width, height = size
    texture = np.random.default_rng(0).integers(40, 200, (height // 6, width // 6), dtype=np.uint8)
    texture = cv2.resize(texture, (width + 40, height), interpolation=cv2.INTER_CUBIC)
    for share in np.linspace(0, 1, 121):
        shift = round(30 * share)
        frame = texture[:, shift : shift + width].copy() if cluttered else np.full((height, width), 60, np.uint8)
        for x, y in GESTURES[name](share):
            cv2.circle(frame, (round(16 * x * width), round(16 * y * height)), height, 220, -1, cv2.LINE_AA, 4)
        yield frame


def pairs_of(labels: Sequence[int] | np.ndarray, most: int = 20_000, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return indices [P, 2] of pairs, half of one label, and whether each pair has one label."""
    labels, rng = np.asarray(labels), np.random.default_rng(seed)
    a, b = np.triu_indices(len(labels), 1)
    same = labels[a] == labels[b]
    count = min(same.sum(), (~same).sum(), most // 2)
    chosen = np.concatenate([rng.choice(np.flatnonzero(kind), count, replace=False) for kind in (same, ~same)])
    return np.stack((a, b), 1)[chosen], same[chosen]
