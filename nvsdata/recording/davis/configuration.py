"""Description of a camera, and the registers to write: the vendor's defaults, and changes by the user's settings."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from nvsdata.recording.davis.registers import APS, CHIP, CHIPS, DVS, EXTERNAL, IMU, MUX, USB, CameraSettings

Write = tuple[int, int, int]
"""A register to write: module, parameter, value."""


@dataclass(frozen=True)
class DeviceInfo:
    """Description of a connected camera, from its registers.

    Args:
        serial: Serial number.
        board: USB controller, "FX2" or "FX3".
        chip: Number of the sensor, a key of `CHIPS`.
        width: Width of the sensor in pixels, after the swap of axes.
        height: Height of the sensor in pixels, after the swap of axes.
        frame_size: Width and height of frames in pixels.
        swap: True if rows of the sensor become columns of the events.
        frame_orientation: Value of register 2/2; `stream.DavisDecoder` describes its bits.
        inertial: Value of register 3/0, the type of the inertial unit.
        inertial_flips: Value of register 3/1; `stream.DavisDecoder` describes its bits.
        logic_clock: Clock of the logic in MHz.
        converter_clock: Clock of the converter in MHz.
        usb_clock: Clock of the USB controller in MHz.
        has: Names of the optional parts that the camera has, such as "region filter".
    """

    serial: str
    board: str
    chip: int
    width: int
    height: int
    swap: bool
    frame_size: tuple[int, int]
    frame_orientation: int
    inertial: int
    inertial_flips: int
    logic_clock: float
    converter_clock: float
    usb_clock: float
    has: frozenset[str]

    @property
    def name(self) -> str:
        """The sensor's name."""
        return CHIPS.get(self.chip, f"chip {self.chip}")


def defaults(facts: DeviceInfo) -> Iterator[Write]:
    """Yield the registers of the vendor's default configuration without biases, in the vendor's order."""
    shift = [(p, int(p in (136, 138))) for p in range(128, 139)]
    shift += [(140, 0), (141, 0)]
    shift += [(139, 0)] if facts.chip in (0, 1) else [] if facts.chip == 2 else [(143, 1), (144, 0)]
    yield from ((CHIP, parameter, value) for parameter, value in shift)
    yield from ((MUX, 4, 1), (MUX, 5, 1), (DVS, 4, 0), (DVS, 5, 0))
    if "pixel filter" in facts.has:
        for k in range(8):
            yield from ((DVS, 11 + 2 * k, facts.height), (DVS, 12 + 2 * k, facts.width))
    if "activity filter" in facts.has:
        yield from ((DVS, 31, 1), (DVS, 32, 8), (DVS, 33, 0), (DVS, 34, 1))
    if "region filter" in facts.has:
        yield from ((DVS, 41, 0), (DVS, 42, 0), (DVS, 43, facts.width - 1), (DVS, 44, facts.height - 1))
    if "skip filter" in facts.has:
        yield from ((DVS, 51, 0), (DVS, 52, 5))
    if "polarity filter" in facts.has:
        yield from ((DVS, 61, 0), (DVS, 62, 0), (DVS, 63, 0))
    yield APS, 5, 1
    if "global shutter" in facts.has:
        yield from ((CHIP, 142, 1), (APS, 7, 1))
    wide, high = facts.frame_size
    yield from ((APS, 8, 0), (APS, 9, 0), (APS, 10, wide - 1), (APS, 11, high - 1))
    yield from ((APS, 12, cycles(4_000, facts.converter_clock)), (APS, 13, cycles(40_000, facts.converter_clock)))
    yield from ((IMU, 5, 0), (IMU, 6, 1), (IMU, 7, 1))
    if facts.inertial == 2:
        yield IMU, 9, 1
    yield IMU, 10, 1
    pulse = cycles(10, facts.logic_clock)
    yield from ((EXTERNAL, 1, 0), (EXTERNAL, 2, 0), (EXTERNAL, 3, 1), (EXTERNAL, 4, 1), (EXTERNAL, 5, pulse))
    if "generator" in facts.has:
        length = cycles(5, facts.logic_clock)
        generator = ((11, 0), (12, 1), (13, pulse), (14, length), (15, 0), (16, 0))
        yield from ((EXTERNAL, parameter, value) for parameter, value in generator)
    yield USB, 1, cycles(1_000, facts.usb_clock)


def changes(facts: DeviceInfo, settings: CameraSettings) -> Iterator[Write]:
    """Yield the registers of settings that differ from the defaults; raise ValueError for unsupported settings."""
    default = CameraSettings()
    for name, wanted, needed in (
        ("send only the events of a region", settings.region, "region filter"),
        ("mask pixels", settings.masked, "pixel filter"),
        ("skip events", settings.skip, "skip filter"),
        ("send only one polarity", settings.polarity != "both", "polarity filter"),
    ):
        if wanted and needed not in facts.has:
            raise ValueError(f"this {facts.name} can't {name}")
    if settings.region is not None:
        size = (facts.width, facts.height)
        yield from ((DVS, 41 + n, edge) for n, edge in enumerate(_edges("region", settings.region, size, facts.swap)))
    for k, (x, y) in enumerate(settings.masked):
        if not (0 <= x < facts.width and 0 <= y < facts.height):
            raise ValueError(f"masked pixel {(x, y)} is not within {facts.width}x{facts.height}")
        row, column = (x, y) if facts.swap else (y, x)
        yield from ((DVS, 11 + 2 * k, row), (DVS, 12 + 2 * k, column))
    if settings.skip is not None:
        yield from ((DVS, 51, 1), (DVS, 52, settings.skip))
    if settings.polarity != "both":
        yield from ((DVS, 62, 1), (DVS, 63, int(settings.polarity == "off")))
    if settings.frame_region is not None:
        turned = bool(facts.frame_orientation & 4)
        edges = _edges("frame_region", settings.frame_region, facts.frame_size, turned)
        yield from ((APS, 8 + n, edge) for n, edge in enumerate(edges))
    if "activity filter" in facts.has:
        for first, name in ((31, "activity_filter"), (33, "refractory_filter")):
            period = getattr(settings, name)
            if period != getattr(default, name):
                yield DVS, first, int(period is not None)
                if period is not None:
                    yield DVS, first + 1, max(1, round(period / 250))
    for parameter, name in ((12, "exposure"), (13, "frame_interval")):
        if getattr(settings, name) != getattr(default, name):
            yield APS, parameter, cycles(getattr(settings, name), facts.converter_clock)
    if settings.external != default.external:
        rising, falling = settings.external in ("rising", "both"), settings.external in ("falling", "both")
        yield from ((EXTERNAL, 1, int(rising)), (EXTERNAL, 2, int(falling)), (EXTERNAL, 3, 0))
    if settings.packet_delay != default.packet_delay:
        yield USB, 1, cycles(settings.packet_delay, facts.usb_clock)


def _edges(
    name: str, region: tuple[int, int, int, int], size: tuple[int, int], swap: bool
) -> tuple[int, int, int, int]:
    """Return a region's first column and row, last column and row, as the device takes them.

    Raises:
        ValueError: The region is not within the sensor.
    """
    x, y, width, height = region
    if x + width > size[0] or y + height > size[1]:
        raise ValueError(f"{name} {region} is not within {size[0]}x{size[1]}")
    left, top, right, bottom = x, y, x + width - 1, y + height - 1
    return (top, left, bottom, right) if swap else (left, top, right, bottom)


def cycles(microseconds: float, clock: float) -> int:
    """Return a time as whole cycles of a clock (MHz); halves are rounded up."""
    return math.floor(microseconds * clock + 0.5)
