"""`nvsdata download`: a dataset fetched and unpacked."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from nvsdata.commands.options import add_json, dataset, path
from nvsdata.common.terminal import tell
from nvsdata.datasets.facts import Info


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("dataset", metavar="NAME", type=dataset, help="as `nvsdata datasets` calls it")
    add("--root", type=path, help="the folder it goes to (default ./NAME)")
    add("--dry-run", action="store_true", help="say what would be fetched, and how large it is")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Print the folders that the dataset is in."""
    from nvsdata.datasets.archives.download import download

    info = args.dataset.info
    if args.dry_run:
        _plan(info, args)
        return 0
    folders = list(map(str, download(info, args.root or Path(info.name))))
    tell("\n".join(folders), {"folders": folders}, as_json=args.json)
    return 0


def _plan(info: Info, args: argparse.Namespace) -> None:
    """Print what would be fetched, where from and how large it is."""
    files = [{"name": archive.name, "bytes": archive.size or None, "urls": archive.urls} for archive in info.archives]
    lines = [
        f"{archive.name}  {f'{archive.size / 1e9:.2f} GB' if archive.size else 'of unknown size'}  "
        + (" or ".join(archive.urls) or (archive.within.name if archive.within else f"by hand from {info.page}"))
        for archive in info.archives
    ]
    to = args.root or Path(info.name)
    place = next((parent for parent in (to, *to.absolute().parents) if parent.is_dir()), Path())
    free = shutil.disk_usage(place).free
    lines.append(f"to {to}, where {free / 1e9:.1f} GB are free")
    tell("\n".join(lines), {"files": files, "to": to, "free": free}, as_json=args.json)
