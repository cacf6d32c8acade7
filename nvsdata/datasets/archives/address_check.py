"""Whether the addresses of a dataset still lead to its files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import requests

from nvsdata.datasets.archives.transfer import probe
from nvsdata.datasets.facts import Info

AT_ONCE = 8  # addresses that are asked at the same time
PAGE = "its page"


class AddressCheck(NamedTuple):
    """An address, and what came of asking it.

    - `dataset`: name of the dataset
    - `file`: name of the archive; `PAGE` for the dataset's own page
    - `url`: the address
    - `fault`: why it isn't to be had there; empty if it is
    - `bytes`: size of the file as the server states it; None if it doesn't
    """

    dataset: str
    file: str
    url: str
    fault: str
    bytes: int | None


def check_addresses(infos: Iterable[Info]) -> list[AddressCheck]:
    """Ask every address of these datasets for its first bytes."""
    places = list(dict.fromkeys(place for info in infos for place in _places(info)))
    with ThreadPoolExecutor(AT_ONCE) as threads:
        answers = threads.map(
            lambda place: (page_fault(place[2]), None) if place[1] == PAGE else probe(place[2]), places
        )
        return [AddressCheck(*place, *answer) for place, answer in zip(places, answers, strict=True)]


def _places(info: Info) -> Iterator[tuple[str, str, str]]:
    """Dataset, file and address of the dataset's page, of its archives, and of those that contain them."""
    if info.page:
        yield info.name, PAGE, info.page
    waiting = list(info.archives)
    for archive in waiting:
        yield from ((info.name, archive.name, url) for url in archive.urls)
        if archive.within is not None:
            waiting.append(archive.within)


def page_fault(url: str) -> str:
    """Why a page can't be seen; empty if it can."""
    try:
        with requests.get(url, stream=True, timeout=30) as response:
            return "" if response.ok else f"HTTP {response.status_code} {response.reason or ''}".strip()
    except requests.RequestException as error:
        return type(error).__name__
