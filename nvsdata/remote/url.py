"""Addresses of files that aren't on the local disk."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

WEB = ("http", "https")


@dataclass(frozen=True)
class Url:
    """The URL of a remote file or folder. Its text has no passwords, so it can be shown.

    Args:
        address: the URL as the user gave it, which may have a password or a signature.

    Example:
        >>> print(Url("https://me:secret@host/a.nvs?signature=secret"))
        https://host/a.nvs?...
    """

    address: str = field(repr=False)

    def __post_init__(self) -> None:
        if "://" not in self.address:
            raise ValueError(f"{self.address!r} isn't a URL, such as s3://bucket/file.nvs")

    @property
    def scheme(self) -> str:
        """The protocol, such as "s3"."""
        return self.address.partition("://")[0].lower()

    @property
    def name(self) -> str:
        """Name of the file."""
        last = self._split()[0].rstrip("/").rpartition("/")[2]
        return unquote(last) if self.scheme in WEB else last

    def sibling(self, name: str) -> Url:
        """Return the URL of the file `name` in the same folder."""
        path, query = self._split()
        return Url(f"{path.rpartition('/')[0]}/{self._quoted(name)}{query}")

    def child(self, name: str) -> Url:
        """Return the URL of the file `name` in this folder."""
        path, query = self._split()
        return Url(f"{path.rstrip('/')}/{self._quoted(name)}{query}")

    @property
    def has_secrets(self) -> bool:
        """True if the address has parts that aren't shown."""
        return str(self) != self.address

    def __str__(self) -> str:
        path, query = self._split()
        scheme, _, rest = path.partition("://")
        host, slash, below = rest.partition("/")
        user, at, server = host.rpartition("@")
        if self.scheme in WEB:
            host = server
        elif ":" in user:
            host = f"{user.partition(':')[0]}{at}{server}"
        return f"{scheme}://{host}{slash}{below}{'?...' if query else ''}"

    def _quoted(self, name: str) -> str:
        return quote(name) if self.scheme in WEB else name

    def _split(self) -> tuple[str, str]:
        """Return the address without the query, and the query with its question mark."""
        if self.scheme not in WEB:
            return self.address, ""
        found = urlsplit(self.address)
        return f"{found.scheme}://{found.netloc}{found.path}", f"?{found.query}" if found.query else ""


def place_of(root: str | os.PathLike[str] | Url) -> Path | Url:
    """Return a path, with ~ expanded, or a URL: a text with "://", or a `Url`.

    Raises:
        ValueError: `root` is a Path made from a URL, which has lost a slash.
    """
    if isinstance(root, Url):
        return root
    if isinstance(root, Path) and len(root.parts[0] if root.parts else "") > 2 and root.parts[0].endswith(":"):
        raise ValueError(f"{root} was a URL before it became a Path: give the URL as a string")
    return Url(text) if "://" in (text := os.fspath(root)) else Path(text).expanduser()
