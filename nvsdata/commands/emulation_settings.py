"""Options for the settings of emulators, for `convert-videos` and `tune`."""

from __future__ import annotations

import argparse
import json
import textwrap
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from nvsdata.commands.options import UsageError, path, usage
from nvsdata.common.errors import shown
from nvsdata.common.files import put
from nvsdata.emulation import DVS, PIX2NVS, PRESETS, SENSORS

BuiltInEmulator = PIX2NVS | DVS
EMULATORS: dict[str, type[BuiltInEmulator]] = {"pix2nvs": PIX2NVS, "dvs": DVS}
USUAL = "table-3.3-row-5"
ALL: dict[str, BuiltInEmulator] = {**PRESETS, **SENSORS}
HELP = {
    "hue": "emulate from hue, b / (r + g), in place of luminance",
    "mode": "LI: logarithm of brightness; CE: contrast to the four neighbors; LICE: logarithm of that contrast",
    "t_log": "brightness, 0 to 255, up to which the logarithm is linear",
    "gamma": "exponent of the perceptual luminance of modes CE and LICE",
    "continuous": "scale the linear part so that it meets the logarithm at t_log",
    "difference": "co-located: to the reference at the same pixel; average, minimum: of those to its neighbors",
    "inhibition": "side in pixels of the blocks in which only the largest difference fires",
    "threshold": "difference at which a pixel fires, in units of the brightness that mode gives",
    "max_events": "largest number of events of a pixel per frame",
    "timestamps": "interpolated: when the threshold is crossed; random; linear: evenly spaced; fixed: the frame's time",
    "new": "after each frame, update the reference of all pixels (true), or only of those that fired (false)",
    "exp": "compare each frame with a moving average of the frames before (true), or with the last one (false)",
    "alpha": "weight of the newest frame in that moving average, above 0 and up to 1",
    "noise_rate": "rate of background activity in Hz per pixel",
    "mismatch": "standard deviation of the pixels' thresholds, relative to the nominal ones",
    "hot_pixels": "fraction of pixels that fire without a change of light, 0 to 1",
    "hot_rate": "rate at which hot pixels fire, in Hz",
    "refractory": "time in µs after an event during which a pixel can't fire",
    "bandwidth": "events per second that the readout can pass, 0 for no limit",
    "seed": "seed of all random numbers",
    "on": "rise of the logarithm of light at which a pixel fires",
    "off": "fall of the logarithm of light at which a pixel fires",
    "dark": "gray level that is added to brightness before its logarithm",
    "upsample": "frames made between frames: none, linear, flow (along the optical flow), or a number of linear steps",
    "cutoff": "bandwidth in Hz of a white pixel's photoreceptor, 0 for no limit",
    "leak": "ON events per second and pixel that occur without a change of light",
}
PRESET_HELP = {
    "table-3.3-row-1 to -5": "PIX2NVS: the settings in the rows of Table 3.3 of the thesis; row 1 has the largest "
    "distance to recordings of a DAVIS camera, row 5 (the default) the smallest",
    "section-3.4.1": "PIX2NVS: settings of the first comparison with a camera in the thesis (section 3.4.1); "
    "events have the time of their frame",
    "footage": "PIX2NVS: for videos with dark parts, where the plain logarithm converts noise to events",
    "ideal": "DVS, the pixel model of real sensors, without noise",
    "dvs128, davis240c, davis346, gen4": "DVS: contrast, noise and readout of these sensors, as published",
}


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the options for the emulator and its settings."""
    group = parser.add_argument_group("settings of the emulator")
    base = group.add_mutually_exclusive_group()
    text = (
        f"named settings of an emulator; --settings-help lists them (default {USUAL}: PIX2NVS with the settings "
        "that were closest to a DAVIS camera in the thesis)"
    )
    base.add_argument("--preset", choices=ALL, metavar="NAME", help=text)
    text = "settings from a file such as best.json of `nvsdata tune` (default: those of the preset)"
    base.add_argument("--settings", type=path, metavar="FILE", help=text)
    text = "change a setting, such as threshold=0.3; may be repeated (default: none)"
    group.add_argument("--set", type=_pair, action="append", default=[], metavar="NAME=VALUE", help=text)
    group.add_argument("--settings-help", action=_SettingsHelp, help="list all settings and presets, and exit")


class _SettingsHelp(argparse.Action):
    """Option that prints the settings and presets, and ends the process."""

    def __init__(self, option_strings: list[str], dest: str, **more: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, **more)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        print(settings_help())
        parser.exit()


def settings_help() -> str:
    """Return the settings of each emulator with their defaults and meanings, and the presets."""
    parts = []
    for kind in EMULATORS.values():
        names = {f.name: f"{f.name} ({f.default})" for f in fields(kind)}
        rows = {names[name]: HELP[name] for name in names}
        parts.append(f"settings of {kind.__name__} and their defaults, for --set NAME=VALUE\n{_listing(rows)}")
    return "\n\n".join((*parts, f"presets, for --preset NAME\n{_listing(PRESET_HELP)}"))


def _listing(rows: dict[str, str]) -> str:
    """Return names, and next to each its text, wrapped to lines of 100 columns."""
    width = max(map(len, rows)) + 4
    return "\n".join(
        textwrap.fill(text, 100, initial_indent=f"  {name}".ljust(width), subsequent_indent=" " * width)
        for name, text in rows.items()
    )


def _values(kind: type[BuiltInEmulator], name: str) -> str:
    """Describe the values that a setting may have."""
    hint = get_type_hints(kind)[name]
    if name == "upsample":
        return "none, linear, flow or a number"
    if get_origin(hint) is Literal:
        return " or ".join(get_args(hint))
    return {bool: "true or false", int: "a whole number", float: "a number"}[hint]


def _pair(text: str) -> tuple[str, str]:
    """Split NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, such as threshold=0.3, not {text!r}")
    return name, value


