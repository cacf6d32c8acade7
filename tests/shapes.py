"""Ideal events of moving shapes: one at each pixel whenever the outline passes it."""

import numpy as np

from nvsdata import Events


def moving_edge(velocity, size=(24, 20)):
    """A straight edge that moves along its normal; each pixel has one event when it passes."""
    y, x = (axis.ravel() for axis in np.mgrid[: size[1], : size[0]])
    velocity = np.asarray(velocity, float)
    t = np.rint(1e6 * (x * velocity[0] + y * velocity[1]) / (velocity @ velocity)).astype(int)
    return Events(t, x, y, np.ones(t.size), size)


def square_center(t, velocity, begin):
    """The center at times in µs, [2, ...]."""
    return np.stack([b + v * np.asarray(t) / 1e6 for b, v in zip(begin, velocity, strict=True)])


def moving_square(velocity, half=9.0, turn=0.0, begin=(20.0, 20.0), duration=60_000, size=(60, 50), step=50):
    """A turned square of the side 2 half: ON where it comes, OFF where it leaves."""
    y, x = np.mgrid[: size[1], : size[0]].astype(float)
    cos, sin = np.cos(turn), np.sin(turn)
    before, columns = None, []
    for t in range(0, duration, step):
        cx, cy = square_center(t, velocity, begin)
        u, v = cos * (x - cx) + sin * (y - cy), cos * (y - cy) - sin * (x - cx)
        inside = (abs(u) <= half) & (abs(v) <= half)
        if before is not None:
            rows, places = np.nonzero(inside != before)
            columns.append((np.full(rows.size, t), places, rows, inside[rows, places]))
        before = inside
    return Events(*map(np.concatenate, zip(*columns, strict=True)), size)
