"""The `nvsdata compare` command: distances between the events of two recordings."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from nvsdata import formats, metrics, plots
from nvsdata.commands.options import add_json, path, positive, sensor_size
from nvsdata.common.errors import shown
from nvsdata.common.locks import check_place
from nvsdata.common.terminal import tell
from nvsdata.common.text import aligned
from nvsdata.plots.sheets import side_by_side


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("emulated", type=path, metavar="A", help="a recording, such as an emulated one")
    add("real", type=path, metavar="B", help="the recording that A is compared with")
    add("--fps", type=positive, default=30.0, help="events are summed to frames at this rate")
    add("--offset", type=int, default=0, metavar="US", help="µs to add to the times of B")
    add("--sensor-size", type=sensor_size, metavar="WxH", help="sensor size in pixels, for files that don't state it")
    add("--image", type=path, default=Path("compare.png"), help="image file in which both are drawn side by side")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Print the distances."""
    options = {"fps": args.fps, "offset": args.offset, "size": args.sensor_size}
    text, facts = compare_files(args.emulated, args.real, args.image, **options)
    tell(text, facts, as_json=args.json)
    return 0


def compare_files(
    emulated: Path, real: Path, image: Path, *, fps: float, offset: int = 0, size: tuple[int, int] | None = None
) -> tuple[str, dict[str, Any]]:
    """Measure the distances between two recordings, and draw them side by side.

    Args:
        emulated: Recording A.
        real: Recording B.
        image: PNG file to write.
        fps: Rate of the frames to which events are summed.
        offset: Time in µs that is added to the times of B (default 0).
        size: (width, height) of the sensor in pixels, for files that don't state it.

    Returns:
        A table as text, and the distances by name.
    """
    check_place(image)
    a, b = (formats.read(path, sensor_size=size) for path in (emulated, real))
    found = metrics.compare(a, b, fps, offset=offset)
    rows = [("distance", "A to B", "B to A", "closer if", "frames", "empty in A", "empty in B")]
    for name, there, back, closer in (
        ("Chamfer", found.chamfer, found.chamfer_back, "lower"),
        ("e-repeatability", found.repeatability, found.repeatability_back, "higher"),
        ("EMD", found.emd, found.emd, "lower"),
    ):
        used, empty = str(there.used), (str(there.empty_emulated), str(there.empty_real))
        rows.append((name, f"{there.value:.4f}", f"{back.value:.4f}", closer, used, *empty))
    counts = [("events", "A", "B", "A / B")]
    for name, ours, theirs in zip(("OFF", "ON"), found.emulated_events, found.real_events, strict=True):
        counts.append((name, f"{ours:,}", f"{theirs:,}", f"{ours / theirs:.3f}" if theirs else ""))
    plots.save_png(side_by_side(a, b, fps, offset), image)
    about = f"A  {shown(emulated)}  {a}\nB  {shown(real)}  {b}"
    text = f"{about}\n{aligned(rows)}\n\n{aligned(counts)}\nimage: {shown(image)}"
    return text, asdict(found) | {"image": image}
