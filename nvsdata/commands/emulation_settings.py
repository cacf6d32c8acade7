"""Options for the settings of PIX2NVS, which `convert-videos` and `tune` have."""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from nvsdata.commands.options import path, usage
from nvsdata.common.errors import shown
from nvsdata.common.files import put
from nvsdata.emulation import PIX2NVS, PRESETS

PRESET = "table-3.3-row-5"
FORMAT = "nvsdata-pix2nvs"
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
    "mismatch": "standard deviation of the pixels' thresholds, relative to --threshold",
    "hot_pixels": "share of pixels that fire by themselves, 0 to 1",
    "hot_rate": "how often hot pixels fire, in Hz",
    "refractory": "µs for which a pixel is blind after an event",
    "bandwidth": "events per second that the readout can pass, 0 for any number",
    "seed": "seed of all that is random",
}


def add_settings(
    parser: argparse.ArgumentParser, *, skip: Collection[str] = (), searched: Collection[str] = ()
) -> None:
    """Add an option per setting, except those to skip."""
    group = parser.add_argument_group("settings of PIX2NVS", "each replaces what the preset says")
    base = group.add_mutually_exclusive_group()
    base.add_argument(
        "--preset", choices=PRESETS, default=PRESET, help="rows of Table 3.3, section 3.4.1, or footage with dark parts"
    )
    base.add_argument("--settings", type=path, metavar="FILE", help="best.json of `nvsdata tune` (default: the preset)")
    kinds = get_type_hints(PIX2NVS)
    for field in fields(PIX2NVS):
        if field.name in skip:
            continue
        kind = kinds[field.name]
        options: dict[str, Any] = {"type": kind}
        if kind is bool:
            options = {"action": argparse.BooleanOptionalAction}
        elif get_origin(kind) is Literal:
            options = {"choices": get_args(kind)}
        default = "searched" if field.name in searched else getattr(PRESETS[PRESET], field.name)
        text = f"{HELP[field.name]} (default {default})"
        group.add_argument(f"--{field.name.replace('_', '-')}", **options, default=argparse.SUPPRESS, help=text)


def settings_of(args: argparse.Namespace) -> PIX2NVS:
    """The preset or the file's settings, with those that were given in place of its own."""
    base = read_settings(args.settings) if args.settings else PRESETS[args.preset]
    with usage():
        return replace(base, **given(args))


def write_settings(settings: PIX2NVS, path: Path) -> None:
    """Write settings as JSON, for `--settings`."""
    put(path, (json.dumps({FORMAT: 1, **asdict(settings)}, indent=1) + "\n").encode())


def read_settings(path: Path) -> PIX2NVS:
    """The settings that `write_settings` wrote; ValueError for another file, and for settings out of range."""
    try:
        content = json.loads(path.read_text("utf-8"))
        if content.pop(FORMAT) != 1:
            raise ValueError("of another version")
        return PIX2NVS(**content)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{shown(path)}: not the settings of PIX2NVS that `nvsdata tune` writes: {error}") from None


def given(args: argparse.Namespace) -> dict[str, Any]:
    """The settings that were given."""
    return {field.name: getattr(args, field.name) for field in fields(PIX2NVS) if hasattr(args, field.name)}
