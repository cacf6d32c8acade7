"""What mkdocs does besides: gallery pages are run, and tables are made of what nvsdata itself knows."""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
import facts
import snippets

# pages whose text lies elsewhere in the repository
BESIDE = {"changelog.md": "CHANGELOG.md", "screen-playback.md": "recipes/screen_playback/README.md"}


def on_files(files: Any, config: Any) -> Any:
    """Run the gallery's pages, and add the pictures and pages that they write, and pages from elsewhere."""
    docs = Path(config["docs_dir"])
    for page in sorted((docs / "gallery").glob("*.md")):
        with tempfile.TemporaryDirectory() as folder:
            snippets.run_page(page, Path(folder))
            for made in sorted(Path(folder).iterdir()):
                if made.suffix in (".png", ".gif", ".html"):
                    files.append(File.generated(config, f"gallery/{made.name}", content=made.read_bytes()))
    for name, source in BESIDE.items():
        text = (docs.parent / source).read_text("utf-8").replace("../../docs/", "")
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Put tables in place of `<!-- table: NAME -->`, and links to pages in place of those to the repository's files."""
    for name, source in BESIDE.items():
        markdown = markdown.replace(f"../{source}", name)
    markdown = re.sub(r"<!-- table: ([\w. -]+) -->", lambda found: facts.table(found[1]), markdown)
    return re.sub(r"<!-- not run: [^>]+ -->\n", "", markdown)
