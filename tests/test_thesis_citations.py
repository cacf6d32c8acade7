"""Sections, equations and tables of the thesis that code and documents cite are there."""

import re
from itertools import chain
from pathlib import Path

import pytest
from places import SHARED

ROOT = Path(__file__).parents[1]
THESIS = SHARED.parent / "thesis.txt"
pytestmark = pytest.mark.skipif(not THESIS.exists(), reason="the thesis isn't here")

SECTION = r"[1-6]\.[1-9](?:\.[1-9])?"
# "thesis 4.4.2", "section 3.4.1", "sections 3.3.1 to 3.3.3", "4.2.5 and 4.4.2"
CITED = {
    "section": rf"(?:thesis(?: section)?|[Ss]ections?) ((?:{SECTION}(?:, | to | and )?)+)",
    "equation": r"(?:thesis \(?eqs?\. |eqs?\. (?=[1-6]\.))([1-6]\.\d+(?:-[1-6]\.\d+)?)",
    "table": r"Tables? ([1-6]\.\d+)",
}


def cited(kind):
    """Each number that is cited, with the files in which it is."""
    found = {}
    files = chain((ROOT / "nvsdata").rglob("*.py"), (ROOT / "recipes").rglob("*.py"), (ROOT / "docs").rglob("*.md"))
    for file in (ROOT / "README.md", *files):
        for numbers in re.findall(CITED[kind], file.read_text()):
            for number in re.findall(r"\d+(?:\.\d+)+", numbers):
                found.setdefault(number, set()).add(str(file.relative_to(ROOT)))
    return found


@pytest.mark.parametrize(
    ("kind", "pattern", "least"),
    [
        ("section", rf"^({SECTION}) [A-Z]", 20),
        ("equation", r"\((?=[1-6])(\d+\.\d+)\)|tag\{(\d+\.\d+)\}", 5),
        ("table", r"^Table ([1-6]\.\d+)|Table ([1-6]\.\d+):", 10),
    ],
)
def test_what_is_cited_is_there(kind, pattern, least):
    there = re.findall(pattern, THESIS.read_text(), re.M)
    there = {number for match in there for number in ([match] if isinstance(match, str) else match)}
    found = cited(kind)
    assert len(found) >= least
    assert {number: files for number, files in found.items() if number not in there} == {}
