"""The `nvsdata datasets` command: the table of datasets."""

from __future__ import annotations

import argparse
import json
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsdata.commands.options import add_json, path
from nvsdata.common.terminal import tell
from nvsdata.common.text import aligned

if TYPE_CHECKING:
    from nvsdata.datasets.facts import Info

FACTS = Path(__file__).with_name("datasets.json")  # python -m nvsdata.commands.datasets writes it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--root", type=path, default=Path(), help="folder that is searched for datasets")
    check = "check that every download address still has its file, and print its size"
    parser.add_argument("--check", action="store_true", help=check)
    add_json(parser.add_argument)


def run(args: argparse.Namespace) -> int:
    """Print the table; with --check, return 1 if a file is missing at an address."""
    if args.check:
        return _check(as_json=args.json)
    if not args.root.is_dir():
        raise FileNotFoundError(f"{args.root}: no such folder")
    facts = dataset_facts(args.root)
    tell(table(facts), {"datasets": facts}, as_json=args.json)
    return 0


def _check(*, as_json: bool) -> int:
    from nvsdata.datasets import DATASETS
    from nvsdata.datasets.archives.address_check import check_addresses

    found = check_addresses([kind.info for name, kind in DATASETS.items() if name != "folder"])
    rows = [
        (one.dataset, one.file, f"{one.bytes / 1e9:.2f} GB" if one.bytes else "", one.url, one.fault or "available")
        for one in found
    ]
    tell(aligned(rows, left=True), {"sources": [one._asdict() for one in found]}, as_json=as_json)
    return 1 if any(one.fault for one in found) else 0


def dataset_facts(root: Path) -> list[dict[str, Any]]:
    """Return the facts of every dataset by name; "here" is its path in the folder `root`, or None."""
    # from a file, because importing the datasets imports torch, which takes a second
    more = "nvsdata.datasets" in sys.modules or entry_points(group="nvsdata.datasets")
    known = registered() if more else json.loads(FACTS.read_text("utf-8"))
    return [facts | {"here": where(facts["name"], root)} for facts in known]


def registered() -> list[dict[str, Any]]:
    """Return the facts of all registered datasets, including those of other packages."""
    from nvsdata.datasets import DATASETS

    return [_facts(kind.info) for name, kind in DATASETS.items() if name != "folder"]


def _facts(info: Info) -> dict[str, Any]:
    return {
        "name": info.name,
        "sensor_size": info.sensor_size,
        "recordings": info.recordings,
        "classes": len(info.classes),
        "bytes": sum(archive.size for archive in info.archives) or None,
        "license": info.license,
        "page": info.page,
        "by_program": info.by_program,
    }


def table(facts: list[dict[str, Any]]) -> str:
    """Return a table of datasets as text, from their facts."""
    head = ("name", "sensor", "recordings", "classes", "size", "license", "location or source")
    return aligned((head, *map(_row, facts)), left=True)


def _row(facts: dict[str, Any]) -> tuple[str, ...]:
    size, name = facts["bytes"], facts["name"]
    how = f"nvsdata download {name}" if facts["by_program"] else f"manual download from {facts['page']}"
    return (
        name,
        "{}x{}".format(*facts["sensor_size"]) if facts["sensor_size"] else "varies",
        f"{facts['recordings']:,}",
        str(facts["classes"]),
        f"{size / 1e9:.1f} GB" if size else "?",
        facts["license"],
        f"in {facts['here']}" if facts["here"] else how,
    )


def where(name: str, root: Path) -> Path | None:
    """Return the folder or store in `root` with the name of a dataset, or None; case and dashes don't matter."""
    wanted = name.replace("-", "")
    for place in sorted(root.iterdir()) if root.is_dir() else ():
        store = place.suffix in (".nvs", ".h5")
        stem = (place.stem if store else place.name).lower()
        if stem.replace("-", "").replace("_", "") == wanted and (place.is_dir() or store):
            return place
    return None


if __name__ == "__main__":
    FACTS.write_text(json.dumps(registered(), indent=1) + "\n", "utf-8")
