"""Check that the addresses of datasets still lead to their files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import requests

from nvsdata.datasets.archives.transfer import probe
from nvsdata.datasets.facts import Info

AT_ONCE = 8  # addresses that are checked at the same time
PAGE = "its page"


class AddressCheck(NamedTuple):
    """An address and the result of its check.

    Attributes:
        dataset: name of the dataset.
        file: name of the archive; `PAGE` for the dataset's own page.
        url: the address.
        fault: why the file isn't available there; empty if it is.
        bytes: size of the file as the server states it; None if it doesn't.
    """

    dataset: str
    file: str
    url: str
    fault: str
    bytes: int | None


def check_addresses(infos: Iterable[Info]) -> list[AddressCheck]:
    """Check every address of these datasets by a request for its first bytes; return the results."""
    places = list(dict.fromkeys(place for info in infos for place in _places(info)))
    with ThreadPoolExecutor(AT_ONCE) as threads:
        answers = threads.map(
            lambda place: (page_fault(place[2]), None) if place[1] == PAGE else probe(place[2]), places
        )
        return [AddressCheck(*place, *answer) for place, answer in zip(places, answers, strict=True)]


def _places(info: Info) -> Iterator[tuple[str, str, str]]:
    """Yield dataset, file and address for the dataset's page, its archives, and the archives that contain them."""
    if info.page:
        yield info.name, PAGE, info.page
    waiting = list(info.archives)
    for archive in waiting:
        yield from ((info.name, archive.name, url) for url in archive.urls)
        if archive.within is not None:
            waiting.append(archive.within)


def page_fault(url: str) -> str:
    """Return why a page isn't available; empty if it is available."""
    try:
        with requests.get(url, stream=True, timeout=30) as response:
            return "" if response.ok else f"HTTP {response.status_code} {response.reason or ''}".strip()
    except requests.RequestException as error:
        return type(error).__name__
