"""Benchmarks of reading event files, entire and in windows, and of their size on disk."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle, product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from nvsdata import formats
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import random_events, sensor_recording
from nvsdata.benchmarks.peers.readers import READERS, differing
from nvsdata.data.events import Events

SIZE = 128, 128
DIFFERENT = "events that differ from those written"
SUFFIXES = ".bin", ".dat", ".aedat", ".aedat3", ".aedat4", ".h5", ".npy", ".txt"
EVT = {".evt2.raw": "evt2", ".evt21.raw": "evt2.1", ".evt3.raw": "evt3"}
SLOW = ".txt", ".npy"
STORED = ".h5", ".h5, gzip", ".h5, lzf", ".aedat4", ".evt3.raw", ".evt2.raw", ".dat", ".npy"


def cases(options: Options) -> list[Case]:
    """Return the cases: entire files, compared with other libraries; larger files; windows; file sizes."""
    return [*_entire_files(options), *_matlab(options), *_growing(options), *_windows(options), *_sizes(options)]


def _entire_files(options: Options) -> Iterator[Case]:
    count = 200_000 if options.quick else 2_000_000
    for suffix in (*SUFFIXES, *EVT):
        amount = count // 10 if suffix in SLOW else count
        case = partial(Case, "decode", f"a file of {suffix}", size={"events": amount}, error_kind=DIFFERENT)
        yield case(partial(_read, options, suffix, amount, _ours), default=True)
        yield case(partial(_copy, options, suffix, amount), library="copy of the bytes")
        for library, reader in READERS.get(suffix, {}).items():
            yield case(partial(_read, options, suffix, amount, reader), library=library, package=library.split()[0])


def _matlab(options: Options) -> Iterator[Case]:
    """Yield the cases of a compressed .mat file like those of ASL-DVS."""
    for library, reader in {"nvsdata": _ours, "scipy": _loadmat, "zlib, decompression alone": _inflated}.items():
        make = partial(_mat, options, reader)
        kind = "" if reader is _inflated else DIFFERENT
        yield Case("decode", "a file of .mat", make, library, size={"events": 28_000}, error_kind=kind)


def _growing(options: Options) -> Iterator[Case]:
    top = 6 if options.quick else 8
    for suffix, power in product((".dat", ".evt3.raw", ".h5"), range(3, top + 1)):
        make = partial(_read, options, suffix, 10**power, _ours)
        yield Case(
            *("decode", f"growing files of {suffix}", make),
            size={"events": 10**power},
            axis="events",
            error_kind=DIFFERENT,
            alone=True,
        )


def _windows(options: Options) -> Iterator[Case]:
    count = 200_000 if options.quick else 2_000_000
    for suffix, fraction in product((".dat", ".evt3.raw", ".aedat4", ".h5", ".npy"), (0.001, 0.01, 0.1, 1.0)):
        yield Case(
            *("decode", f"a window of an open file of {suffix}", partial(_window, options, suffix, count, fraction)),
            settings={"fraction of the file": fraction},
            size={"events": int(count * fraction)},
            axis="fraction of the file",
            error_kind=DIFFERENT,
        )


def _sizes(options: Options) -> Iterator[Case]:
    """Yield cases that compare formats: the bytes per event on disk, as error, and the time to read or to write."""
    # no time of writing for compressed HDF5: h5py compresses a file that was written before
    read, written = [(name, "read") for name in STORED], [(name, "write") for name in STORED if "," not in name]
    for name, what in read + written:
        yield Case(
            *("decode", f"{what} a recording", partial(_stored, options, name, what == "write")),
            settings={"format": name},
            axis="format",
            default=name == ".h5",
            error_kind="bytes per event",
        )


def written(options: Options, suffix: str, count: int) -> tuple[Path, Events]:
    """Return a file with random events, which is written at the first call, and the events."""
    events = random_events(count, SIZE, duration=max(4 * count, 1000))
    path = options.scratch / f"{count}{suffix}"
    if not path.exists():
        formats.write(events, path, format=EVT.get(suffix))
    return path, events


def _read(options: Options, suffix: str, count: int, reader: Callable[[Path], Callable[[], Any]]) -> PreparedCase:
    path, events = written(options, suffix, count)
    return PreparedCase(
        reader(path),
        partial(differing, events),
        counters=lambda found: {"bytes": path.stat().st_size},
    )


def _copy(options: Options, suffix: str, count: int) -> PreparedCase:
    """Return a case that copies the bytes of a file; its time is a lower bound for all readers."""
    return PreparedCase(np.fromfile(written(options, suffix, count)[0], np.uint8).copy)


def _mat(options: Options, reader: Callable[[Path], Callable[[], Any]]) -> PreparedCase:
    path, events = options.scratch / "asl.mat", random_events(28_000, SIZE, duration=100_000)
    if not path.exists():
        # the types that MATLAB uses
        columns: list[np.ndarray] = [events.t.astype(np.uint32), *(c.astype(np.uint8) for c in events.columns[1:])]
        named = zip(("ts", "x", "y", "pol"), columns, strict=True)
        scipy.io.savemat(path, {name: column[:, None] for name, column in named}, do_compression=True)
    return PreparedCase(reader(path), None if reader is _inflated else partial(differing, events))


def _loadmat(path: Path) -> Callable[[], Any]:
    def run() -> Any:
        found = scipy.io.loadmat(path)
        return dict(zip("txyp", (found[name].ravel() for name in ("ts", "x", "y", "pol")), strict=True))

    return run


def _inflated(path: Path) -> Callable[[], Any]:
    """Decompress the elements after the header of 128 bytes with zlib, and do nothing else."""
    data, at, pieces = path.read_bytes(), 128, []
    while at + 8 <= len(data):
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        pieces.append(data[at + 8 : at + 8 + size])
        at += 8 + size
    return lambda: [zlib.decompress(piece) for piece in pieces]


def _ours(path: Path) -> Callable[[], Events]:
    return lambda: formats.read(path, sensor_size=SIZE)


def _window(options: Options, suffix: str, count: int, fraction: float) -> PreparedCase:
    """Prepare windows at random times of a recording that stays open."""
    path, events = written(options, suffix, count)
    recording = formats.open(path, sensor_size=SIZE)
    length = int(events.duration * fraction)
    begins = cycle(np.random.default_rng(0).integers(0, max(events.end - length, 1), 256).tolist())
    # the first call makes the index
    recording.read(0, 1)

    def run() -> tuple[int, Events]:
        begin = next(begins)
        return begin, recording.read(begin, begin + length)

    return PreparedCase(run, lambda found: differing(events.window(found[0], found[0] + length), found[1]))


def _stored(options: Options, name: str, write: bool) -> PreparedCase:
    events = sensor_recording(options)
    suffix, _, compression = name.partition(", ")
    path = options.scratch / f"kept-{compression}{suffix}"

    def save() -> None:
        formats.write(events, path, format=EVT.get(suffix))
        if compression:
            _compress(path, compression)

    save()
    run = save if write else lambda: formats.read(path, sensor_size=events.sensor_size)
    return PreparedCase(run, lambda found: path.stat().st_size / len(events))


def _compress(path: Path, compression: str) -> None:
    """Rewrite an HDF5 file with compressed columns."""
    packed = path.with_suffix(".packed")
    with h5py.File(path) as file, h5py.File(packed, "w") as target:
        target.attrs.update(file.attrs)

        def copy(name: str, one: h5py.Dataset | h5py.Group) -> None:
            if isinstance(one, h5py.Dataset):
                how = {"compression": compression, "shuffle": True, "chunks": True} if one.size else {}
                made = target.create_dataset(name, data=one[()], **how)
            else:
                made = target.require_group(name)
            made.attrs.update(one.attrs)

        file.visititems(copy)
    packed.replace(path)
