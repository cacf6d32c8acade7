"""What is in a file of events, in words."""

from __future__ import annotations

from pathlib import Path

from nvsdata import formats
from nvsdata.common.errors import shown


def describe(path: Path) -> str:
    """A few lines about the recording: format, sensor, events, times, rate, polarity and anomalies.

    Raises FormatError or FileNotFoundError if it can't be read.
    """
    recording = formats.open(path)
    events = recording.read()
    width, height = recording.sensor_size
    lines = [
        shown(path),
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
