"""YAML, JSON and XML files of calibrations, as nested dictionaries and lists."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from nvsdata.common.errors import FormatError, line_of

MOST = 1 << 20  # bytes; calibrations have a few thousand


def parsed(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the content of a calibration file.

    Only plain data are built. OpenCV's matrices become dictionaries with `rows`, `cols` and `data`. Numbers of XML
    files stay text.

    Raises:
        FileNotFoundError: The file doesn't exist.
        FormatError: It is no regular file, has more than 1 MiB, or can't be parsed.
    """
    text = _text_of(Path(path))
    parse = {"<": _xml, "{": _json}.get(text.lstrip()[:1], _yaml)
    try:
        content = parse(text)
    except (ValueError, ElementTree.ParseError, RecursionError) as error:
        raise FormatError(path, f"is not a valid calibration file: {line_of(error)}") from None
    if not isinstance(content, dict):
        raise FormatError(path, "is not a calibration file: it has no names of values")
    return content


def _text_of(path: Path) -> str:
    if not stat.S_ISREG(path.stat().st_mode):
        raise FormatError(path, "is not a file, so it can't be a calibration")
    with path.open("rb") as file:
        content = file.read(MOST + 1)
    if len(content) > MOST:
        raise FormatError(path, f"has more than {MOST >> 20} MiB, so it isn't a calibration of a camera")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(path, f"is not text: {error.reason}", offset=error.start) from None


def _json(text: str) -> Any:
    return json.loads(text)


def _yaml(text: str) -> Any:
    # takes a while to import
    import yaml

    # of Python's loader, not that of C, which can overflow the stack
    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Loader of plain data and of OpenCV's matrices, without merge keys, which can multiply a file's content."""

        def flatten_mapping(self, node: Any) -> None:
            pass

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, True))
    if text.startswith("%YAML"):
        # OpenCV's first line, %YAML:1.0, isn't YAML
        text = text.partition("\n")[2]
    try:
        return yaml.load(text, Loader)
    except RecursionError:
        raise
    except Exception as error:  # any error of a constructor, too, such as a KeyError for !!bool 5
        raise ValueError(line_of(error)) from None


def _xml(text: str) -> Any:
    if "<!DOCTYPE" in text:
        raise ValueError("it defines entities, which calibrations don't")
    return _content(ElementTree.fromstring(text))


def _content(element: ElementTree.Element) -> Any:
    if len(element):
        return {child.tag: _content(child) for child in element}
    words = (element.text or "").split()
    return words[0] if len(words) == 1 else words
