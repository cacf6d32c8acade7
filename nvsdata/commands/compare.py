"""`nvsdata compare`: distances between the events of two recordings."""

from __future__ import annotations

import argparse
from pathlib import Path

from nvsdata import formats, metrics, plots
from nvsdata.commands.options import path, positive, sensor_size
from nvsdata.common.errors import shown
from nvsdata.common.tables import aligned
from nvsdata.plots.comparison import side_by_side


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("emulated", type=path, metavar="A", help="a recording; distances go from it to B")
    add("real", type=path, metavar="B", help="the recording that A is compared with")
    add("--fps", type=positive, default=30.0, help="frames per second into which events are summed")
    add("--offset", type=int, default=0, metavar="US", help="µs to add to the times of B")
    add("--sensor-size", type=sensor_size, metavar="WxH", help="in pixels, where the files don't state it")
    add("--picture", type=path, default=Path("compare.png"), help="where both are drawn side by side")


def run(args: argparse.Namespace) -> int:
    """Print the distances."""
    options = {"fps": args.fps, "offset": args.offset, "size": args.sensor_size}
    print(compare_files(args.emulated, args.real, args.picture, **options))
    return 0


def compare_files(
    emulated: Path, real: Path, picture: Path, *, fps: float, offset: int = 0, size: tuple[int, int] | None = None
) -> str:
    """Distances between two recordings, as a table; both are drawn side by side in `picture`.

    `size` is the sensor's, for files that don't state it.
    """
    a, b = (formats.read(path, sensor_size=size) for path in (emulated, real))
    found = metrics.compare(a, b, fps, offset=offset)
    rows = [("distance", "value", "frames", "empty in A", "empty in B")]
    for name, distance in (
        ("Chamfer", found.chamfer),
        ("e-repeatability", found.repeatability),
        ("EMD", found.emd),
    ):
        rows.append(
            (name, f"{distance.value:.4f}", str(distance.used), str(distance.empty_emulated), str(distance.empty_real))
        )
    plots.save(side_by_side(a, b, fps, offset), picture)
    return f"A  {shown(emulated)}  {a}\nB  {shown(real)}  {b}\n{aligned(rows)}\ndrawn in {shown(picture)}"
