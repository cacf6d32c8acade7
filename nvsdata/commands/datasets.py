"""`nvsdata datasets`: the table of datasets."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from nvsdata.commands.options import path
from nvsdata.common.tables import aligned

if TYPE_CHECKING:
    from nvsdata.datasets.base import EventDataset


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--root", type=path, default=Path(), help="the folder that datasets are looked for in")


def run(args: argparse.Namespace) -> int:
    """Print the table."""
    print(table(args.root))
    return 0


def table(root: Path) -> str:
    """Every dataset with its facts, and where it is below `root` or how to get it."""
    from nvsdata.datasets import DATASETS

    head = ("name", "sensor", "recordings", "classes", "size", "license", "here, or how to get it")
    rows = [_row(kind, root) for name, kind in DATASETS.items() if name != "folder"]
    return aligned((head, *rows), left=True)


def _row(kind: type[EventDataset], root: Path) -> tuple[str, ...]:
    info = kind.info
    size = sum(archive.size for archive in info.archives)
    sensor = "{}x{}".format(*info.sensor_size) if info.sensor_size else "varies"
    place = where(info.name, root)
    how = f"nvsdata download {info.name}" if info.by_program else f"by hand from {info.page}"
    return (
        info.name,
        sensor,
        f"{info.recordings:,}",
        str(len(info.classes)),
        f"{size / 1e9:.1f} GB" if size else "?",
        info.license,
        f"here: {place}" if place else how,
    )


def where(name: str, root: Path) -> Path | None:
    """The folder or store below `root` that is named after a dataset, whatever its case and dashes; None if none is."""
    wanted = name.replace("-", "")
    for place in sorted(root.iterdir()) if root.is_dir() else ():
        stem = place.name.removesuffix(".h5").lower()
        if stem.replace("-", "").replace("_", "") == wanted and (place.is_dir() or place.suffix == ".h5"):
            return place
    return None
