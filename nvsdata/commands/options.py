"""Options and types of options that several commands share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nvsdata.remote.url import Url, place_of


class UsageError(ValueError):
    """Wrong combination of options; the command ends with exit code 2, as for unknown options."""


class Help(argparse.HelpFormatter):
    """Formatter of help that adds the default of each option."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = action.help
        default = action.default
        stated = default is None or default is False or default == [] or default == argparse.SUPPRESS
        if text is None or stated or not action.option_strings or "(default" in text:
            return text
        return f"{text} (default %(default)s)"


def path(text: str) -> Path:
    """Parse a path, and expand ~, which shells don't do in `--out=~/folder`."""
    return Path(text).expanduser()


def path_or_url(text: str) -> Path | Url:
    """Parse a path, with ~ expanded, or a URL: a text with "://"."""
    return place_of(text)


def sensor_size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT.

    Example:
        >>> sensor_size("240x180")
        (240, 180)
    """
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 240x180, not {text!r}")
    return int(width), int(height)


def at_least_1(text: str) -> int:
    """Parse a whole number of at least 1."""
    if not (text.isdecimal() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"must be at least 1, not {text}")
    return int(text)


def positive(text: str) -> float:
    """Parse a finite number above 0."""
    value = _number(text)
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"must be positive, not {text}")
    return value


def not_negative(text: str) -> float:
    """Parse a finite number of at least 0."""
    value = _number(text)
    if not (value >= 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"must be at least 0, not {text}")
    return value


def fraction(text: str) -> float:
    """Parse a number of at least 0 and below 1."""
    value = _number(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 0 and below 1, not {text}")
    return value


@contextmanager
def usage() -> Iterator[None]:
    """Convert a ValueError in the block to a UsageError: the values of options are wrong."""
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
    """Return the class of a dataset by its name."""
    from nvsdata.datasets import dataset_named

    try:
        return dataset_named(name)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_json(add: Callable[..., Any], what: str = "the result as a line of JSON") -> None:
    """Add the option `--json`."""
    add("--json", action="store_true", help=f"print {what}")


def add_jobs(add: Callable[..., Any], what: str, default: int = 1) -> None:
    """Add the option `--jobs` for a number of processes or threads."""
    add("--jobs", type=at_least_1, default=default, metavar="N", help=what)


def add_workers(add: Callable[..., Any], what: str) -> None:
    """Add the options `--jobs` and `--scheduler` of commands that do `what` with many recordings."""
    add_jobs(add, f"number of processes that {what}")
    add(
        "--scheduler", metavar="ADDRESS", help=f"{what} on the Dask cluster at this address (default: on this computer)"
    )


def shard(text: str) -> tuple[int, int]:
    """Parse I/N: the number of a part, from 1 on, and the number of parts.

    Example:
        >>> shard("2/8")
        (2, 8)
    """
    part, _, parts = text.partition("/")
    if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise argparse.ArgumentTypeError(f"must be I/N, such as 1/8 to 8/8, not {text!r}")
    return int(part), int(parts)


def add_videos(add: Callable[..., Any]) -> None:
    """Add the options that all commands for a folder of videos share."""
    from nvsdata.batch.folder import FORMATS

    add("--format", choices=FORMATS, default="hdf5", help="format of the recordings")
    add("--limit", type=at_least_1, metavar="N", help="the first N videos only (default: all)")
