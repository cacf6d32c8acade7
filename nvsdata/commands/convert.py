"""`nvsdata convert`: a recording in another format."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from nvsdata.commands.options import add_json, path, sensor_size, usage
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell

if TYPE_CHECKING:
    from nvsdata.data.events import Events
    from nvsdata.data.recording import Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("source", type=path, metavar="IN", help="a recording")
    add("target", type=path, metavar="OUT", help="its extension names the format")
    add(
        "--format",
        metavar="NAME",
        help="where an extension has several: evt2, evt2.1 or evt3 (default) for .raw; hdf5-gzip for .h5",
    )
    add("--sensor-size", type=sensor_size, metavar="WxH", help="in pixels, where the file doesn't state it")
    add("--repair", action="store_true", help="drop what is damaged instead of stopping at it")
    add("--overwrite", action="store_true", help="replace OUT if it is there")
    add_json(add)


def _watched(recording: Recording) -> Iterator[Events]:
    """The recording's pieces; of a long one whose time is known, a bar tells after a second how much of it is done."""
    from nvsdata.common.progress import bar
    from nvsdata.formats.file_recording import LONG

    if os.path.getsize(recording.path) <= LONG or not recording.knows_span:
        yield from recording.pieces()
        return
    first, last = recording.start, recording.end
    with bar(None, "converting", total=100, unit="%", delay=1) as shown:
        for piece in recording.pieces():
            yield piece
            shown.update(round(100 * (piece.end - first) / max(last - first, 1)) - shown.n)


def run(args: argparse.Namespace) -> int:
    """Write the recording, and say what was repaired."""
    from nvsdata import formats
    from nvsdata.common.files import creating

    with usage():
        formats.writer_of(args.target, args.format)
    with creating(args.target, overwrite=args.overwrite):
        recording = formats.open(args.source, sensor_size=args.sensor_size, strict=not args.repair)
        lost = formats.left_out(recording, args.target, args.format)
        if lost:
            print(f"{shown(args.target)} can't hold everything: {' and '.join(lost)} are left out", file=sys.stderr)
        written = formats.write(_watched(recording), args.target, format=args.format)
        if args.source == args.target.with_name(f"{args.target.name}.davis") and not (recording.repairs or lost):
            # IN is OUT's journal, and OUT is whole now
            args.source.unlink()
    for what, count in recording.repairs.items():
        print(f"{shown(args.source)}: {count} {what}", file=sys.stderr)
    facts = {"events": written, "out": args.target, "repairs": recording.repairs, "left_out": lost}
    tell(f"{written:,} events in {shown(args.target)}", facts, as_json=args.json)
    return 0
