"""The `nvsdata view` command: a recording as a page, an image or a film."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from nvsdata.commands.options import at_least_1, path, positive, sensor_size, usage
from nvsdata.common.errors import shown

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
    add("--start", type=int, metavar="US", help="start time in µs, as `nvsdata info` prints it (default: beginning)")
    add("--stop", type=int, metavar="US", help="stop time in µs (default: end)")
    add("--relative", action="store_true", help="count --start and --stop from the first event")
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
    from nvsdata.formats.reading import outside
    from nvsdata.plots.films import Film

    out = args.out or Path(f"{args.file.name}.html")
    with usage():
        if out.suffix.lower() not in KINDS:
            raise ValueError(f"OUT must end in one of {', '.join(KINDS)}, not {out.suffix!r}")
        film = Film(args.duration or Film.duration, args.events, args.speed, args.fps, args.zoom)
    recording = formats.open(args.file, sensor_size=args.sensor_size)
    start, stop = (
        bound if bound is None or not args.relative else recording.span[0] + bound for bound in (args.start, args.stop)
    )
    events = recording.read(start, stop)
    if not len(events) and (fault := outside(recording, start, stop)):
        raise ValueError(fault if args.relative else f"{fault}; --relative counts from the first")
    with creating(out, overwrite=args.overwrite):
        save_view(out, args.file.name, recording, events, film, args.duration)
    print(f"{len(events):,} events in {shown(out)}")
    return 0


def save_view(out: Path, name: str, recording: Any, events: Any, film: Any, window: int | None) -> None:
    """Write a page, an image or a film, according to the extension.

    Args:
        out: File to write.
        name: Title of a page.
        recording: Recording of the events, whose frames a page shows, too.
        events: Events to show.
        film: Settings of the film or the sheet.
        window: Length of the player's window in µs (None: default of the player).
    """
    from nvsdata.common.files import put
    from nvsdata.plots.drawing import save_png
    from nvsdata.plots.films import save_gif, save_mp4
    from nvsdata.plots.page import player_page

    kind = out.suffix.lower()
    if kind == ".html":
        frames = recording.frames(events.start, events.end + 1) if recording.holds_samples else ()
        put(out, player_page(events, name, frames, window).encode(), through_link=True)
    elif kind == ".png":
        save_png(film.sheet(events), out)
    else:
        (save_gif if kind == ".gif" else save_mp4)(film.images(events), out, film.fps)