def emulator_from(args: argparse.Namespace) -> BuiltInEmulator:
    """Return the emulator that the options select: a preset's or a file's, with the changes of --set."""
    base = read_settings(args.settings) if args.settings else ALL[args.preset or USUAL]
    with usage():
        return replace(base, **changes_of(args, base))


def changes_of(args: argparse.Namespace, base: BuiltInEmulator) -> dict[str, Any]:
    """Return the settings that --set changes; UsageError for one that the emulator `base` doesn't have."""
    return {name: _value(type(base), name, text) for name, text in args.set}


def _value(kind: type[BuiltInEmulator], name: str, text: str) -> Any:
    """Convert the text of a setting to its type; the emulator checks the range."""
    hint = get_type_hints(kind).get(name) if name in {field.name for field in fields(kind)} else None
    if hint is None:
        raise UsageError(f"--set {name}: {kind.__name__} has no such setting; --settings-help lists them")
    if hint is bool and text.lower() in ("true", "false"):
        return text.lower() == "true"
    if name == "upsample":
        return int(text) if text.isdecimal() else text
    try:
        return hint(text) if hint in (int, float) else _choice(hint, text)
    except ValueError:
        raise UsageError(f"--set {name}: must be {_values(kind, name)}, not {text!r}") from None


def _choice(hint: Any, text: str) -> str:
    if hint is bool or text not in get_args(hint):
        raise ValueError
    return text


def write_settings(settings: BuiltInEmulator, path: Path) -> None:
    """Write settings as JSON, for `--settings`."""
    name = next(name for name, kind in EMULATORS.items() if type(settings) is kind)
    put(path, (json.dumps({f"nvsdata-{name}": 1, **asdict(settings)}, indent=1) + "\n").encode(), through_link=True)


def read_settings(path: Path) -> BuiltInEmulator:
    """Read the settings that `write_settings` wrote.

    Raises:
        ValueError: The file isn't one of `write_settings`, or a setting is out of range.
    """
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
