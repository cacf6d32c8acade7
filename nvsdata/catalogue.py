"""The table of datasets."""

from __future__ import annotations

from pathlib import Path

from nvsdata.datasets import DATASETS
from nvsdata.datasets.base import EventDataset


def table(root: Path) -> str:
    """Every dataset with its facts, and where it is below `root` or how to get it."""
    head = ("name", "sensor", "recordings", "classes", "size", "licence", "here, or how to get it")
    rows = [_row(kind, root) for name, kind in DATASETS.items() if name != "folder"]
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in (head, *rows)
    )


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
        info.licence,
        f"here: {place}" if place else how,
    )


def where(name: str, root: Path) -> Path | None:
    """The folder or store of a dataset below `root`: called after it, whatever the case and dashes."""
    wanted = name.replace("-", "")
    for path in sorted(root.iterdir()) if root.is_dir() else ():
        stem = path.name.removesuffix(".h5").lower()
        if stem.replace("-", "").replace("_", "") == wanted and (path.is_dir() or path.suffix == ".h5"):
            return path
    return None
