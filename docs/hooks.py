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


def on_files(files: Any, config: Any) -> Any:
    """Run the gallery's pages, and add the pictures and pages that they write; add the changelog."""
    docs = Path(config["docs_dir"])
    for page in sorted((docs / "gallery").glob("*.md")):
        with tempfile.TemporaryDirectory() as folder:
            snippets.run_page(page, Path(folder))
            for made in sorted(Path(folder).iterdir()):
                if made.suffix in (".png", ".gif", ".html"):
                    files.append(File.generated(config, f"gallery/{made.name}", content=made.read_bytes()))
    changes = (docs.parent / "CHANGELOG.md").read_text("utf-8")
    files.append(File.generated(config, "changelog.md", content=changes))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Put tables in place of `<!-- table: NAME -->`; links out of docs/ go to the repository's files."""
    markdown = re.sub(r"<!-- table: ([\w. -]+) -->", lambda found: facts.table(found[1]), markdown)
    return re.sub(r"<!-- not run: [^>]+ -->\n", "", markdown)
