"""Measure the accuracy of PlaneFlow and Corners on emulated events of shapes with known motion.

    python recipes/motion_accuracy.py

A bright square and a dark triangle move over a sensor of 200x150 pixels at constant velocity, in twelve directions. The
scene is drawn at 2,000 frames per second and converted by `DVS`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.emulation import DVS
from nvsdata.training import run

SIZE = (200, 150)
FPS = 2_000.0
GROUND = 80.0
DIRECTIONS = 12
PATH = 60.0  # pixels that a shape moves
NEAR = 3.0  # pixels from a true corner or edge
BEGIN = 8.0  # pixels of the path after which events are compared, because surfaces are empty at first
STEP = 3.0  # pixels of the path in which a corner should be found once
REFRACTORY = 20_000  # µs
BACKGROUND = 5_000  # µs
HEAD_OF_CORNERS = """
| noise | filtered | pixels per second | precision | of all events | recall | kept |
|---|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Shape:
    """Convex polygon around (0, 0), [K, 2] in pixels and clockwise in image coordinates, with its gray value."""

    corners: np.ndarray
    value: float

    @property
    def normals(self) -> np.ndarray:
        """Outward unit normals of the edges, [K, 2]; edge k begins at corner k."""
        along = np.roll(self.corners, -1, 0) - self.corners
        return np.stack((along[:, 1], -along[:, 0]), 1) / np.hypot(*along.T)[:, None]

    def outside(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the distance of points from the line of each edge, [K, ...], positive outside."""
        lines = zip(self.normals, self.corners, strict=True)
        return np.stack([nx * (x - cx) + ny * (y - cy) for (nx, ny), (cx, cy) in lines])


def polygon(sides: int, radius: float, turn: float, value: float) -> Shape:
    """Return a regular polygon, turned by an angle in radians."""
    angles = turn + 2 * np.pi * np.arange(sides) / sides
    return Shape(radius * np.stack((np.cos(angles), np.sin(angles)), 1), value)


@dataclass(frozen=True)
class Scene:
    """Shape whose center moves through the middle of the sensor at constant velocity, in pixels per second."""

    shape: Shape
    velocity: np.ndarray

    @property
    def speed(self) -> float:
        return float(np.hypot(*self.velocity))

    def center(self, t: np.ndarray) -> np.ndarray:
        """Return the shape's center at times in µs, [2, ...]."""
        middle = (np.array(SIZE) - 1) / 2
        passed = np.asarray(t) / 1e6 - PATH / self.speed / 2
        return np.stack([m + v * passed for m, v in zip(middle, self.velocity, strict=True)])

    def frames(self) -> Iterator[np.ndarray]:
        """Yield frames uint8 [H, W], with edges that are smooth over a pixel."""
        y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
        for n in range(round(PATH / self.speed * FPS) + 1):
            cx, cy = self.center(np.array(n / FPS * 1e6))
            inside = np.clip(0.5 - self.shape.outside(x - cx, y - cy).max(0), 0, 1)
            yield np.rint(GROUND + (self.shape.value - GROUND) * inside).astype(np.uint8)

    def has_begun(self, events: Events) -> np.ndarray:
        """Return the mask of the events that are compared."""
        return events.t / 1e6 * self.speed >= BEGIN

    def corner_distances(self, events: Events) -> np.ndarray:
        """Return the distance of each event from each true corner at its time, [N, K]."""
        x, y = np.stack((events.x, events.y)) - self.center(events.t)
        return np.hypot(x[:, None] - self.shape.corners[:, 0], y[:, None] - self.shape.corners[:, 1])

    def true_flow(self, events: Events) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal velocity of the nearest edge [N, 2], and the mask of the events that are compared.

        These are near an edge that moves at least at a fifth of the shape's speed, and further from its ends.
        """
        x, y = np.stack((events.x, events.y)) - self.center(events.t)
        outside = np.abs(self.shape.outside(x, y))
        edge = outside.argmin(0)
        along = self.shape.normals @ self.velocity
        at_edge = (outside.min(0) <= NEAR) & (self.corner_distances(events) > 2 * NEAR).all(1)
        moves = np.abs(along[edge]) >= 0.2 * self.speed
        return (along[:, None] * self.shape.normals)[edge], at_edge & moves & self.has_begun(events)


Pairs = list[tuple[Scene, Events]]


def scenes(speed: float) -> Iterator[Scene]:
    for n in range(DIRECTIONS):
        direction = 2 * np.pi * (n + 0.3) / DIRECTIONS
        shape = polygon(4, 35, 0.4 + n / 5, 200) if n % 2 else polygon(3, 40, 0.7 + n / 5, 30)
        yield Scene(shape, speed * np.array([np.cos(direction), np.sin(direction)]))


def flow_errors(scene: Scene, events: Events) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors of the direction in degrees, relative errors of the speed, and the mask of valid events."""
    found = T.PlaneFlow()(events).double().numpy()
    truth, compared = scene.true_flow(events)
    valid = found[compared, 2] == 1
    (ax, ay), (bx, by) = found[compared][valid, :2].T, truth[compared][valid].T
    angle = np.degrees(np.abs(np.arctan2(ax * by - ay * bx, ax * bx + ay * by)))
    return angle, np.abs(np.hypot(ax, ay) / np.hypot(bx, by) - 1), valid


def flow_row(pairs: Pairs) -> str:
    """Return medians over all events of all scenes, and the fraction of valid events."""
    angle, speed, valid = map(np.concatenate, zip(*(flow_errors(*pair) for pair in pairs), strict=True))
    return f"{np.median(angle):.1f}° | {np.median(speed):.1%} | {valid.mean():.0%}"


def corner_counts(scene: Scene, events: Events) -> np.ndarray:
    """Return numbers: events, those near a corner, the same for corner events, steps of true corners, those found."""
    counts = []
    for some in (events, T.Corners()(events)):
        some = some[scene.has_begun(some)]
        near = scene.corner_distances(some) <= NEAR
        counts += [len(some), near.any(1).sum()]
    at, corner = np.nonzero(near)
    step = ((some.t / 1e6 * scene.speed - BEGIN) / STEP).astype(int)[at]
    steps = int((PATH - BEGIN) / STEP)
    found = np.unique(np.stack((step, corner))[:, step < steps], axis=1).shape[1]
    return np.array([*counts, steps * near.shape[1], found])


def corner_row(pairs: Pairs) -> str:
    """Return the precision of corner events, that of all events, the recall, and the fraction of events kept."""
    events, near, kept, right, steps, found = sum(corner_counts(*pair) for pair in pairs)
    return f"{right / kept:.0%} | {near / events:.0%} | {found / steps:.0%} | {kept / events:.1%}"


def emulated(speed: float, emulator: DVS, before: Callable[[Events], Events]) -> Pairs:
    return [(scene, before(emulator.emulate(scene.frames(), fps=FPS))) for scene in scenes(speed)]


def throughput(transform: Callable[[Events], object], events: Events) -> str:
    """Return the median of five runs, in millions of events per second of processor time."""
    took = []
    for _ in range(5):
        begin = time.process_time()
        transform(events)
        took.append(time.process_time() - begin)
    return f"{transform}: {len(events) / np.median(took) / 1e6:.1f} million events per second"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--speeds", type=float, nargs="+", default=[100, 300, 1000], help="pixels per second (default 100 300 1000)"
    )
    args = parser.parse_args()
    emulators = {"no": DVS(), "yes": DVS(noise_rate=0.5, mismatch=0.03, seed=0)}
    filters: dict[str, Callable[[Events], Events]] = {"no": T.Compose([]), "yes": T.RefractoryPeriod(REFRACTORY)}

    print("| noise | refractory period | pixels per second | direction | speed | valid |\n|---|---|---|---|---|---|")
    for (noise, emulator), (period, before), speed in product(emulators.items(), filters.items(), args.speeds):
        print(f"| {noise} | {period} | {speed:g} | {flow_row(emulated(speed, emulator, before))} |", flush=True)
    print(HEAD_OF_CORNERS)
    filters = {"no": T.Compose([]), "yes": T.BackgroundActivity(BACKGROUND)}
    for (noise, emulator), (filtered, before), speed in product(emulators.items(), filters.items(), args.speeds):
        if noise == "yes" or filtered == "no":
            row = corner_row(emulated(speed, emulator, before))
            print(f"| {noise} | {filtered} | {speed:g} | {row} |", flush=True)
    print()
    for transform in (T.PlaneFlow(), T.Corners()):
        print(throughput(transform, nvsdata.example()))


if __name__ == "__main__":
    run(main, "run the command again")
