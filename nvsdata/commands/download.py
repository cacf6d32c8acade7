"""The `nvsdata download` command: download and unpacking of a dataset."""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path

from nvsdata.commands.options import add_json, dataset, path
from nvsdata.common.errors import shown
from nvsdata.common.terminal import remark, tell
from nvsdata.datasets.facts import Info


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("dataset", metavar="NAME", type=dataset, help="name of the dataset, as in `nvsdata datasets`")
    add("--root", type=path, help="folder for the dataset (default ./NAME)")
    add(
        "--mirror",
        metavar="PLACE",
        help="folder or address with the archives, which is tried first (default: $NVSDATA_MIRROR)",
    )
    add("--delete-archives", action="store_true", help="delete each archive after unpacking it")
    add("--dry-run", action="store_true", help="print the files to download and their sizes, and download nothing")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Download the dataset, and print its folders."""
    from nvsdata.datasets.archives.download import download, unneeded_archives
    from nvsdata.datasets.archives.transfer import MIRROR

    info = args.dataset.info
    root = args.root or Path(info.name)
    if args.mirror:
        os.environ[MIRROR] = args.mirror
    if args.dry_run:
        _plan(info, root, args.json)
        return 0
    folders = list(map(str, download(info, root, keep=not args.delete_archives)))
    tell("\n".join(map(shown, folders)), {"folders": folders}, as_json=args.json)
    if left := unneeded_archives(info.archives, root):
        size = sum(path.stat().st_size for path in left) / 1e9
        left_there = f"{len(left)} archives with {size:.2f} GB are still in {shown(root)}"
        remark(f"{left_there}: --delete-archives deletes them")
    return 0


def _plan(info: Info, to: Path, as_json: bool) -> None:
    """Print the files to download, their sizes and addresses."""
    from nvsdata.datasets.archives.transfer import MIRROR

    files = [{"name": archive.name, "bytes": archive.size or None, "urls": archive.urls} for archive in info.archives]
    lines = [
        f"{archive.name}  {f'{archive.size / 1e9:.2f} GB' if archive.size else 'of unknown size'}  "
        + (
            " or ".join(archive.urls)
            or (archive.within.name if archive.within else f"manual download from {info.page}")
        )
        for archive in info.archives
    ]
    if mirror := os.environ.get(MIRROR):
        lines.append(f"tried first: {shown(mirror)}")
    place = next((parent for parent in (to, *to.absolute().parents) if parent.is_dir()), Path())
    free = shutil.disk_usage(place).free
    lines.append(f"to {shown(to)}, where {free / 1e9:.1f} GB are free")
    tell("\n".join(lines), {"files": files, "to": to, "free": free, "mirror": mirror}, as_json=as_json)
