"""Hooks of mkdocs: run the gallery's pages, make tables from the registries, and draw datasets."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
import dataset_pictures
import facts
import gallery_cache
import notebooks
import reference

import nvsdata

PICTURES: dict[str, str] = {}  # caption of each dataset's image, by its name
WHITE: set[str] = {"n-mnist.png"}  # names of images on white ground
# a package's list of names, which the site replaces by the page that is made of it
SOURCE = re.compile(r"\(\.\./\.\./nvsdata/(?:(\w+)/)?__init__\.pyi?\)")
IMAGE = re.compile(r"(!\[[^]]*\]\((?:[\w./-]*/)?([\w-]+\.png)\))(\{)?")
# pages whose source is elsewhere in the repository
ELSEWHERE = {"changelog.md": "CHANGELOG.md", "screen-playback.md": "recipes/screen_playback/README.md"}


def _marked(found: re.Match[str]) -> str:
    """Mark an image on white ground, whose lightness is inverted in dark mode."""
    if found[2] not in WHITE:
        return found[0]
    return f"{found[1]}{{ .on-white" + (" " if found[3] else " }")


def _is_white(content: bytes) -> bool:
    """Return whether more than half of an image's pixels are white, or the gray of 0 in red and blue maps."""
    return float((_pixels(content) > 240).all(-1).mean()) > 0.5


def _has_dark_map(content: bytes) -> bool:
    """Return whether a fifth of an image is dark and colored, as color maps are that begin with a dark color.

    Such colors would be pale if the lightness were inverted.
    """
    image = _pixels(content)
    return float(((_saturation(image) > 30) & (image.mean(-1) < 128)).mean()) > 0.2


def _without_ground(content: bytes) -> bytes:
    """Return an image for light and dark pages: white is transparent, and black is a medium gray."""
    image = _pixels(content)
    gray = _saturation(image) < 12
    # the darkest fifth is opaque, because titles are dark gray
    alpha = np.where(gray, ((255.0 - image.max(-1)) * 1.3).clip(0, 255), 255)
    shown = np.dstack([np.where(gray[..., None], 128, image), alpha]).astype(np.uint8)
    return cv2.imencode(".png", shown)[1].tobytes()


def _pixels(content: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)


def _saturation(image: np.ndarray) -> np.ndarray:
    return image.max(-1) - image.min(-1)


def on_config(config: Any) -> Any:
    """Add the pages of the reference to the navigation, and the version to the footer."""
    config["copyright"] = f"nvsdata {nvsdata.__version__}, BSD-3-Clause"
    for part in config["nav"]:
        if "API" in part:
            part["API"] = reference.navigation()
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add what is made here: results of the gallery, images of datasets, the reference, pages from other folders."""
    docs = Path(config["docs_dir"])
    images: dict[str, str] = {}  # the first image of each page of the gallery
    for page in sorted((docs / "gallery").glob("*.md")):
        for name, content in gallery_cache.results(page):
            if name.endswith(".png"):
                images.setdefault(f"gallery/{page.name}", f"gallery/{name}")
                if _has_dark_map(content):
                    content = _without_ground(content)
                elif _is_white(content):
                    WHITE.add(name)
            files.append(File.generated(config, f"gallery/{name}", content=content))
    for path, text in reference.pages(docs, images):
        files.append(File.generated(config, path, content=text))
    for page in sorted((docs / "tutorials").glob("*.md")):
        made = notebooks.notebook(page.read_text("utf-8"))
        files.append(File.generated(config, f"tutorials/{page.stem}.ipynb", content=made))
    for page in sorted((docs / "datasets").glob("*.md")):
        if page.stem in facts.DATASETS and (drawn := dataset_pictures.picture(page.stem)):
            PICTURES[page.stem], content = drawn
            files.append(File.generated(config, f"datasets/{page.stem}-seen.png", content=content))
            small = dataset_pictures.thumbnail(page.stem)
            files.append(File.generated(config, f"datasets/{page.stem}-small.png", content=small))
    for name, source in ELSEWHERE.items():
        text = (docs.parent / source).read_text("utf-8").replace("../../docs/", "")
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace `<!-- table: NAME -->` by tables, and links to files of the repository by links to pages."""
    for name, source in ELSEWHERE.items():
        markdown = markdown.replace(f"../{source}", name)
    if page.file.src_uri == "api/index.md":
        markdown = SOURCE.sub(lambda found: f"({found[1] or 'core'}/index.md)", markdown)
    kind = Path(page.file.src_uri).stem
    if page.file.src_uri.startswith("tutorials/"):
        title, rest = markdown.split("\n", 1)
        markdown = f"{title}\n\n[Download as a notebook]({kind}.ipynb){{ download }}\n{rest}"
    if page.file.src_uri.startswith("datasets/") and kind in PICTURES:
        # after the first paragraph
        seen = f"![{PICTURES[kind]}]({kind}-seen.png){{ .on-white }}\n\n{PICTURES[kind]}.\n\n"
        markdown = markdown.replace("<!-- table:", seen + "<!-- table:", 1)
    markdown = facts.MARK.sub(lambda found: f"{facts.table(found[1])}\n", markdown)
    markdown = IMAGE.sub(_marked, markdown)
    return re.sub(r"^ *<!-- not run: [^>]+ -->\n", "", markdown, flags=re.MULTILINE)
