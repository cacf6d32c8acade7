"""Changes that the hooks of mkdocs make in a page."""

import re
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

pytest.importorskip("mkdocs")
import hooks
import reference


def test_the_reason_why_a_block_is_not_run_leaves_no_trace_also_if_it_is_indented():
    page = SimpleNamespace(file=SimpleNamespace(src_uri="a.md"))
    text = '=== "tab"\n\n    <!-- not run: installs -->\n    ```sh\n    ```\n\n<!-- not run: camera -->\n```sh\n```\n'
    changed = hooks.on_page_markdown(text, page, {}, [])
    assert changed == '=== "tab"\n\n    ```sh\n    ```\n\n```sh\n```\n'


def test_links_of_the_reference_lead_to_files_here_and_to_pages_on_the_site():
    index = Path(hooks.__file__).parent / "api/index.md"
    text = index.read_text("utf-8")
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert len(links) > 10
    assert [link for link in links if not (index.parent / link).exists()] == []
    shown = hooks.on_page_markdown(text, SimpleNamespace(file=SimpleNamespace(src_uri="api/index.md")), {}, [])
    made = {f"{package or 'core'}/index.md" for package in reference.PACKAGES}
    assert set(re.findall(r"\]\(([^)]+)\)", shown)) == {*made, "../commands.md"}


def image_of(color, ground=255):
    """A PNG file: a square of a color (BGR) on a ground, with a black line."""
    image = np.full((100, 100, 3), ground, np.uint8)
    image[20:80, 20:80] = color
    image[5] = 0
    return cv2.imencode(".png", image)[1].tobytes()


def test_a_dark_color_map_stays_and_its_ground_becomes_transparent():
    purple = (84, 1, 68)
    assert hooks._has_dark_map(image_of(purple))
    shown = cv2.imdecode(np.frombuffer(hooks._without_ground(image_of(purple)), np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown[50, 50].tolist() == [*purple, 255]
    assert shown[90, 90, 3] == 0
    # ink that can be read on white and on black
    assert shown[5, 5].tolist() == [128, 128, 128, 255]


def test_light_color_maps_are_inverted_with_their_ground():
    for light in (image_of((247, 247, 247)), image_of((255, 255, 255)), image_of((150, 150, 150), 252)):
        assert hooks._is_white(light)
        assert not hooks._has_dark_map(light)
    assert not hooks._is_white(image_of((0, 0, 0), 100))
