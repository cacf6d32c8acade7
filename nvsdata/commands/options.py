"""Types of options and format of help that several commands share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class UsageError(ValueError):
    """Options that don't go together; the command ends with exit code 2, as for options that don't exist."""


class Help(argparse.HelpFormatter):
    """States the default of each option that has one, after its help."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = action.help
        default = action.default
        stated = default is None or default is False or default == [] or default == argparse.SUPPRESS
        if text is None or stated or not action.option_strings or "(default" in text:
            return text
        return f"{text} (default %(default)s)"


def path(text: str) -> Path:
    """A path; the shell leaves the ~ of --out=~/folder to the program."""
    return Path(text).expanduser()


def sensor_size(text: str) -> tuple[int, int]:
    """Width and height."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 240x180, not {text!r}")
    return int(width), int(height)


def at_least_1(text: str) -> int:
    """A whole number above zero."""
    if not (text.isdecimal() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"must be at least 1, not {text}")
    return int(text)


def positive(text: str) -> float:
    """A number above zero."""
    value = _number(text)
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"must be positive, not {text}")
    return value


def not_negative(text: str) -> float:
    """A number that is zero or above."""
    value = _number(text)
    if not (value >= 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"must be at least 0, not {text}")
    return value


def share(text: str) -> float:
    """A number from 0 on that is below 1."""
    value = _number(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 0 and below 1, not {text}")
    return value


@contextmanager
def usage() -> Iterator[None]:
    """Treat a ValueError in the block, which makes settings of options, as wrong usage."""
    try:
        yield
    except ValueError as error:
        raise UsageError(str(error)) from None


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number, not {text!r}") from None


def dataset(name: str) -> Any:
    """A dataset's class by its name."""
    from nvsdata.datasets import dataset_named

    try:
        return dataset_named(name)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_json(add: Callable[..., Any], what: str = "the result as a line of JSON") -> None:
    """Add the option for results that programs read."""
    add("--json", action="store_true", help=f"print {what}")


def add_jobs(add: Callable[..., Any], what: str, default: int = 1) -> None:
    """Add the option for the number of processes or threads."""
    add("--jobs", type=at_least_1, default=default, metavar="N", help=what)


def shard(text: str) -> tuple[int, int]:
    """A part of a whole, counted from 1, and how many parts there are."""
    part, _, parts = text.partition("/")
    if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise argparse.ArgumentTypeError(f"must be I/N, such as 1/8 to 8/8, not {text!r}")
    return int(part), int(parts)


def add_videos(add: Callable[..., Any]) -> None:
    """Add the options that all commands with a folder of videos have."""
    from nvsdata.batch.folder import FORMATS

    add("--format", choices=FORMATS, default="hdf5", help="format of the recordings")
    add("--limit", type=at_least_1, metavar="N", help="the first N videos only (default: all)")
