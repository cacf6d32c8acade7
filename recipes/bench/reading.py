"""Speed of reading: decoders, windows, .mat files, the packed store, and folder listings.

    python recipes/bench/reading.py --out reading.json

Files are made in a temporary folder and read from the page cache, on one core. Each pair of times
is the median over rounds in which ours and the other take turns, so that a slow phase of the
machine affects both. Peers (tonic, expelliarmus) are measured if they are installed.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import resource
import statistics
import tempfile
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import torch
from racing import race

import nvsdata
from nvsdata import ASLDVS, Events
from nvsdata import transforms as T
from nvsdata.datasets.source import INDEX, Folder
from nvsdata.formats import matlab

MILLION = 1_000_000
Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    parser.add_argument("--recordings", type=int, default=10_000, help="in the packed store (default 10000, 2 GB)")
    parser.add_argument("--files", type=int, default=100_800, help="in the folder that is listed (default 100800)")
    args = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    with tempfile.TemporaryDirectory() as home:
        # the listing first, because Python's garbage collector takes longer in a process with many objects
        parts = (
            lambda: listing(Path(home), args.files),
            lambda: decoding(Path(home)),
            lambda: windows(Path(home)),
            lambda: matlab_files(Path(home)),
            lambda: store(Path(home), args.recordings),
        )
        for row in (row for part in parts for row in part()):
            print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
            rows.append(row)
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1))


def moving(n: int, size: tuple[int, int], seed: int = 0, duration: int = MILLION) -> Events:
    """Events of a random scene."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, duration, n))
    return Events(t, rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n), size)


def decoding(home: Path) -> list[Row]:
    """Files of 2 and of 20 million events, compared with a plain copy of their bytes and with peers.

    Events of the larger files no longer fit into memory that the process has already used.
    """
    rows = []
    for millions, suffix in product((2, 20), (".bin", ".dat", ".aedat", ".aedat3")):
        path = home / f"events{suffix}"
        ev = moving(millions * MILLION, (128, 128), duration=8 * MILLION)
        nvsdata.write(ev, path)
        raw = np.fromfile(path, np.uint8)
        runs: dict[str, Callable[[], Any]] = {
            "ours": lambda path=path: nvsdata.read(path, sensor_size=(128, 128)),
            "copy": raw.copy,
            **peers(suffix, path),
        }
        times = race(runs)
        rate = len(ev) / times["ours"] / 1e6
        row: Row = {"what": f"decode {millions} M events of {suffix}", "Mevents/s": round(rate)}
        row |= {f"{name}_ms": round(spent * 1e3, 2) for name, spent in times.items()}
        row |= {f"ratio_to_{name}": round(spent / times["ours"], 2) for name, spent in times.items() if name != "ours"}
        rows.append(row)
    return rows


def windows(home: Path) -> list[Row]:
    """Random 30 ms windows of a recording that is kept open, compared with opening the file and reading their bytes."""
    rows = []
    begins = np.random.default_rng(0).integers(0, 8 * MILLION - 30_000, 400).tolist()
    ev = moving(2 * MILLION, (128, 128), duration=8 * MILLION)
    for suffix in (".bin", ".dat", ".aedat", ".aedat3", ".h5", ".npy"):
        path = home / f"windows{suffix}"
        nvsdata.write(ev, path)
        recording = nvsdata.open(path, sensor_size=(128, 128))
        each = path.stat().st_size / (8 * MILLION)
        times = race(
            {
                "ours": lambda recording=recording: [recording.read(t, t + 30_000) for t in begins],
                "bare": lambda path=path, each=each: [
                    bare_read(path, int(t * each), int(30_000 * each)) for t in begins
                ],
            }
        )
        row: Row = {"what": f"windows of 30 ms of {suffix}"}
        rows.append(row | {f"{name}_us": round(spent / len(begins) * 1e6, 1) for name, spent in times.items()})
    return rows


def bare_read(path: Path, at: int, size: int) -> None:
    """Only the system calls that every read needs."""
    descriptor = os.open(path, os.O_RDONLY)
    os.fstat(descriptor)
    os.preadv(descriptor, (bytearray(size),), at)
    os.close(descriptor)


def peers(suffix: str, path: Path) -> dict[str, Callable[[], Any]]:
    """Other readers of the same file."""
    found: dict[str, Callable[[], Any]] = {}
    with suppress(ImportError):
        if suffix == ".dat":
            import expelliarmus

            wizard = expelliarmus.Wizard("dat")
            found["expelliarmus"] = lambda: wizard.read(str(path))
    with suppress(ImportError):
        from tonic import io as tonic

        if suffix == ".bin":
            types = np.dtype([("x", int), ("y", int), ("t", int), ("p", int)])
            found["tonic"] = lambda: tonic.read_mnist_file(str(path), types)
        elif suffix == ".aedat":
            found["tonic"] = lambda: by_tonic(tonic, path, 2.0, (8, 1, 0))
        elif suffix == ".aedat3":
            found["tonic"] = lambda: by_tonic(tonic, path, 3.1, (17, 2, 1))
    return found


def by_tonic(tonic: Any, path: Path, version: float, shifts: tuple[int, int, int]) -> Any:
    """Read an AEDAT file with parts of tonic: the readers of tonic 1.7.0 fail on what its header reader returns."""
    _, start, *_ = tonic.read_aedat_header_from_file(str(path))
    raw = tonic.get_aer_events_from_file(str(path), version, start)
    x, y, p = (raw["address"] >> shift & mask for shift, mask in zip(shifts, (127, 127, 1), strict=True))
    return tonic.make_structured_array(x, y, raw["timeStamp"], p)


