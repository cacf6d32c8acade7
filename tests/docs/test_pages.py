"""The site's pages: user pages are short, and what was measured stands on one page."""

import json
import re
from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path

import facts
import figures
import pytest
import yaml

from nvsdata import transforms

pytest.importorskip("mkdocs")
import hooks

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
MOST_WORDS = 25_000  # of all user pages together
CODE = re.compile(r"^(```+).*?^\1|`[^`\n]+`|\]\([^)]*\)", re.MULTILINE | re.DOTALL)
UNITS = "%|°|×|ns|µs|ms|s|min|h|kB|MB|GB|G|M|times|points|pixels|million"
FIGURE = re.compile(rf"(?<![\w.,^-])(?P<number>\d[\d,]*\.\d+)(?![\d.]*\d)(?: ?(?P<unit>{UNITS})(?!\w))?")
BETWEEN = " to ", "–", " ± "  # the ends of an interval
# figures of different things that are equal by chance
CHANCE = {("0.94", "1.05"), ("0.95", "1.06"), ("1.05", "times")}


def pages_of(nav):
    """The pages of a part of the navigation: a page, a list of parts, or titles with their parts."""
    if isinstance(nav, str):
        return [nav]
    parts = nav.values() if isinstance(nav, dict) else nav
    return [page for part in parts for page in pages_of(part)]


def user_pages():
    """The files of all pages but those of development."""
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"]
    pages = pages_of([part for part in nav if "Development" not in part])
    files = [ROOT / hooks.ELSEWHERE.get(page, f"docs/{page}") for page in pages]
    return [file for file in files if file.exists()]


def prose(page):
    """The text of a page without generated tables."""
    return facts.MARK.sub("", page.read_text("utf-8"))


def test_user_pages_are_short():
    words = {page.relative_to(ROOT).as_posix(): len(prose(page).split()) for page in user_pages()}
    assert len(words) > 60
    assert "recipes/screen_playback/README.md" in words
    assert "docs/numerics.md" not in words
    longest = sorted(words.items(), key=lambda item: -item[1])[:10]
    assert sum(words.values()) <= MOST_WORDS, longest


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_pages_have_the_tables_of_today(page):
    """If it fails, run `python docs/facts.py`."""
    text = page.read_text("utf-8")
    # Pythons break the lines of usages in different ways
    assert facts.with_tables(text).split() == text.split()


def test_a_generated_table_stands_on_one_page():
    count = Counter(name for page in PAGES for name in facts.MARK.findall(page.read_text("utf-8")))
    assert [name for name, number in count.items() if number > 1] == []
    measured = {"comparison", "growth", "robustness"}
    measured |= {f"accuracy {table}" for table in json.loads(figures.ACCURACY.read_bytes())}
    measured |= {f"ablation {file.stem}" for file in figures.ACCURACY.parent.glob("ablation*.jsonl")}
    assert measured - set(count) == set()


def test_the_page_of_transforms_names_all():
    text = (DOCS / "transforms.md").read_text("utf-8")
    assert [name for name in transforms.TRANSFORMS if not re.search(rf"`{name}\b", text)] == []


def digits(number):
    """The number of significant digits."""
    return len(re.sub(r"[,.]", "", number).lstrip("0"))


def measured(text):
    """The figures in a page by which others are recognized, without code and links.

    These are numbers of four digits, numbers of three digits with a unit, and intervals of which one end has three
    digits. Three digits alone are equal by chance too often.
    """
    text = CODE.sub(" ", text)
    found = list(FIGURE.finditer(text))
    alone = {
        (one["number"], one["unit"] or "")
        for one in found
        if digits(one["number"]) >= 4 or (digits(one["number"]) == 3 and one["unit"])
    }
    intervals = {
        (one["number"], after["number"])
        for one, after in pairwise(found)
        if text[one.end() : after.start()] in BETWEEN and max(digits(one["number"]), digits(after["number"])) >= 3
    }
    return alone | intervals


def repeated(texts):
    """The pages of each figure that stands on several, from the texts of pages by their names."""
    pages = defaultdict(list)
    for name, text in texts.items():
        for figure in measured(text):
            pages[figure].append(name)
    return {figure: names for figure, names in sorted(pages.items()) if len(names) > 1}


def test_a_measured_figure_stands_on_one_page():
    found = repeated({page.relative_to(DOCS).as_posix(): prose(page) for page in PAGES})
    assert {figure: names for figure, names in found.items() if figure not in CHANCE} == {}
    assert set(found) >= CHANCE


@pytest.mark.parametrize("text", ["0.934 ± 0.001", "| 0.927 to 0.940 |", "**96.5%** of all", "13.4 ms", "(1,270.5)"])
def test_a_repeated_figure_is_noticed(text):
    assert len(repeated({"a.md": f"It has {text}.", "b.md": f"| here | {text} |"})) == 1


@pytest.mark.parametrize(
    "text", ["`0.934 ± 0.001`", "[a](b-13.45.html)", "```\n13.45\n```\n", "1.7.0", "0.934", "1.5 ms"]
)
def test_code_links_versions_and_short_numbers_are_no_figures(text):
    assert repeated({"a.md": text, "b.md": text}) == {}
