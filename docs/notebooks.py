"""Tutorials as Jupyter notebooks: text in Markdown cells, Python in code cells, commands of the shell after `!`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from snippets import FENCE

LINK = re.compile(r"!?\[([^\]]*)\]\((?!https?:)[^)]+\)")


def notebook(text: str) -> bytes:
    """Return the notebook of a page in Markdown."""
    cells = [_cell(n, kind, content) for n, (kind, content) in enumerate(_parts(text)) if content.strip()]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return json.dumps({"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}).encode()


def _parts(text: str) -> Iterator[tuple[str, str]]:
    """Yield kind ("markdown" or "code") and content of each cell; expected outputs are left out."""
    end = 0
    for block in FENCE.finditer(text):
        if block["kind"] not in ("python", "sh", "text"):
            continue
        yield "markdown", text[end : block.start()]
        end = block.end()
        if block["kind"] == "python":
            yield "code", block["code"]
        elif block["kind"] == "sh":
            lines = block["code"].replace("\\\n", " ").splitlines()
            yield "code", "\n".join(f"!{line}" if line and not line.startswith("#") else line for line in lines)
    yield "markdown", text[end:]


def _cell(number: int, kind: str, content: str) -> dict[str, Any]:
    if kind == "markdown":
        # comments are for the tests, and links to pages of the site lead nowhere from a notebook
        content = LINK.sub(r"\1", re.sub(r"<!--.*?-->", "", content, flags=re.DOTALL))
    cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": content.strip()}
    return cell if kind == "markdown" else cell | {"execution_count": None, "outputs": []}
