"""Opening every recording to see whether it is sound."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from nvsdata import formats
from nvsdata.datasets import DATASETS
from nvsdata.datasets.source import Folder, Source, recordings_in
from nvsdata.datasets.store import Store
from nvsdata.formats.text import looks_like


def problems(root: Path, dataset: str | None = None) -> Iterator[tuple[str, str]]:
    """Name and fault of every recording below `root`, or in a packed store, that isn't sound.

    Faults are: unreadable, empty, truncated, out of order in time, events outside the sensor. The
    sensor is that of `dataset` if one is named; its class then says which files are recordings.
    FileNotFoundError if there is nothing at `root`, FormatError for a file that is no store.
    """
    if not root.exists():
        raise FileNotFoundError(f"{root}: there is nothing to verify")
    size = None
    source: Source
    if dataset is not None:
        found = DATASETS[dataset](root, "all")
        source, names, size = found.source, found.recording_names(), found.opened_with
        yield from ((name, "empty") for name in found.skipped)
    elif root.is_file():
        source = Store(root)
        names = source.names
    else:
        source = Folder(root)
        # lists of splits and labels are text, too
        texts = (".txt", ".csv")
        found_names = recordings_in(source.listing())
        names = [n for n in found_names if not (n.lower().endswith(texts) and _is_list(root / n))]
    if not names:
        raise FileNotFoundError(f"no recordings below {root}")
    for name in tqdm(names, "verifying", unit="rec", disable=None):
        for fault in _faults(source, name, size):
            yield name, fault
        if isinstance(source, Store) and source.damaged(name):
            yield name, "its events fail their checksum"


def _is_list(path: Path) -> bool:
    """Whether a text file holds something else than events, as lists of splits and labels do."""
    with path.open("rb") as file:
        return not looks_like(file.read(4096), 0)


def _faults(source: Source, name: str, size: tuple[int, int] | None) -> Iterator[str]:
    try:
        if isinstance(source, Folder):
            recording = formats.open(source.root / name, sensor_size=size, strict=False)
        else:
            recording = source.open(name, size)
        events = recording.read()
    except (OSError, ValueError) as error:
        yield str(error)
        return
    yield from (f"{count} {what}" for what, count in recording.repairs.items())
    if not len(events):
        yield "empty"
