"""Draw letters that move, as videos, emulated recordings and recordings of a simulated camera, for sign_language.py.

    python recipes/emulate_signs.py --out signs

The letters take the place of the hand signs of section 3.5.2, whose recordings weren't released. They have six fonts,
and random thickness, slant, size and gray value. They move on an ellipse in front of a smooth random background.
`videos` has them at 30 frames per second, and `emulated` the same videos, emulated by PIX2NVS. `real` has other
drawings, as a camera sees them: 240 frames per second, emulated by the DVS pixel model with noise and unequal
thresholds. An interrupted run continues.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from emulate_actions import begin, texture
from thesis_scenes import CAMERA, SIDE, shaken

from nvsdata import formats
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import put
from nvsdata.common.progress import bar
from nvsdata.emulation import PIX2NVS
from nvsdata.plots.films import save_mp4
from nvsdata.training import run

LETTERS = "ABCDEFGHIKLMNOPQRSTUVWXY"  # the signs of J and Z are motions
SECONDS, FPS, FINE_FPS = 0.5, 30, 240
FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_PLAIN,
    cv2.FONT_HERSHEY_TRIPLEX | cv2.FONT_ITALIC,
)


def main() -> None:
    args = arguments()
    begin(args.out / "settings.txt", f"{args.train} + {args.test} of each letter")
    for n in bar(range((args.train + args.test) * len(LETTERS)), "draw"):
        name, seen = LETTERS[n % len(LETTERS)], n < args.train * len(LETTERS)
        still = drawn(name, n)
        if seen:
            film(args.out / "videos" / name / f"{n:05d}.mp4", args.out / "emulated" / name / f"{n:05d}.h5", still, n)
        elif not (target := args.out / "real" / name / f"{n:05d}.h5").exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            frames = shaken(still, SECONDS, FINE_FPS, seed=n)
            formats.write(replace(CAMERA, seed=n).emulate(frames, fps=FINE_FPS), target)
    put(args.out / "letters.txt", f"{LETTERS}\n".encode())


def film(video: Path, recording: Path, still: np.ndarray, seed: int) -> None:
    """Write a moving letter as a video and as the recording that PIX2NVS makes of the video."""
    if recording.exists():
        return
    for path in (video, recording):
        path.parent.mkdir(parents=True, exist_ok=True)
    frames = shaken(still, SECONDS, FPS, seed=seed)
    save_mp4((cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) for frame in frames), video, FPS)
    formats.write(PIX2NVS().emulate(str(video)), recording)


def drawn(name: str, seed: int) -> np.ndarray:
    """Draw a letter in a random way, uint8 [SIDE, SIDE]."""
    rng = np.random.default_rng(seed)
    ground = texture(rng, (SIDE, SIDE), rng.uniform(40, 110), 12)
    font, thickness = FONTS[rng.integers(len(FONTS))], int(rng.integers(2, 6))
    scale = cv2.getFontScaleFromHeight(font, int(SIDE * rng.uniform(0.45, 0.65)), thickness)
    width, height = cv2.getTextSize(name, font, scale, thickness)[0]
    shape = np.zeros((SIDE, SIDE), np.uint8)
    cv2.putText(shape, name, ((SIDE - width) // 2, (SIDE + height) // 2), font, scale, 255, thickness, cv2.LINE_AA)
    middle, slant = SIDE / 2, rng.uniform(-0.25, 0.25)
    shape = cv2.warpAffine(shape, np.array([[1, slant, -slant * middle], [0, 1, 0]]), shape.shape[::-1])
    brighter = rng.uniform(60, 130)
    return np.rint(ground + shape / 255 * (ground.mean() + brighter - ground)).clip(0, 255).astype(np.uint8)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder for videos and recordings")
    add("--train", type=at_least_1, default=40, help="videos of each letter (default 40)")
    add("--test", type=at_least_1, default=20, help="recordings of the simulated camera of each letter (default 20)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "run the command again to continue")
