"""Every block of Python and of the shell in README and docs runs, and prints what the page says."""

from pathlib import Path

import pytest
import snippets
from snippets import SnippetError, blocks_of, run_page

ROOT = Path(__file__).parents[2]
# tests/test_extending.py runs the blocks of docs/extending.md, which register things, apart from each other
PAGES = [page for page in sorted((ROOT / "docs").rglob("*.md")) if page.name != "extending.md"]
PAGES += [ROOT / "README.md", ROOT / "recipes/screen_playback/README.md"]


def count_of(page):
    """The number of a page's blocks that run."""
    return sum(block.skipped is None for block in blocks_of(page.read_text("utf-8")))


@pytest.mark.parametrize("page", list(filter(count_of, PAGES)), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_does_as_it_says(page, tmp_path, monkeypatch, request):
    """Tutorials and gallery need nothing but themselves."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    alone = {"tutorials", "gallery"} & set(page.parts)
    assert run_page(page, tmp_path if alone else request.getfixturevalue("desk")) == count_of(page)


def test_what_is_not_run_says_why_and_is_the_smaller_part():
    blocks = [block for page in PAGES for block in blocks_of(page.read_text("utf-8"))]
    skipped = [block for block in blocks if block.skipped is not None]
    assert all(len(block.skipped) > 4 for block in skipped)
    assert len(skipped) < len(blocks) / 2


PAGE = """
```python
print("one\\n2\\nthree")
```

```text
one
...
three
```

<!-- not run: no reason -->
```sh
exit 3
```

```python
print("four")
```
"""


def test_a_page_is_held_to_its_output(tmp_path):
    page = tmp_path / "a.md"
    page.write_text(PAGE)
    assert run_page(page, tmp_path) == 2
    page.write_text(PAGE.replace("\nthree\n```\n\n<", "\nfour\n```\n\n<"))
    with pytest.raises(SnippetError, match=r"a\.md:2: prints\none\n2\nthree\n\nand not\none\n\.\.\.\nfour"):
        run_page(page, tmp_path)
    page.write_text(PAGE.replace("<!-- not run: no reason -->\n", ""))
    with pytest.raises(SnippetError, match=r"a\.md:12: RuntimeError: exit code 3"):
        run_page(page, tmp_path)
    page.write_text(PAGE.replace('print("four")', "1 / 0"))
    with pytest.raises(SnippetError, match=r"a\.md:17: ZeroDivisionError"):
        run_page(page, tmp_path)
    assert snippets._alike("a\nb\n", "a\nb")
    assert not snippets._alike("a\nb\nc\n", "a\nb")
