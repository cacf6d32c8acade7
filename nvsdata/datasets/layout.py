"""Error message if a dataset isn't found below its root: the expected tree, and the one that is there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from pathlib import Path

from nvsdata.datasets.source import Listing, recordings_in

SHOWN = 5  # folders in a message


def nothing_below(root: Path, listing: Listing, tree: str, names: Collection[str]) -> str:
    """The tree expected below `root`, what is there and, if `root` seems too deep, which folder above to use.

    `names` are those of classes and parts, in lower case without punctuation: a root with such a name is too deep.
    """
    said = f"expected there: {tree}; found: {_summary(listing)}"
    above = root.absolute()
    while "".join(c for c in above.name.lower() if c.isalnum()) in names and above != above.parent:
        above = above.parent
    if above == root.absolute() and root.is_dir() and any("/" not in name for name in recordings_in(listing)):
        # recordings lie directly in the root, not in a class folder
        above = above.parent
    return said if above == root.absolute() else f"{said}; the root must be a folder above, such as {above}"


def _summary(listing: Listing) -> str:
    shown = []
    for folder, files in listing.items():
        kinds = Counter(Path(name).suffix or name for name in files)
        counts = ", ".join(f"{count:,} {kind}" for kind, count in kinds.most_common(3))
        if files or folder != ".":
            shown.append(f"{folder}/ ({counts or 'no files of its own'})")
    if not shown:
        return "nothing"
    more = len(shown) - SHOWN
    return ", ".join(shown[:SHOWN]) + (f" and {more:,} more folders" if more > 0 else "")
