"""Diagnostics: a check of the requirements of a recording (libusb, permission, firmware, display, disk)."""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from nvsdata.recording.camera import CameraError
from nvsdata.recording.capture import RESERVE
from nvsdata.recording.davis.driver import BOARDS, UDEV, VENDOR, Davis, devices

LIBUSB = {
    "linux": "install libusb-1.0 (Debian and Ubuntu: apt install libusb-1.0-0; Fedora: dnf install libusb1)",
    "darwin": "brew install libusb",
    "win32": "put libusb-1.0.dll into a folder of PATH (pip install libusb-package installs one)",
}
ZADIG = "on Windows, run Zadig, choose the camera, and install the driver WinUSB for it"
USUAL = 1e9  # bytes of the disk that a minute of recording may take
PYGAME = "--live, --monitor and --calibrate need it: pip install 'nvsdata[monitor]'"


class Finding(NamedTuple):
    """Result of the check of one requirement.

    Args:
        what: Name of the requirement.
        found: Result of the check.
        cure: Remedy, None if none is needed.
        needed: False if the requested recording is possible without this requirement.
    """

    what: str
    found: str
    cure: str | None = None
    needed: bool = True

    @property
    def missing(self) -> bool:
        """True if something must be done before a recording."""
        return self.needed and self.cure is not None


def examine(backend: Any = None, *, screen: bool = False, folder: Path | None = None) -> Iterator[Finding]:
    """Check all requirements of a recording.

    Args:
        backend: Backend of pyusb (default: the one that pyusb finds).
        screen: The recording shows windows or videos; their requirements are otherwise optional (default False).
        folder: Folder of the recording (default: the current folder).
    """
    try:
        connected = devices(backend)
    except CameraError:
        yield Finding("libusb", "isn't installed", LIBUSB.get(sys.platform, LIBUSB["linux"]))
    else:
        yield Finding("libusb", "found")
        yield from _cameras(connected)
    if importlib.util.find_spec("pygame") is None:
        yield Finding("pygame-ce", "isn't installed", PYGAME, needed=screen)
    else:
        yield Finding("pygame-ce", "found")
    wanted = (folder or Path()).absolute()
    place = next(path for path in (wanted, *wanted.parents) if path.exists())
    free = shutil.disk_usage(place).free
    cure = "a minute of recording may take 1 GB: free disk space, or record to another disk"
    yield Finding("disk", f"{free / 1e9:,.1f} GB are free in {place}", None if free > USUAL else cure, free < RESERVE)


def _cameras(connected: list[Any]) -> Iterator[Finding]:
    if not connected:
        products = ", ".join(f"{VENDOR:04x}:{product:04x}" for product in BOARDS)
        cure = f"plug one in (USB {products}), or try another cable or port, without a hub"
        yield Finding("camera", "none is connected", _also(cure))
    opened = [_opened(device) for device in connected]
    if sys.platform == "linux" and connected:
        rules = [path for path in _rules() if _names_it(path)]
        cure = f"put this line into /etc/udev/rules.d/65-davis.rules: {UDEV}"
        needed = not rules and any(one.cure for one in opened)
        yield Finding("udev rule", ", ".join(map(str, rules)) or "no rule names the camera", cure if needed else None)
    yield from opened


def _opened(device: Any) -> Finding:
    """Open and close a camera, and return the finding."""
    try:
        with Davis(device) as camera:
            facts, firmware = camera.facts, device.bcdDevice & 0xFF
    except CameraError as error:
        found, *cure = re.split("[;:] ", str(error), maxsplit=1)
        return Finding("camera", found, _also("".join(cure) or "plug it in again"))
    size = f"{facts.width}x{facts.height}"
    return Finding("camera", f"{facts.name} {facts.serial}, {size}, {facts.board} with firmware {firmware}")


def _also(cure: str) -> str:
    return f"{cure}; {ZADIG}" if sys.platform == "win32" else cure


def _names_it(rules: Path) -> bool:
    with suppress(OSError):
        return f"{VENDOR:04x}" in rules.read_text("utf-8", "replace").lower()
    return False


def _rules() -> Iterator[Path]:
    for folder in ("/etc/udev/rules.d", "/lib/udev/rules.d", "/usr/lib/udev/rules.d"):
        with suppress(OSError):
            yield from sorted(Path(folder).glob("*.rules"))
