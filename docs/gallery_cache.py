"""Files that the gallery's pages write, kept between builds as long as the page and the package stay the same."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import snippets

import nvsdata

KEPT = (".png", ".gif", ".html")
FOLDER = Path(__file__).parents[1] / ".cache" / "gallery"


def results(page: Path) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file that the code of a page writes, after running it unless it was run before."""
    folder = FOLDER / f"{page.stem}-{_digest(page)}"
    if not folder.is_dir():
        FOLDER.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=FOLDER) as temporary:
            made = Path(temporary) / page.stem
            made.mkdir()
            snippets.run_page(page, made)
            try:
                made.rename(folder)
            except OSError:
                # another build finished the same page meanwhile
                if not folder.is_dir():
                    raise
        for old in FOLDER.glob(f"{page.stem}-*"):
            # not that of a page whose name only begins alike
            if old != folder and old.name.rpartition("-")[0] == page.stem:
                shutil.rmtree(old, ignore_errors=True)
    for one in sorted(folder.iterdir()):
        if one.suffix in KEPT:
            yield one.name, one.read_bytes()


def _digest(page: Path) -> str:
    """Return a digest of a page and of the package's code."""
    return hashlib.sha256(page.read_bytes() + _package()).hexdigest()[:16]


@cache
def _package() -> bytes:
    """Return a digest of the package's code, which takes 0.1 s."""
    whole = hashlib.sha256()
    for source in sorted(Path(nvsdata.__file__).parent.rglob("*")):
        if source.suffix in (".py", ".so", ".pyd", ".js", ".html", ".css"):
            whole.update(source.read_bytes())
    return whole.digest()
