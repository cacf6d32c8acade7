"""Registers and biases of DAVIS cameras (logic version 18), and the settings that a user can change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from nvsdata.common.validation import not_negative, positive

# modules
MUX, DVS, APS, IMU, EXTERNAL, CHIP, SYSTEM, USB = 0, 1, 2, 3, 4, 5, 6, 9

# registers that enable parts of the camera, in the order in which a stop sets them to 0
RUNNING = ((DVS, 3), (APS, 4), (IMU, 2), (IMU, 3), (IMU, 4), (EXTERNAL, 0), (MUX, 0), (MUX, 1), (USB, 0), (MUX, 3))
EXTERNAL_EDGES = ("pulses", "rising", "falling", "both")
POLARITIES = ("both", "on", "off")
MASKED = 8  # pixels whose events a camera can suppress
CHIPS = {
    0: "DAVIS240A",
    1: "DAVIS240B",
    2: "DAVIS240C",
    3: "DAVIS128",
    4: "DAVIS346A",
    5: "DAVIS346B",
    6: "DAVIS640",
    7: "DAVIS640H",
    8: "DAVIS208",
    9: "DAVIS346C",
}
# low bits of currents: enabled, current level, type, sex (N or P)
N, P, N_CASCODE, N_OFF = 0xF, 0xD, 0xB, 0xE
VDAC, SHIFTED = -1, -2


@dataclass(frozen=True)
class Bias:
    """A bias of a chip.

    Args:
        parameter: Number of the register in module `CHIP`.
        first: Default of the bias's first number.
        second: Default of the bias's second number. Currents have a coarse (0..7) and a fine (0..255) number, shifted
            sources a reference and a regulator (0..63 each), VDACs a voltage (0..63) and a current (0..7).
        kind: `VDAC`, `SHIFTED`, or the low bits of a current.
    """

    parameter: int
    first: int
    second: int
    kind: int

    def value(self, first: int | None = None, second: int | None = None) -> int:
        """Return the register's value for these numbers, or the defaults; raise ValueError for numbers out of range."""
        a = self.first if first is None else first
        b = self.second if second is None else second
        highest = {VDAC: (63, 7), SHIFTED: (63, 63)}.get(self.kind, (7, 255))
        if not (0 <= a <= highest[0] and 0 <= b <= highest[1]):
            raise ValueError(f"a bias of this kind takes 0..{highest[0]}:0..{highest[1]}, not {a}:{b}")
        if self.kind == VDAC:
            return b << 6 | a
        return b << 10 | a << 4 if self.kind == SHIFTED else a << 12 | b << 4 | self.kind


def _biases(*rows: tuple[str, int, int, int, int]) -> dict[str, Bias]:
    return {name: Bias(*row) for name, *row in rows}


BIASES_240 = _biases(
    ("DiffBn", 0, 4, 39, N),
    ("OnBn", 1, 5, 255, N),
    ("OffBn", 2, 4, 0, N),
    ("ApsCasEpc", 3, 5, 185, N_CASCODE),
    ("DiffCasBnc", 4, 5, 115, N_CASCODE),
    ("ApsROSFBn", 5, 6, 219, N),
    ("LocalBufBn", 6, 5, 164, N),
    ("PixInvBn", 7, 6, 144, N),
    ("PrBp", 8, 2, 58, P),
    ("PrSFBp", 9, 1, 16, P),
    ("RefrBp", 10, 4, 25, P),
    ("AEPdBn", 11, 6, 91, N),
    ("LcolTimeoutBn", 12, 5, 49, N),
    ("AEPuXBp", 13, 4, 80, P),
    ("AEPuYBp", 14, 7, 152, P),
    ("IFThrBn", 15, 5, 255, N),
    ("IFRefrBn", 16, 5, 255, N),
    ("PadFollBn", 17, 7, 215, N),
    ("ApsOverflowLevelBn", 18, 6, 253, N),
    ("BiasBuffer", 19, 5, 254, N),
    ("SSP", 20, 1, 33, SHIFTED),
    ("SSN", 21, 1, 33, SHIFTED),
)
BIASES_346 = _biases(
    ("ApsOverflowLevel", 0, 27, 6, VDAC),
    ("ApsCas", 1, 21, 6, VDAC),
    ("AdcRefHigh", 2, 32, 7, VDAC),
    ("AdcRefLow", 3, 1, 7, VDAC),
    ("AdcTestVoltage", 4, 21, 7, VDAC),
    ("LocalBufBn", 8, 5, 164, N),
    ("PadFollBn", 9, 7, 215, N_OFF),
    ("DiffBn", 10, 4, 39, N),
    ("OnBn", 11, 5, 255, N),
    ("OffBn", 12, 4, 1, N),
    ("PixInvBn", 13, 6, 144, N),
    ("PrBp", 14, 2, 58, P),
    ("PrSFBp", 15, 1, 16, P),
    ("RefrBp", 16, 4, 25, P),
    ("ReadoutBufBp", 17, 6, 20, P),
    ("ApsROSFBn", 18, 6, 219, N),
    ("AdcCompBp", 19, 5, 20, P),
    ("ColSelLowBn", 20, 0, 1, N),
    ("DACBufBp", 21, 6, 60, P),
    ("LcolTimeoutBn", 22, 5, 49, N),
    ("AEPdBn", 23, 6, 91, N),
    ("AEPuXBp", 24, 4, 80, P),
    ("AEPuYBp", 25, 7, 152, P),
    ("IFRefrBn", 26, 5, 255, N),
    ("IFThrBn", 27, 5, 255, N),
    ("BiasBuffer", 34, 5, 254, N),
    ("SSP", 35, 1, 33, SHIFTED),
    ("SSN", 36, 1, 33, SHIFTED),
)


