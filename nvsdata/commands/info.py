"""`nvsdata info`: what is in files of events."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from nvsdata import formats
from nvsdata.commands.options import path
from nvsdata.common.errors import shown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("files", nargs="+", metavar="FILE", type=path, help="recordings in any format")


def run(args: argparse.Namespace) -> int:
    """Describe each file: 1 if one can't be read."""
    code = 0
    for file in args.files:
        try:
            text = describe(file)
        except (OSError, ValueError) as error:
            print(error, file=sys.stderr)
            code = 1
        else:
            print(text)
    return code


def describe(file: Path) -> str:
    """A few lines about the recording: format, sensor, events, times, rate, polarity and anomalies.

    Raises FormatError or FileNotFoundError if it can't be read.
    """
    recording = formats.open(file)
    events = recording.read()
    width, height = recording.sensor_size
    lines = [
        shown(file),
        f"  format     {recording.format}",
        f"  sensor     {width}x{height}",
        f"  events     {len(events):,}",
    ]
    if len(events):
        seconds = events.duration / 1e6
        rate = f"{len(events) / seconds:,.0f} events/s" if seconds else "all at one time"
        lines += [
            f"  time       {events.t[0]} to {events.t[-1]} µs ({seconds:.6f} s)",
            f"  rate       {rate}",
            f"  polarity   {events.p.mean():.1%} ON",
        ]
    found = [f"{count:,} {what}" for what, count in recording.anomalies().items() if count]
    lines.append(f"  anomalies  {', '.join(found) or 'none'}")
    return "\n".join(lines)
