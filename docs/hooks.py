"""Hooks of mkdocs: run the gallery's pages, make tables from the registries, and draw datasets."""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
import dataset_pictures
import facts
import snippets

PICTURES: dict[str, str] = {}  # caption of each dataset's image, by its name
# pages whose source is elsewhere in the repository
ELSEWHERE = {"changelog.md": "CHANGELOG.md", "screen-playback.md": "recipes/screen_playback/README.md"}


def on_files(files: Any, config: Any) -> Any:
    """Run the gallery's pages; add the images and pages that they write, and pages from elsewhere in the repository."""
    docs = Path(config["docs_dir"])
    for page in sorted((docs / "gallery").glob("*.md")):
        with tempfile.TemporaryDirectory() as folder:
            snippets.run_page(page, Path(folder))
            for made in sorted(Path(folder).iterdir()):
                if made.suffix in (".png", ".gif", ".html"):
                    files.append(File.generated(config, f"gallery/{made.name}", content=made.read_bytes()))
    for page in sorted((docs / "datasets").glob("*.md")):
        if page.stem in facts.DATASETS and (drawn := dataset_pictures.picture(page.stem)):
            PICTURES[page.stem], content = drawn
            files.append(File.generated(config, f"datasets/{page.stem}-seen.png", content=content))
    for name, source in ELSEWHERE.items():
        text = (docs.parent / source).read_text("utf-8").replace("../../docs/", "")
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace `<!-- table: NAME -->` by tables, and links to files of the repository by links to pages."""
    for name, source in ELSEWHERE.items():
        markdown = markdown.replace(f"../{source}", name)
    kind = Path(page.file.src_uri).stem
    if page.file.src_uri.startswith("datasets/") and kind in PICTURES:
        # after the first paragraph
        seen = f"![{PICTURES[kind]}]({kind}-seen.png)\n\n{PICTURES[kind]}.\n\n"
        markdown = markdown.replace("<!-- table:", seen + "<!-- table:", 1)
    markdown = re.sub(r"<!-- table: ([\w. -]+) -->", lambda found: facts.table(found[1]), markdown)
    return re.sub(r"<!-- not run: [^>]+ -->\n", "", markdown)
