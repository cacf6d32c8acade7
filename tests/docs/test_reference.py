"""The reference has every public name once, with its signature and parameters; notebooks have the tutorials' code."""

import json
from pathlib import Path

import pytest

pytest.importorskip("griffe")
import notebooks
import reference
from snippets import blocks_of

import nvsdata

DOCS = Path(nvsdata.__file__).parents[1] / "docs"


def test_every_public_class_and_function_has_one_place():
    names = [name for found in reference.families().values() for family in found for name in family.names]
    short = [name.rpartition(".")[2] for name in names]
    assert len(names) == len(set(names)) > 200
    for name in (
        "Events",
        "NMNIST",
        "RadiusGraph",
        "RGCNN",
        "DVS",
        "PIX2NVS",
        "collate",
        "windows",
        "plot",
        "FormatError",
    ):
        assert short.count(name) == 1, name
    # constants and packages have no page
    assert not {"TRANSFORMS", "DATASETS", "models", "__version__"} & set(short)


def test_pages_are_unique_and_in_the_navigation():
    pages = dict(reference.pages(DOCS, {}))
    flat = json.dumps(reference.navigation())
    assert all(json.dumps(path) in flat for path in pages)
    assert len(pages) == len(list(reference.pages(DOCS, {})))


def test_a_page_shows_where_its_names_are_used():
    pages = dict(reference.pages(DOCS, {"gallery/graph.md": "gallery/graph.png"}))
    text = pages["api/transforms/edges.md"]
    assert "::: nvsdata.transforms.RadiusGraph\n" in text
    assert "[![Graph of events](../../gallery/graph.png){ width=240 }](../../gallery/graph.md)" in text
    assert "| [`RadiusGraph`][nvsdata.transforms.RadiusGraph] | " in pages["api/transforms/index.md"]


def test_inherited_parameters_are_described():
    class Heir(nvsdata.EventFolder):
        """A folder of something else."""

    described = reference._inherited(Heir)
    assert described.startswith("Parameters inherited from `EventFolder`:")
    assert "| `sensor_size` | (width, height) in pixels of every recording;" in described
    assert reference._inherited(nvsdata.EventFolder) == ""
    assert reference._inherited(nvsdata.read) == ""


@pytest.mark.parametrize("page", sorted((DOCS / "tutorials").glob("*.md")), ids=lambda page: page.stem)
def test_a_notebook_has_the_code_of_its_page(page):
    cells = json.loads(notebooks.notebook(page.read_text("utf-8")))["cells"]
    code = [cell["source"] for cell in cells if cell["cell_type"] == "code" and not cell["source"].startswith("!")]
    expected = [block.code.strip() for block in blocks_of(page.read_text("utf-8")) if block.kind == "python"]
    assert [one for one in code if one in expected] == expected
    assert len({cell["id"] for cell in cells}) == len(cells)
    assert not any("<!--" in cell["source"] or "](" in cell["source"].replace("](http", "") for cell in cells)
