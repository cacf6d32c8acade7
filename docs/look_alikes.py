"""Drawn scenes, emulated to events, in place of recordings that may not be passed on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from nvsdata import Events
from nvsdata.emulation import DVS

RATE = 200  # frames per second
LENGTH = 24  # frames
GROUND, INK = 90, 210
Draw = Callable[[np.ndarray, float], None]  # draws into an image of 240x180 pixels at a time in s


def _line(image: np.ndarray, *points: tuple[float, float], width: int = 9) -> None:
    # positions in sixteenths of a pixel, so that slow motion is smooth
    corners = np.round(np.array(points) * 16).astype(np.int32)[:, None]
    cv2.polylines(image, [corners], False, INK, width, cv2.LINE_AA, 4)


def _disc(image: np.ndarray, x: float, y: float, radius: float, ink: int = INK) -> None:
    cv2.circle(image, (round(x * 16), round(y * 16)), round(radius * 16), ink, -1, cv2.LINE_AA, 4)


def person(image: np.ndarray, t: float, arms: float, legs: float, lean: float = 0.06, rise: float = 0.0) -> None:
    """Draw a person whose arms and legs swing by an angle in radians."""
    swing = np.sin(2 * np.pi * 2.5 * t)
    x, hip = 120 + lean * 60 * swing, 105 - rise * 12 * swing
    neck = hip - 45
    _disc(image, x, neck - 16, 13)
    _line(image, (x, neck), (x, hip), width=15)
    for side in (-1, 1):
        arm, leg = 0.5 + arms * swing * side, 0.25 + legs * swing * side
        _line(image, (x, neck + 5), (x + side * 38 * np.sin(arm), neck + 5 + 38 * np.cos(arm)))
        _line(image, (x, hip), (x + side * 52 * np.sin(leg), hip + 52 * np.cos(leg)))


def hand(image: np.ndarray, t: float, fingers: tuple[int, ...]) -> None:
    """Draw a hand with some of its five fingers stretched, in slight motion."""
    x, y = 120 + 6 * np.sin(2 * np.pi * 4 * t), 125 + 5 * np.cos(2 * np.pi * 4 * t)
    _disc(image, x, y, 34)
    _line(image, (x, y), (x, y + 60), width=36)
    for n in range(5):
        angle, length = (n - 2.2) * 0.36, 88 if n in fingers else 44
        _line(image, (x, y), (x + length * np.sin(angle), y - length * np.cos(angle)), width=14)


def thing(image: np.ndarray, t: float, corners: int) -> None:
    """Draw an object in a saccade."""
    x, y = 120 + 60 * t, 90 + 25 * t
    for radius, ink in ((58, INK), (34, 40)):
        angles = np.arange(2 * corners) * np.pi / corners
        reach = radius * np.where(np.arange(2 * corners) % 2, 1.0, 0.55)
        star = np.stack((x + reach * np.cos(angles), y + reach * np.sin(angles)), 1)
        cv2.fillPoly(image, [np.round(star * 16).astype(np.int32)], ink, cv2.LINE_AA, 4)


def scene(image: np.ndarray, t: float, across: float, along: float, speed: float) -> None:
    """Draw waves that drift."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    waves = np.sin(x * across + y * along - speed * t) + np.sin(0.7 * x * along - y * across - 0.6 * speed * t)
    image[:] = GROUND + 35 * waves + 35


SCENES: dict[str, dict[str, Draw]] = {
    "n-caltech101": {f"object {n - 2}": partial(thing, corners=n) for n in (3, 4, 5, 8)},
    "asl-dvs": {
        "letter d": partial(hand, fingers=(1,)),
        "letter v": partial(hand, fingers=(1, 2)),
        "letter w": partial(hand, fingers=(1, 2, 3)),
        "letter b": partial(hand, fingers=(1, 2, 3, 4)),
    },
    "dvs128-gesture": {
        "arms rotate": partial(person, arms=1.6, legs=0.0),
        "arms wave": partial(person, arms=0.8, legs=0.0),
        "clap": partial(person, arms=0.4, legs=0.0),
    },
    "ucf50-dvs": {
        "jumping jack": partial(person, arms=1.5, legs=0.4, rise=1.0),
        "skiing": partial(person, arms=0.3, legs=0.1, lean=0.5),
        "walking": partial(person, arms=0.5, legs=0.5),
    },
    "hmdb51-dvs": {
        "walk": partial(person, arms=0.4, legs=0.5),
        "jump": partial(person, arms=0.6, legs=0.1, rise=2.0),
        "wave": partial(person, arms=1.2, legs=0.0),
    },
    "aslan-dvs": {
        "first of a pair": partial(person, arms=1.2, legs=0.3),
        "same action": partial(person, arms=1.1, legs=0.35, lean=0.2),
        "other action": partial(person, arms=0.2, legs=0.1, lean=0.5),
    },
    "yupenn-dvs": {
        "ocean": partial(scene, across=0.06, along=0.14, speed=25.0),
        "waterfall": partial(scene, across=0.02, along=0.25, speed=90.0),
        "fountain": partial(scene, across=0.2, along=0.2, speed=60.0),
    },
}


def look_alikes(name: str, sensor_size: tuple[int, int]) -> dict[str, Events]:
    """Return emulated events of drawn scenes by their captions; empty if the dataset has none.

    Args:
        name: Name of a dataset.
        sensor_size: Its (width, height) in pixels.
    """
    found = {}
    for caption, draw in SCENES.get(name, {}).items():
        frames = []
        for n in range(LENGTH):
            image = np.full((180, 240), GROUND, np.uint8)
            draw(image, n / RATE)
            # the central square of the drawing, if the sensor is one
            cut = image[:, 30:210] if sensor_size[0] == sensor_size[1] else image
            frames.append(cv2.resize(cut, sensor_size, interpolation=cv2.INTER_AREA))
        times = np.arange(LENGTH) * 1_000_000 // RATE
        found[caption] = DVS().emulate(np.stack(frames), times=times)
    return found
