"""The `nvsdata view` command: a recording as a page, an image or a film."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsdata.commands.options import at_least_1, path, positive, sensor_size, usage
from nvsdata.common.errors import shown
from nvsdata.common.terminal import remark

if TYPE_CHECKING:
    from nvsdata.data.events import Events
    from nvsdata.data.recording import Recording

LARGE = 50_000_000  # bytes; larger pages are slow to open
KINDS = ".html", ".png", ".gif", ".mp4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("file", type=path, metavar="FILE", help="a recording in any format")
    add(
        "out",
        nargs="?",
        type=path,
        metavar="OUT",
        help="file to write: a page with a player (.html), a sheet of moments (.png) or a film (.gif, .mp4) "
        "(default: FILE's name with .html, in the current folder)",
    )
    add("--start", type=int, metavar="US", help="start time in µs from the recording's first event (default: 0)")
    add("--stop", type=int, metavar="US", help="stop time in µs from the recording's first event (default: end)")
    add("--duration", type=at_least_1, metavar="US", help="time that an image shows, in µs (default: 33333)")
    add(
        "--events",
        type=at_least_1,
        metavar="N",
        help="number of events that an image shows (default: those of --duration)",
    )
    add("--speed", type=positive, metavar="X", default=1.0, help="speed of a film; 0.1 is a tenth of real time")
    add("--fps", type=positive, metavar="N", default=30.0, help="frames per second of a film")
    add(
        "--zoom",
        type=at_least_1,
        metavar="N",
        help="size of a pixel in a film (default: the film is about 480 pixels wide)",
    )
    add("--sensor-size", type=sensor_size, metavar="WxH", help="sensor size in pixels, for files that don't state it")
    add("--overwrite", action="store_true", help="replace OUT if it exists")


def run(args: argparse.Namespace) -> int:
    """Write the page, image or film."""
    from nvsdata import formats
    from nvsdata.common.files import creating
    from nvsdata.plots.films import Film

    out = args.out or Path(f"{args.file.name}.html")
    with usage():
        if out.suffix.lower() not in KINDS:
            raise ValueError(f"OUT must end in one of {', '.join(KINDS)}, not {out.suffix!r}")
        film = Film(args.duration or Film.duration, args.events, args.speed, args.fps, args.zoom)
    recording = formats.open(args.file, sensor_size=args.sensor_size)
    events = part_of(recording, args.start, args.stop)
    origin = None if args.start is None else recording.span[0]
    with creating(out, overwrite=args.overwrite):
        save_view(out, args.file.name, recording, events, film, args.duration, origin)
    print(f"{len(events):,} events in {shown(out)}, {out.stat().st_size / 1e6:,.1f} MB")
    return 0


def part_of(recording: Recording, start: int | None, stop: int | None) -> Events:
    """Return the events of a part of a recording, and warn if the part ends after the recording.

    Args:
        recording: The recording.
        start: Start time in µs from the first event (None: beginning).
        stop: Stop time in µs from the first event (None: end).

    Raises:
        ValueError: If the part is before the first or after the last event.
    """
    if start is None and stop is None:
        return recording.read()
    first, last = recording.span
    events = recording.read(*(None if bound is None else first + bound for bound in (start, stop)))
    length = last - first
    span = f"the recording's events are at 0 to {length} µs; --start and --stop count from the first event"
    if length and ((stop is not None and stop <= 0) or (start is not None and start > length)):
        window = f"[{'' if start is None else start}, {'' if stop is None else stop})"
        raise ValueError(f"{shown(recording.path)}: the window {window} has no events; {span}")
    if length and stop is not None and stop > length + 1:
        warnings.warn(f"{shown(recording.path)}: --stop {stop} is after the last event; {span}", stacklevel=2)
    return events


def save_view(
    out: Path, name: str, recording: Any, events: Any, film: Any, window: int | None, origin: int | None
) -> None:
    """Write a page, an image or a film, according to the extension.

    Args:
        out: File to write.
        name: Title of a page.
        recording: Recording of the events, whose frames a page shows, too.
        events: Events to show.
        film: Settings of the film or the sheet.
        window: Length of the player's window in µs (None: default of the player).
        origin: Time in µs that the player shows as 0 (None: that of the first of `events`).
    """
    from nvsdata.common.files import put
    from nvsdata.plots.drawing import save_png
    from nvsdata.plots.films import save_gif, save_mp4
    from nvsdata.plots.page import player_page

    kind = out.suffix.lower()
    if kind == ".html":
        frames = recording.frames(events.start, events.end + 1) if recording.holds_samples else ()
        page = player_page(events, name, frames, window, origin).encode()
        if len(page) > LARGE:
            remark(f"writing a page of {len(page) / 1e6:,.0f} MB: --start and --stop select a part of the recording")
        put(out, page, through_link=True)
    elif kind == ".png":
        save_png(film.sheet(events), out)
    else:
        (save_gif if kind == ".gif" else save_mp4)(film.images(events), out, film.fps)
