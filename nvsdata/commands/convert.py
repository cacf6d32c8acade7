"""The `nvsdata convert` command: a recording in another format."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from nvsdata.commands.options import add_json, path, sensor_size, usage
from nvsdata.common.errors import shown
from nvsdata.common.terminal import remark, tell

if TYPE_CHECKING:
    from nvsdata.data.events import Events
    from nvsdata.data.recording import Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("source", type=path, metavar="IN", help="a recording")
    add("target", type=path, metavar="OUT", help="file to write; its extension selects the format")
    add(
        "--format",
        metavar="NAME",
        help="format for an extension with several: evt2, evt2.1 or evt3 (default) for .raw; hdf5-gzip for .h5",
    )
    add("--sensor-size", type=sensor_size, metavar="WxH", help="sensor size in pixels, for files that don't state it")
    add("--repair", action="store_true", help="skip damaged parts of IN instead of stopping there")
    add("--overwrite", action="store_true", help="replace OUT if it exists")
    add_json(add)


def _watched(recording: Recording) -> Iterator[Events]:
    """Yield the pieces of a recording; for a long one with a known time span, show a progress bar after a second."""
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
    """Convert the recording, and print the number of repairs."""
    from nvsdata import formats
    from nvsdata.common.files import creating

    with usage():
        formats.writer_of(args.target, args.format)
    with creating(args.target, overwrite=args.overwrite):
        recording = formats.open(args.source, sensor_size=args.sensor_size, strict=not args.repair)
        lost = formats.left_out(recording, args.target, args.format)
        if lost:
            print(f"{shown(args.target)} can't contain everything: {' and '.join(lost)} are left out", file=sys.stderr)
        written = formats.write(_watched(recording), args.target, format=args.format)
        if args.source == args.target.with_name(f"{args.target.name}.davis") and not (recording.repairs or lost):
            # IN is the journal of OUT, and OUT is complete now
            args.source.unlink()
    for what, count in recording.repairs.items():
        print(f"{shown(args.source)}: {count} {what}", file=sys.stderr)
    if recording.size_is_guessed:
        size = "{}x{}".format(*recording.sensor_size)
        remark(f"{shown(args.source)}: the sensor size {size} is guessed from the events: --sensor-size states it")
    facts = {"events": written, "out": args.target, "repairs": recording.repairs, "left_out": lost}
    tell(f"{written:,} events in {shown(args.target)}", facts, as_json=args.json)
    return 0
