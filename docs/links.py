"""Check the external links of the documentation: `python docs/links.py`, on a machine with a network."""

from __future__ import annotations

import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from nvsdata.datasets.archives.address_check import page_fault

ROOT = Path(__file__).parents[1]
TEXTS = "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "docs/*.md", "docs/*/*.md", "recipes/*/*.md"
LINK = re.compile(r"https?://[^\s)>\"'`|,;]+[^\s)>\"'`|,;.:]")
OWN = re.compile(r"https?://(localhost|127\.|example\.)")


def links(root: Path) -> dict[str, str]:
    """Return every address in the documents below `root`, with the first file that has it."""
    found: dict[str, str] = {}
    for pattern in TEXTS:
        for path in sorted(root.glob(pattern)):
            for address in LINK.findall(path.read_text("utf-8")):
                if not OWN.match(address):
                    found.setdefault(address, path.relative_to(root).as_posix())
    return found


def main(root: Path = ROOT) -> int:
    """Print dead links, and return 1 if there are any."""
    known = links(root)
    with ThreadPoolExecutor(8) as threads:
        faults = list(zip(known.items(), threads.map(page_fault, known), strict=True))
    for (address, file), fault in faults:
        if fault:
            print(f"{file}: {address}: {fault}")
    return 1 if any(fault for _, fault in faults) else 0


if __name__ == "__main__":
    sys.exit(main())