def biases_of(chip: int) -> dict[str, Bias]:
    """Return the biases of a chip by name; raise ValueError for a chip that isn't supported."""
    if chip in (0, 1, 2):
        return BIASES_240
    if chip in (4, 5, 9):
        return BIASES_346
    raise ValueError(f"{CHIPS.get(chip, f'chip {chip}')} isn't supported, only DAVIS240 and DAVIS346 are")


@dataclass(frozen=True)
class CameraSettings:
    """Settings of a DAVIS camera.

    Args:
        biases: Two numbers for each name of a bias (see `Bias`), in place of the chip's defaults.
        frames: Send frames in addition to events (default False).
        inertial: Send inertial samples in addition to events (default True).
        region: (x, y, width, height), the pixels whose events are sent (default: all).
        activity_filter: Time in µs of the camera's background activity filter, if the camera has one; None turns it off
            (default 2,000).
        refractory_filter: Time in µs of the camera's refractory filter, if the camera has one; None turns it off
            (default None).
        exposure: Exposure of frames in µs (default 4,000).
        frame_interval: Time from frame to frame in µs (default 40,000).
        packet_delay: Time in µs after which a packet that isn't full is sent (default 1,000).
        external: Signals at the external input that are sent: "pulses", or "rising", "falling" or "both" edges (default
            "pulses").
        masked: Up to eight pixels (x, y) whose events aren't sent (default none).
        skip: Leave out one event in `skip` (default None: none is left out).
        polarity: Send "both", "on" or "off" events (default "both").
        frame_region: (x, y, width, height), the pixels that frames have (default: all).

    Raises:
        ValueError: A value is out of range. `Davis.configure` checks whether the camera supports the settings.
    """

    biases: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    frames: bool = False
    inertial: bool = True
    region: tuple[int, int, int, int] | None = None
    activity_filter: int | None = 2_000
    refractory_filter: int | None = None
    exposure: int = 4_000
    frame_interval: int = 40_000
    packet_delay: int = 1_000
    external: str = "pulses"
    masked: tuple[tuple[int, int], ...] = ()
    skip: int | None = None
    polarity: str = "both"
    frame_region: tuple[int, int, int, int] | None = None

    def __post_init__(self) -> None:
        for name in ("exposure", "frame_interval"):
            not_negative(name, getattr(self, name))
        positive("packet_delay", self.packet_delay)
        for name in ("activity_filter", "refractory_filter", "skip"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))
        for name, choices in (("external", EXTERNAL_EDGES), ("polarity", POLARITIES)):
            if getattr(self, name) not in choices:
                raise ValueError(f"{name} must be one of {', '.join(choices)}, not {getattr(self, name)!r}")
        for name in ("region", "frame_region"):
            place = getattr(self, name)
            if place is not None and (len(place) != 4 or min(place[:2]) < 0 or min(place[2:]) < 1):
                raise ValueError(f"{name} must be (x, y, width, height) with 0 <= x, y and 1 <= width, height: {place}")
        if len(self.masked) > MASKED or any(len(pixel) != 2 for pixel in self.masked):
            raise ValueError(f"masked must be at most {MASKED} pixels (x, y), not {self.masked}")
