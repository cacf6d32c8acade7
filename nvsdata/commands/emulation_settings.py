"""Options for the settings of emulators, which `convert-videos` and `tune` have."""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection, Iterator
from dataclasses import Field, asdict, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from nvsdata.commands.options import UsageError, path, usage
from nvsdata.common.errors import shown
from nvsdata.common.files import put
from nvsdata.emulation import DVS, PIX2NVS, PRESETS, SENSORS

BuiltInEmulator = PIX2NVS | DVS
EMULATORS: dict[str, type[BuiltInEmulator]] = {"pix2nvs": PIX2NVS, "dvs": DVS}
USUAL = {"pix2nvs": "table-3.3-row-5", "dvs": "ideal"}  # the preset of each
ALL: dict[str, BuiltInEmulator] = {**PRESETS, **SENSORS}
# in the words of Table 3.1
HELP = {
    "hue": "see hue, b / (r + g), in place of luminance",
    "mode": "brightness as logarithm (LI), contrast to the neighbors (CE), or the logarithm of that (LICE)",
    "t_log": "brightness, 0 to 255, up to which the logarithm is linear",
    "gamma": "exponent of the perceptual luminance of CE and LICE",
    "continuous": "scale the linear part so that it meets the logarithm at t_log",
    "difference": "to the reference at the same place, the average of its four neighbors, or the minimum of two",
    "inhibition": "side in pixels of the blocks in which only the largest difference fires",
    "threshold": "difference at which a pixel fires, in units of the brightness that --mode gives",
    "max_events": "most events of a pixel per frame",
    "timestamps": "events at the crossing of the threshold, at random, evenly spread, or at the frame's time",
    "new": "update the reference of all pixels, not of those alone that fired",
    "exp": "remember a moving average of the frames, not the last one",
    "alpha": "share of the newest frame in the moving average, above 0 and up to 1",
    "noise_rate": "background activity in Hz per pixel",
    "mismatch": "standard deviation of the pixels' thresholds, relative to the nominal ones",
    "hot_pixels": "share of pixels that fire by themselves, 0 to 1",
    "hot_rate": "how often hot pixels fire, in Hz",
    "refractory": "µs for which a pixel is blind after an event",
    "bandwidth": "events per second that the readout can pass, 0 for any number",
    "seed": "seed of all that is random",
    "on": "rise of the logarithm of light at which a pixel fires",
    "off": "fall of the logarithm of light at which a pixel fires",
    "dark": "gray level that is added to brightness before its logarithm",
    "upsample": "frames between frames: linear, flow (of what moves), a number, or none",
    "cutoff": "bandwidth in Hz of a white pixel's photoreceptor, 0 for one that follows at once",
    "leak": "ON events per s and pixel that come without light",
}


def add_settings(
    parser: argparse.ArgumentParser, *, skip: Collection[str] = (), searched: Collection[str] = ()
) -> None:
    """Add an option per setting, except those to skip."""
    group = parser.add_argument_group("settings of the emulator", "each replaces what the preset says")
    base = group.add_mutually_exclusive_group()
    base.add_argument(
        "--preset",
        choices=ALL,
        help="rows of Table 3.3, section 3.4.1, footage with dark parts; sensors for dvs "
        f"(default: {USUAL['pix2nvs']}; {USUAL['dvs']} for dvs)",
    )
    base.add_argument("--settings", type=path, metavar="FILE", help="best.json of `nvsdata tune` (default: the preset)")
    group.add_argument(
        "--emulator", choices=EMULATORS, help="PIX2NVS, or the pixel of real sensors (default: the preset's; pix2nvs)"
    )
    for name, field, owners in _options():
        if name in skip:
            continue
        kind = get_type_hints(EMULATORS[owners[0]])[name]
        options: dict[str, Any] = {"type": _upsample if name == "upsample" else kind}
        if kind is bool:
            options = {"action": argparse.BooleanOptionalAction}
        elif get_origin(kind) is Literal:
            options = {"choices": get_args(kind)}
        default = "searched" if name in searched else field.default
        only = "" if len(owners) > 1 else f"{owners[0]}: "
        text = f"{only}{HELP[name]} (default {default})"
        group.add_argument(f"--{name.replace('_', '-')}", **options, default=argparse.SUPPRESS, help=text)


def _options() -> Iterator[tuple[str, Field[Any], list[str]]]:
    """Each setting's name and field, and which emulators have it."""
    found: dict[str, tuple[Field[Any], list[str]]] = {}
    for emulator, kind in EMULATORS.items():
        for field in fields(kind):
            found.setdefault(field.name, (field, []))[1].append(emulator)
    return ((name, *rest) for name, rest in found.items())


def _upsample(text: str) -> int | str:
    return int(text) if text.isdecimal() else text


def emulator_from(args: argparse.Namespace) -> BuiltInEmulator:
    """The preset or the file's settings, with those that were given in place of its own."""
    preset = args.preset or USUAL[args.emulator or "pix2nvs"]
    base = read_settings(args.settings) if args.settings else ALL[preset]
    if args.emulator and type(base) is not EMULATORS[args.emulator]:
        raise UsageError(f"--emulator {args.emulator}: {args.settings or preset} is of {type(base).__name__}")
    with usage():
        return replace(base, **given(args, base))


def write_settings(settings: BuiltInEmulator, path: Path) -> None:
    """Write settings as JSON, for `--settings`."""
    name = next(name for name, kind in EMULATORS.items() if type(settings) is kind)
    put(path, (json.dumps({f"nvsdata-{name}": 1, **asdict(settings)}, indent=1) + "\n").encode(), through_link=True)


def read_settings(path: Path) -> BuiltInEmulator:
    """The settings that `write_settings` wrote; ValueError for another file, and for settings out of range."""
    try:
        content = json.loads(path.read_text("utf-8"))
        for name, kind in EMULATORS.items():
            version = content.pop(f"nvsdata-{name}", None)
            if version == 1:
                return kind(**content)
            if version is not None:
                raise ValueError("of another version")
        raise ValueError("of no emulator")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{shown(path)}: not the settings that `nvsdata tune` writes: {error}") from None


def given(args: argparse.Namespace, base: BuiltInEmulator) -> dict[str, Any]:
    """The settings that were given; UsageError for those that this emulator doesn't have."""
    found = {name: getattr(args, name) for name, *_ in _options() if hasattr(args, name)}
    own = {field.name for field in fields(base)}
    for name in found:
        if name not in own:
            raise UsageError(f"{type(base).__name__} has no --{name.replace('_', '-')}")
    return found
