"""Emulate recordings of moving shapes whose class is their motion, as a folder for `--dataset folder`.

    python recipes/emulate_actions.py --out actions
    python recipes/train_actions.py --dataset folder --root actions --no-flip --out runs/actions ...

A video of a second shows two to four textured polygons in front of a textured background. They move in one of eight
ways: to the left, right, up or down, clockwise or counterclockwise around the middle of the sensor, or they grow or
shrink. One more polygon moves in one of these ways at random, and the camera shakes. The classes are pairs: a video of
one is a video of the other, played backwards. Shapes, textures, positions and speeds have the same distributions in all
classes. So the numbers of events per pixel can distinguish the pairs, but not the two classes of a pair: a classifier
that sees nothing else has an expected accuracy of at most 0.5. Backwards, ON and OFF are exchanged. Because dark shapes
have more events than bright ones, polarities contain some information on the class even without the order of events.

The videos are emulated by the DVS pixel model with noise and unequal thresholds, as in transfer_digits.py. The
threshold is chosen so that recordings have --events events on average. Training and test recordings have different
shapes. An interrupted run continues.

`aslan_pairs.csv` lists pairs of test recordings of the same and of different classes, for similarity_aslan.py. They are
in ten subsets without common recordings, as those of ASLAN, but the classes are the ones that networks are trained on.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from emulate_digits import add_folder
from transfer_digits import FLAWS, SOME, with_event_count

from nvsdata import formats
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import put
from nvsdata.common.progress import bar
from nvsdata.emulation import DVS
from nvsdata.training import run
from nvsdata.video.video_frame import VideoFrame

FPS = 120  # shapes move by less than a pixel per frame
SPRITE = 32  # side in pixels of the drawing of a shape
FINE = 2  # points per pixel along each axis, for antialiased edges
COUNT = (2, 4)  # smallest and largest number of shapes that move as the class says
OTHERS = 1  # number of shapes that move in another way
BORDER = 64  # points of the background beyond the edges
SHAKE = 0.04  # largest offset of a shaking camera, relative to the smaller side of the sensor


def main() -> None:
    args = arguments()
    size, each = tuple(args.size), args.train + args.test
    begin(args.out / "settings.txt", f"{size[0]}x{size[1]} pixels, {args.events} events, {args.train} + {args.test}")
    film = partial(moving, size=size)
    settings = with_event_count(DVS(**FLAWS), np.arange(SOME), args.events, film)
    print(f"{each * len(CLASSES)} recordings by {settings}", flush=True)
    for n in bar(range(each * len(CLASSES)), "emulate"):
        part = "train" if n < args.train * len(CLASSES) else "test"
        target = args.out / part / CLASSES[n % len(CLASSES)] / f"{n:05d}.h5"
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            formats.write(replace(settings, seed=n).emulate(film(n)), target)
    lines = ["fold,video_a,video_b,same", *(",".join(map(str, pair)) for pair in pairs(args.train, args.test))]
    put(args.out / "aslan_pairs.csv", "".join(f"{line}\n" for line in lines).encode())


def pairs(train: int, test: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield subset (1 to 10), numbers and equality of the classes of pairs of test recordings.

    A subset has all pairs of one class, and as many random ones of two classes.
    """
    count, rng = len(CLASSES), random.Random(0)
    for fold in range(10):
        numbers = [n for n in range(train * count, (train + test) * count) if n // count % 10 == fold]
        same, different = [], []
        for a, b in combinations(numbers, 2):
            (same if a % count == b % count else different).append((a, b))
        for equal, found in ((1, same), (0, rng.sample(different, len(same)))):
            yield from ((fold + 1, a, b, equal) for a, b in found)


def begin(note: Path, text: str) -> None:
    """Write the settings of a folder to a file. ValueError if the folder has others, because they would be mixed."""
    if note.exists() and (found := note.read_text(errors="replace").strip()) != text:
        raise ValueError(f"{note.parent} has recordings by other settings ({found:.80}): choose another --out")
    note.parent.mkdir(parents=True, exist_ok=True)
    put(note, f"{text}\n".encode())


def shift(axis: int, way: float, center: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the matrix [2, 3] of a motion to the right (axis 0) or down (axis 1), by the `way` of -0.5 to 0.5."""
    place = np.eye(2, 3)
    place[axis, 2] = way * middle[axis]
    return place


def turn(way: float, center: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the matrix of a clockwise rotation around the middle of the sensor."""
    cos, sin = np.cos(np.pi / 2 * way), np.sin(np.pi / 2 * way)
    turned = np.array([[cos, -sin], [sin, cos]])
    return np.column_stack((turned, middle - turned @ middle))


def grow(way: float, center: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the matrix of a shape that grows around its center."""
    scale = np.exp(way)
    return np.column_stack((scale * np.eye(2), (1 - scale) * center))


Motion = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
# pairs of classes: a motion, and the same one backwards
PAIRS: dict[tuple[str, str], Motion] = {
    ("right", "left"): partial(shift, 0),
    ("down", "up"): partial(shift, 1),
    ("clockwise", "counterclockwise"): turn,
    ("growing", "shrinking"): grow,
}
MOTIONS = {name: (motion, 1 - 2 * n) for pair, motion in PAIRS.items() for n, name in enumerate(pair)}
CLASSES = tuple(sorted(MOTIONS))


@dataclass(frozen=True)
class Shape:
    """Textured polygon: gray values and opacity [SPRITE, SPRITE], size and center in pixels, and its relative speed."""

    gray: np.ndarray
    opacity: np.ndarray
    size: float
    center: np.ndarray
    pace: float

    def paint(self, image: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Return the image [FINE * H, FINE * W] with the shape in front, moved by a matrix [2, 3] in pixels."""
        scale = self.size / SPRITE
        drawn = np.column_stack((scale * np.eye(2), self.center - self.size / 2))
        place = moved @ np.vstack((drawn, (0, 0, 1))) * FINE
        gray, opacity = (cv2.warpAffine(part, place, image.shape[::-1]) for part in (self.gray, self.opacity))
        return image + opacity * (gray - image)


def moving(seed: int, size: tuple[int, int], name: str | None = None) -> Iterator[VideoFrame]:
    """Yield the frames of a second of moving shapes.

    Args:
        seed: Seed of shapes, background, positions and speeds.
        size: (width, height) of the sensor in pixels.
        name: One of `CLASSES` (default: the one of the recording with the number `seed`).
    """
    rng = np.random.default_rng(seed)
    motion, sign = MOTIONS[name or CLASSES[seed % len(CLASSES)]]
    middle, fine = np.array(size) / 2, (FINE * size[0], FINE * size[1])
    ground = texture(rng, (fine[1] + 2 * BORDER, fine[0] + 2 * BORDER), rng.uniform(100, 155), 10)
    shaken = shaking(rng, SHAKE * min(size))
    motions = [(motion, 1)] * rng.integers(COUNT[0], COUNT[1] + 1)
    for _ in range(OTHERS):
        # in front of the others, between them or behind them; as often forwards as backwards in each class
        motions.insert(rng.integers(len(motions) + 1), list(MOTIONS.values())[rng.integers(len(MOTIONS))])
    shapes = [(shape(rng, size), *one) for one in motions]
    for n in range(FPS + 1):
        time = sign * (n / FPS - 0.5)
        offset = np.column_stack((np.zeros((2, 2)), shaken(time)))
        image = cv2.warpAffine(ground, np.eye(2, 3) + FINE * offset - [[0, 0, BORDER]], fine)
        for one, moved, direction in shapes:
            image = one.paint(image, moved(direction * one.pace * time, one.center, middle) + offset)
        pixels = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        yield VideoFrame(round(n * 1e6 / FPS), np.rint(pixels).clip(0, 255).astype(np.uint8), red_first=True)


def shaking(rng: np.random.Generator, largest: float) -> Callable[[float], np.ndarray]:
    """Return a function from a time in s to the offset (x, y) in pixels of a camera that shakes at 1 to 3 Hz."""
    amplitude, rate, phase = rng.uniform(0, largest, 2), rng.uniform(1, 3, 2), rng.uniform(0, 2 * np.pi, 2)
    return lambda time: amplitude * np.sin(2 * np.pi * rate * time + phase)


def shape(rng: np.random.Generator, size: tuple[int, int]) -> Shape:
    """Draw a random polygon of three to six corners, darker or brighter than the background."""
    corners = rng.integers(3, 7)
    angle = 2 * np.pi * (np.arange(corners) + rng.uniform(-0.25, 0.25, corners)) / corners + rng.uniform(0, 2 * np.pi)
    radius = rng.uniform(0.65, 1.0, corners) * (SPRITE / 2 - 2)
    outline = np.column_stack((np.cos(angle), np.sin(angle))) * radius[:, None] + SPRITE / 2
    opacity = np.zeros((SPRITE, SPRITE), np.float32)
    cv2.fillPoly(opacity, [np.rint(outline).astype(np.int32)], 1.0, cv2.LINE_AA)
    gray = texture(rng, opacity.shape, mean=rng.choice((50, 205)), contrast=35)
    diameter = rng.uniform(0.25, 0.45) * min(size)
    return Shape(gray, opacity, diameter, rng.uniform(0.2, 0.8, 2) * size, rng.uniform(0.7, 1.3))


def texture(rng: np.random.Generator, shape: tuple[int, ...], mean: float, contrast: float) -> np.ndarray:
    """Return a smooth random image, float32 of `shape`, with a mean and a standard deviation in gray levels."""
    smooth = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), 3)
    return mean + contrast * (smooth - smooth.mean()) / smooth.std()


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_folder(parser, (64, 48), 20_000)
    add = parser.add_argument
    add("--train", type=at_least_1, default=60, help="training recordings per class (default 60)")
    add("--test", type=at_least_1, default=30, help="test recordings per class (default 30)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "run the command again to continue")
