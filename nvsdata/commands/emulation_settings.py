"""Options for the settings of PIX2NVS, which `convert-videos` and `tune` have."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from dataclasses import fields, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from nvsdata.commands.options import usage
from nvsdata.emulation import PIX2NVS, PRESETS

PRESET = "table-3.3-row-5"
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
    group.add_argument("--preset", choices=PRESETS, default=PRESET, help="rows of Table 3.3, or section 3.4.1")
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
    """The preset, with the settings that were given in place of its own."""
    with usage():
        return replace(PRESETS[args.preset], **given(args))


def given(args: argparse.Namespace) -> dict[str, Any]:
    """The settings that were given."""
    return {field.name: getattr(args, field.name) for field in fields(PIX2NVS) if hasattr(args, field.name)}
