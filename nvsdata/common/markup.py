"""Text and data as parts of HTML pages, whatever they contain."""

from __future__ import annotations

import html
import json

from nvsdata.common.errors import shown


def as_html(text: object, keep: str = "") -> str:
    """Text for an HTML page, within an element or a quoted attribute; see `shown` for what else is escaped."""
    return html.escape(shown(text, keep))


def as_script(value: object) -> str:
    """Numbers, texts, lists and dicts as JSON for a script element of an HTML page, which no text in it can end."""
    return json.dumps(value).replace("<", "\\u003c")
