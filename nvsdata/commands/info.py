"""The `nvsdata info` command: facts about recordings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from nvsdata import formats
from nvsdata.commands.options import add_json, path
from nvsdata.common.errors import message_of, shown
from nvsdata.common.terminal import tell

GUESSED = (
    ", guessed from the events: the file doesn't state it\n"
    "             state it by `nvsdata convert --sensor-size WxH` or `nvsdata.read(path, sensor_size=(W, H))`"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("files", nargs="+", metavar="FILE", type=path, help="recordings in any format")
    add_json(parser.add_argument, "a line of JSON for each file")


def run(args: argparse.Namespace) -> int:
    """Describe each file; return 1 if one can't be read."""
    code = 0
    for file in args.files:
        try:
            facts = recording_facts(file)
        except (OSError, ValueError, ImportError) as error:
            print(message_of(error), file=sys.stderr)
            code = 1
        else:
            tell(describe(facts), facts, as_json=args.json)
    return code


def recording_facts(file: Path) -> dict[str, Any]:
    """Return the facts of a recording by name: format, sensor size, number of events, times, fraction of ON, anomalies.

    Times are in µs. `size_is_guessed` is True if the file states no sensor size.

    Args:
        file: The recording.

    Raises:
        FormatError: It can't be read.
        FileNotFoundError: There is no such file.
    """
    recording = formats.open(file)
    anomalies = recording.anomalies()
    events = recording.read()
    some = len(events) > 0
    return {
        "file": str(file),
        "format": recording.format,
        "sensor_size": recording.sensor_size,
        "size_is_guessed": recording.size_is_guessed,
        "events": len(events),
        "first": int(events.t[0]) if some else None,
        "last": int(events.t[-1]) if some else None,
        "on": float(events.p.mean()) if some else None,
        "anomalies": {what: count for what, count in anomalies.items() if count},
    }


def describe(facts: dict[str, Any]) -> str:
    """Return a description of a recording in several lines, from its facts."""
    lines = [
        shown(facts["file"]),
        f"  format     {facts['format']}",
        "  sensor     {}x{}".format(*facts["sensor_size"]) + (GUESSED if facts["size_is_guessed"] else ""),
        f"  events     {facts['events']:,}",
    ]
    if facts["events"]:
        seconds = (facts["last"] - facts["first"]) / 1e6
        rate = f"{facts['events'] / seconds:,.0f} events/s" if seconds else "all at one time"
        lines += [
            f"  time       {facts['first']} to {facts['last']} µs ({seconds:.6f} s)",
            f"  rate       {rate}",
            f"  polarity   {facts['on']:.1%} ON",
        ]
    found = [f"{count:,} {what}" for what, count in facts["anomalies"].items()]
    lines.append(f"  anomalies  {', '.join(found) or 'none'}")
    return "\n".join(lines)
