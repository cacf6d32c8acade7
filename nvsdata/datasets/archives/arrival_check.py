"""Check whether a downloaded file is the expected archive, and description of the file if it isn't."""

from __future__ import annotations

import hashlib
import re
from html import unescape
from pathlib import Path

from nvsdata.datasets.archives.unpack import is_archive

HEAD = 1 << 16  # bytes at a file's beginning by which web pages are recognized
QUOTA = "Google Drive's page for a used-up quota: try again in a day"


def kind_of(expected: str) -> str:
    """Return the name of a checksum's algorithm, by its number of digits."""
    return "md5" if len(expected) == 32 else "sha256"


def archive_fault(path: Path, expected: str) -> str:
    """Return why a file isn't the expected archive; empty if it is that archive.

    Args:
        path: the file.
        expected: its md5 or sha256; empty accepts any archive.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
        if not head:
            return "is empty"
        if page := page_of(head):
            return f"is {page}"
        if expected:
            file.seek(0)
            found = hashlib.file_digest(file, kind_of(expected)).hexdigest()
            return "" if found == expected else f"is another file: its {kind_of(expected)} is wrong, {found}"
    if head.startswith((b"Rar!", b"7z\xbc\xaf")):
        return "is a RAR or 7z archive, which has to be unpacked manually"
    return "" if is_archive(path) else "is not an archive, or is incomplete"


def page_of(head: bytes) -> str:
    """Return a description of the web page that a file's first bytes belong to; empty if they are not a web page."""
    if not re.match(rb"(\xef\xbb\xbf)?\s*(<!--.*?-->\s*)?<(!doctype\s+html|html)\b", head, re.IGNORECASE | re.DOTALL):
        return ""
    text = head.decode("utf-8", "replace")
    if re.search("quota exceeded|too many users have viewed or downloaded", text, re.IGNORECASE):
        return QUOTA
    title = re.search("<title[^>]*>(.*?)</title", text, re.IGNORECASE | re.DOTALL)
    words = repr(" ".join(unescape(title[1]).split())[:80]) if title else "without a title"
    return f"a web page, {words}: the file needs a browser"