def matlab_files(home: Path) -> list[Row]:
    """A file like those of ASL-DVS, compared with inflating its bytes and with scipy's reader."""
    ev = moving(28_000, (240, 180), duration=100_000)
    path = home / "asl.mat"
    path.write_bytes(mat_bytes(ev))
    pieces = [body for _, kind, body in elements(path) if kind == matlab.COMPRESSED]
    times = race(
        {
            "ours": lambda: nvsdata.read(path, sensor_size=(240, 180)),
            "zlib": lambda: [zlib.decompress(piece) for piece in pieces],
            "scipy": lambda: scipy.io.loadmat(path),
        },
        inner=5,
    )
    row: Row = {"what": "ASL-DVS .mat of 28,000 events"} | {f"{k}_ms": round(v * 1e3, 3) for k, v in times.items()}
    return [row | {"times_zlib": round(times["ours"] / times["zlib"], 2)}]


def elements(path: Path) -> list[tuple[int, int, bytes]]:
    """The tagged elements of a MATLAB v5 file."""
    data, at, found = path.read_bytes(), matlab.HEADER, []
    while at + 8 <= len(data):
        kind, size = (int.from_bytes(data[at + i : at + i + 4], "little") for i in (0, 4))
        found.append((at, kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    return found


def mat_bytes(ev: Events) -> bytes:
    """A compressed MATLAB v5 file, with columns of the types that MATLAB would choose."""
    file = io.BytesIO()
    columns = {"ts": ev.t.astype(np.uint32), "x": ev.x.astype(np.uint8), "y": ev.y.astype(np.uint8), "pol": ev.p}
    scipy.io.savemat(file, {name: column.reshape(-1, 1) for name, column in columns.items()}, do_compression=True)
    return file.getvalue()


def store(home: Path, recordings: int) -> list[Row]:
    """Random 30 ms windows of recordings of 28,000 events, from a store and from .mat files."""
    packed, mats = home / "asl.h5", home / "mats"
    events = [moving(28_000, (240, 180), seed, 100_000) for seed in range(20)]
    for i, ev in enumerate(events):
        (mats / "a").mkdir(parents=True, exist_ok=True)
        (mats / "a" / f"a_{i:04d}.mat").write_bytes(mat_bytes(ev))
    nvsdata.pack(ASLDVS(mats, "all"), packed)
    repeat(packed, recordings)
    window = T.RandomWindow(30_000)
    stored, files = ASLDVS(packed, "all", transform=window), ASLDVS(mats, "all", transform=window)
    order = np.random.default_rng(1).integers(0, recordings, 20_000).tolist()
    for i in order[:200]:
        stored[i]
    before, rates = resident(), []
    for part in np.array_split(order, 5):
        start = time.perf_counter()
        for i in part.tolist():
            stored[i]
        rates.append(len(part) / (time.perf_counter() - start))
    grown = resident() - before
    start = time.perf_counter()
    for i in range(200):
        files[i % len(files)]
    slow = 200 / (time.perf_counter() - start)
    rate = statistics.median(rates)
    return [
        {
            "what": f"30 ms windows of a packed store of {recordings} recordings ({packed.stat().st_size >> 20} MiB)",
            "windows/s": round(rate),
            "from_mat/s": round(slow),
            "ratio": round(rate / slow, 1),
            "resident_growth_MB": round(grown / 1e6),
        }
    ]


def repeat(path: Path, recordings: int) -> None:
    """Enlarge a store by repeating its recordings under other names."""
    from nvsdata.datasets.store.reader import COLUMNS, INDEX, checksum, packed

    with h5py.File(path, "r+") as file:
        index = {name: file[f"index/{name}"][()] for name in INDEX}
        count = len(index["base"])
        times = recordings // count
        for name in COLUMNS:
            column = file[f"events/{name}"][()]
            del file[f"events/{name}"]
            target = file.create_dataset(f"events/{name}", shape=(column.size * times,), dtype=column.dtype)
            for k in range(times):
                target[k * column.size : (k + 1) * column.size] = column
        counts = np.tile(np.diff(index["offset"]), times)
        index["offset"] = np.concatenate(([0], np.cumsum(counts)))
        for name in ("base", "duration", "mark", "bytes", "crc"):
            index[name] = np.tile(index[name], times)
        for name in ("size", "time"):
            index[name] = np.tile(index[name], (times, 1))
        for name, text in (("format", "matlab"), ("name", "a/a_{:05d}.mat")):
            index[name] = packed(text.format(i) for i in range(recordings))
        for name in INDEX:
            del file[f"index/{name}"]
            file[f"index/{name}"] = index[name]
        file.attrs["checksum"] = checksum(index)


def resident() -> int:
    """Bytes of the process that are in memory."""
    with suppress(OSError), open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def listing(home: Path, files: int) -> list[Row]:
    """Open a dataset with a folder tree like ASL-DVS's, for the first time and again."""
    root = home / "tree"
    letters = ASLDVS.info.classes
    each = files // len(letters)
    for letter in letters:
        (root / letter).mkdir(parents=True)
        for i in range(each):
            (root / letter / f"{letter}_{i:04d}.mat").touch()
    # folders that changed a moment ago aren't trusted; a user's folders are older
    for folder in (root, *(root / letter for letter in letters)):
        os.utime(folder, ns=(10**18, 10**18))
    spent = []
    for _ in range(2):
        start = time.perf_counter()
        ASLDVS(root, "all")
        spent.append(time.perf_counter() - start)
    start = time.perf_counter()
    Folder(root).listing()
    again = time.perf_counter() - start
    return [
        {
            "what": f"list {each * len(letters)} files",
            "first_s": round(spent[0], 3),
            "again_s": round(spent[1], 3),
            "of_which_index_s": round(again, 3),
            "index": (root / INDEX).exists(),
        }
    ]


if __name__ == "__main__":
    main()
