"""Measurement of a screen in the view of a camera, from the events of flashes and of a still image."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.common.files import put
from nvsdata.data.events import Events
from nvsdata.plots import curves, save_png
from nvsdata.plots.drawing import OFF, ON
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.rig.clock_fit import LONGEST, ClockFit, NoSync

FIGURES = "calibration.json"
BIN = 500  # µs per bin of the event rate whose spectrum is taken
SLOWEST = 20.0  # Hz; slower changes don't count as flicker
NEAR = 1.0  # Hz by which a spectral line may be off its expected frequency
STRONG = 12.0  # factor by which a spectral line must exceed the noise
SEEN = 0.5  # fraction of the flashes that a pixel of the screen must have recorded
LEAST = 0.02  # fraction of the sensor that the screen must cover
ZOOM = 3  # pixels of the image per pixel of the sensor
HIGHEST = 400.0  # Hz; highest frequency that is drawn
Rectangle = tuple[int, int, int, int]
Round = Callable[[float], float]


@dataclass(frozen=True)
class ScreenCalibration:
    """Measurements of a calibration.

    Args:
        response: Fraction of the flashes that each pixel recorded, [H, W].
        corners: Positions (x, y) on the sensor of the upper left, upper right, lower right and lower left corner of the
            region of the screen that shows videos, [4, 2].
        roi: (x, y, width, height) of the smallest upright rectangle around these corners, in pixels of the sensor.
        crop: (x, y, width, height) of an upright rectangle inside the region, in pixels of the sensor.
        cover: Fraction of the sensor that the screen fills.
        frequencies: Frequencies of the spectrum in Hz.
        spectrum: Spectrum of the event rate of a still screen, relative to the noise.
        flicker: Height of each spectral line above the noise, relative to the noise, by frequency (Hz).
    """

    response: np.ndarray
    corners: np.ndarray
    roi: Rectangle
    crop: Rectangle
    cover: float
    frequencies: np.ndarray
    spectrum: np.ndarray
    flicker: dict[float, float]


def response(events: Events, line: ClockFit, shown: list[float], bright: list[bool]) -> np.ndarray:
    """Return the fraction of the flashes that each pixel recorded, [H, W].

    Args:
        events: Events of the camera.
        line: Fit of camera time to host time.
        shown: Host times (µs) of the flashes.
        bright: True for each change to bright, False for each change to dim.
    """
    width, height = events.sensor_size
    seen = np.zeros(width * height)
    for host, rising in zip(shown, bright, strict=True):
        moment = round(line.camera(host))
        burst = events.window(moment - 1_000, moment + LONGEST)
        right = burst.p == rising
        seen[np.unique(burst.y[right] * np.intp(width) + burst.x[right])] += 1
    return seen.reshape(height, width) / max(len(shown), 1)


def corners_of(screen: np.ndarray, quarter: np.ndarray) -> np.ndarray:
    """Return the corners of the screen [4, 2], in the order of `ScreenCalibration`.

    Args:
        screen: Fraction of the flashes of the entire screen that each pixel recorded, [H, W].
        quarter: The same for flashes of the screen's upper left quarter.

    Raises:
        NoSync: Too few pixels see the screen, or none sees the quarter.
    """
    corners, largest = outline_of(screen)
    place = np.argwhere((quarter >= SEEN) & largest)
    if not len(place):
        raise NoSync("no pixel sees the upper left quarter of the screen")
    # the corner nearest to the quarter is the first; the others follow clockwise on the sensor as on the screen
    first = int(np.hypot(*(corners - place.mean(0)[::-1]).T).argmin())
    return np.roll(corners, -first, 0)


def outline_of(screen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the screen's corners [4, 2], clockwise on the sensor, and the mask of the pixels that see it, bool [H, W].

    Args:
        screen: Fraction of the flashes that each pixel recorded, [H, W].

    Raises:
        NoSync: Too few pixels see the screen.
    """
    seen = cv2.morphologyEx((screen >= SEEN).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(seen)
    if count < 2 or stats[1:, cv2.CC_STAT_AREA].max() < LEAST * seen.size:
        raise NoSync("too few pixels see the screen: aim the camera at it, and focus")
    largest = labels == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()
    contours, _ = cv2.findContours(largest.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(contours, key=cv2.contourArea)
    return _refined(_quadrilateral(cv2.convexHull(contour)), contour[:, 0]), largest


def _quadrilateral(hull: np.ndarray) -> np.ndarray:
    """Return four corners of a convex hull, clockwise in the image, [4, 2]."""
    length = cv2.arcLength(hull, True)
    for share in np.linspace(0.01, 0.2, 39):
        found = cv2.approxPolyDP(hull, share * length, True)
        if len(found) <= 4:
            break
    if len(found) != 4:
        found = cv2.boxPoints(cv2.minAreaRect(hull))[:, None]
    quad = found[:, 0].astype(np.float64)
    around = quad - quad.mean(0)
    return quad[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]


def _refined(rough: np.ndarray, contour: np.ndarray) -> np.ndarray:
    """Return the intersections of lines fitted to the contour's sides, [4, 2]; `rough` if a side has too few points."""
    sides = []
    for a, b in zip(rough, np.roll(rough, -1, 0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        offset = contour - a
        part, away = offset @ along / np.linalg.norm(b - a), np.abs(offset @ np.array([-along[1], along[0]]))
        near = contour[(part > 0.1) & (part < 0.9) & (away < 4)]
        if len(near) < 10:
            return rough
        vx, vy, x, y = cv2.fitLine(near.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel()
        sides.append(np.cross([x, y, 1.0], [x + vx, y + vy, 1.0]))
    meet = [np.cross(sides[n - 1], sides[n]) for n in range(4)]
    return np.array([(x / w, y / w) for x, y, w in meet])


def rectangles(corners: np.ndarray, size: tuple[int, int]) -> tuple[Rectangle, Rectangle, float]:
    """Return the fields `roi`, `crop` and `cover` of `ScreenCalibration`; `size` is the sensor's (width, height)."""
    xs, ys = np.sort(corners[:, 0]), np.sort(corners[:, 1])
    cover = cv2.contourArea(corners.astype(np.float32)) / (size[0] * size[1])
    outer = _rectangle((xs[0], ys[0]), (xs[3], ys[3]), size, np.floor, np.ceil)
    inner = _rectangle((xs[1], ys[1]), (xs[2], ys[2]), size, np.ceil, np.floor)
    return outer, inner, min(float(cover), 1.0)


def _rectangle(
    first: tuple[float, float], last: tuple[float, float], size: tuple[int, int], low: Round, high: Round
) -> Rectangle:
    """Return (x, y, width, height) from `first`, rounded by `low`, to `last`, rounded by `high`, within the sensor."""
    sides = []
    for a, b, limit in zip(first, last, size, strict=True):
        begin = min(max(int(low(a)), 0), limit - 1)
        sides.append((begin, min(max(int(high(b)) + 1, begin + 1), limit) - begin))
    (x, width), (y, height) = sides
    return x, y, width, height


def spectrum_of(events: Events, start: int, duration: int) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (Hz), and the amplitude of the event rate at each, relative to noise of the same mean rate."""
    bins = duration // BIN
    counts = np.bincount(np.clip((events.t - start) // BIN, 0, bins - 1), minlength=bins).astype(np.float64)
    window = np.hanning(bins)
    amplitude = np.abs(np.fft.rfft((counts - counts.mean()) * window))
    # for independent counts, the expected squared amplitude is their mean times the sum of the squared window
    noise = np.sqrt(max(counts.mean(), 1e-9) * (window**2).sum())
    return np.fft.rfftfreq(bins, BIN / 1e6), amplitude / noise


def lines_of(frequencies: np.ndarray, spectrum: np.ndarray, expected: tuple[float, ...]) -> dict[float, float]:
    """Return the height of spectral lines above the noise by frequency (Hz): those near `expected`, and the highest."""
    found = {}
    counted = frequencies >= SLOWEST
    floor = max(float(np.median(spectrum[counted])), 1.0)
    best = float(frequencies[counted][spectrum[counted].argmax()])
    for frequency in (*expected, best):
        near = np.flatnonzero(np.abs(frequencies - frequency) <= NEAR)
        if near.size:
            peak = near[spectrum[near].argmax()]
            if spectrum[peak] > STRONG * floor:
                found[round(float(frequencies[peak]), 2)] = round(float(spectrum[peak] / floor), 1)
    return dict(sorted(found.items()))


def calibration_summary(found: ScreenCalibration, size: tuple[int, int]) -> str:
    """Return the calibration as text of a few lines; `size` is (width, height) of the sensor."""
    places = ", ".join(f"({x:.1f}, {y:.1f})" for x, y in found.corners)
    lines = [
        f"screen corners, clockwise from the upper left: {places}; the screen fills {found.cover:.0%} of the sensor",
        f"region of interest: --region {' '.join(map(str, found.roi))}; largest upright crop: {found.crop}",
    ]
    x, y, width, height = found.roi
    beyond = [
        side
        for side, over in (
            ("left", x == 0),
            ("top", y == 0),
            ("right", x + width == size[0]),
            ("bottom", y + height == size[1]),
        )
        if over
    ]
    if beyond:
        lines.append(
            f"the screen reaches the edge of the view ({', '.join(beyond)}): move the camera back, or use another lens"
        )
    peaks = ", ".join(f"{frequency:g} Hz ({height:g} times the noise)" for frequency, height in found.flicker.items())
    cure = "choose another refresh rate, or a monitor without flicker"
    lines.append(f"flicker: {peaks}: {cure}" if peaks else "no flicker found")
    return "\n".join(lines)


def write_calibration(found: ScreenCalibration, settings: CameraSettings, size: tuple[int, int], out: Path) -> None:
    """Write `calibration.json`, `settings.json` (for `--settings`), `corners.png` and `flicker.png` to a folder."""
    out.mkdir(parents=True, exist_ok=True)
    figures = {
        "sensor_size": size,
        "corners": found.corners.round(2).tolist(),
        "roi": found.roi,
        "crop": found.crop,
        "cover": round(found.cover, 4),
        "flicker": found.flicker,
    }
    for name, value in ((FIGURES, figures), ("settings.json", asdict(settings))):
        put(out / name, f"{json.dumps(value, indent=1)}\n".encode())
    save_png(_picture(found), out / "corners.png")
    shown = (found.frequencies >= SLOWEST) & (found.frequencies <= HIGHEST)
    spectrum = found.spectrum[shown]
    lines = [("rate of events", spectrum.tolist())]
    title = "flicker of a still screen: amplitude relative to noise"
    ends = (SLOWEST, HIGHEST)
    save_png(curves(lines, title, "Hz", highest=max(float(spectrum.max()), STRONG), ends=ends), out / "flicker.png")


def corners_in(folder: Path) -> list[list[float]]:
    """Return the screen's corners from the folder of a calibration; raise FormatError if the file is damaged."""
    path = folder / FIGURES
    try:
        corners: list[list[float]] = np.array(json.loads(path.read_text())["corners"], float).reshape(4, 2).tolist()
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FormatError(path, f"isn't a file of --calibrate: {error}") from None
    return corners


def _picture(found: ScreenCalibration) -> np.ndarray:
    """Draw the pixels that recorded the flashes, with corners, region and crop; return uint8 [H, W, 3], BGR."""
    gray = (found.response * 255).astype(np.uint8).repeat(ZOOM, 0).repeat(ZOOM, 1)
    image = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    corners = ((found.corners + 0.5) * ZOOM).round().astype(np.int32)
    cv2.polylines(image, [corners], True, ON, 2, cv2.LINE_AA)
    cv2.circle(image, corners[0].tolist(), 6, ON, -1, cv2.LINE_AA)
    for (x, y, width, height), color in ((found.roi, OFF), (found.crop, (60, 200, 60))):
        cv2.rectangle(image, (x * ZOOM, y * ZOOM), ((x + width) * ZOOM - 1, (y + height) * ZOOM - 1), color, 1)
    return image
