"""Estimate what datasets of 28 GB to 42 TB need on 1 to 1,000 machines, from constants that are measured here.

    python recipes/bench/scale.py --root N-MNIST --dataset n-mnist --write docs/scale.md

Measured on one core: packing and verifying of recordings, windows from a store, and opening an index of --recordings
recordings, in a process of its own. Assumed, because they are properties of a cluster: cores, network, latency and
prices (`CLUSTER`, `PRICES`). The tables replace those in the file between two comments.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import nvsdata
from nvsdata.common.files import put
from nvsdata.common.machine import machine
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.registry import dataset_named
from nvsdata.datasets.store.index import BEGIN, file_head, packed_index
from nvsdata.datasets.store.reader import Store

MARKS = "<!-- figures by recipes/bench/scale.py -->", "<!-- end of figures -->"
WINDOW = 30_000  # µs
BLOCK = 8 << 20  # bytes of a request
# recordings of UCF101-DVS; the other sizes have recordings of the same length
MEAN = 28e9 / 13_320
SIZES = {"28 GB": 28e9, "2.8 TB": 2.8e12, "42 TB": 42e12}
MACHINES = 1, 16, 1_000
# of each machine: cores, bytes/s of its disk and network, s from a request to its first byte, simultaneous requests
CLUSTER = {"cores": 8, "disk": 2e8, "network": 1.25e9, "latency": 0.05, "requests": 8}
# bytes/s of a remote store that a core takes: 28 kB in 215 µs (docs/dev/measurements/store.md)
REMOTE = 1.3e8
# US dollars: per GB and month stored, per request, per GB sent out of the provider's network (AWS S3, us-east-1, 2025)
PRICES = {"month": 0.023, "request": 4e-7, "egress": 0.09}


@dataclass(frozen=True)
class Measured:
    """Constants of one core of this machine.

    Args:
        packing: Bytes of a store that are packed per second.
        verifying: Bytes of a store that are verified per second.
        window: Seconds to read a window.
        opening: Seconds to open a dataset, per recording.
        memory: Bytes of memory of an open dataset, per recording.
    """

    packing: float
    verifying: float
    window: float
    opening: float
    memory: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True, help="folder of a dataset")
    parser.add_argument("--dataset", required=True, help="its name")
    parser.add_argument("--recordings", type=int, default=1_000_000, help="recordings of the index (default 1e6)")
    parser.add_argument("--write", type=Path, help="file whose tables are replaced (default: print them)")
    parser.add_argument("--opened", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.opened:
        print(json.dumps(opened(args.opened)))
        return
    found = measured(dataset_named(args.dataset).complete(args.root), args.recordings)
    text = "\n\n".join((constants(found, args.recordings), *(table(found, name) for name in SIZES)))
    if args.write is None:
        print(text)
        return
    before, _, rest = args.write.read_text().partition(MARKS[0])
    put(args.write, f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{rest.partition(MARKS[1])[2]}".encode())


def measured(dataset: EventDataset, recordings: int) -> Measured:
    """Measure the constants."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.nvs"
        packing = best(lambda: nvsdata.pack(dataset, path, overwrite=True), 3)
        size = path.stat().st_size
        store = type(dataset)(path, dataset.split_name)
        source = store.source
        assert isinstance(source, Store)
        verifying = best(lambda: [source.fault(name) for name in source.names], 5)
        order = np.random.default_rng(0).permutation(len(store)).tolist()

        def windows() -> None:
            for index in order:
                recording = store.recording(index)
                recording.read(recording.start, recording.start + WINDOW)

        window = best(windows, 5) / len(store)
        large = Path(folder) / "large.nvs"
        put(large, synthetic(recordings))
        command = [sys.executable, __file__, "--root", folder, "--dataset", "n-mnist", "--opened", str(large)]
        runs = [json.loads(subprocess.check_output(command)) for _ in range(3)]
        seconds, memory = (min(values) for values in zip(*runs, strict=True))
    return Measured(size / packing, size / verifying, window, seconds / recordings, memory / recordings)


def best(work: Callable[[], object], times: int) -> float:
    """Return the shortest CPU time of several runs in seconds, in which other programs disturb least."""
    spent = []
    for _ in range(times):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return min(spent)


def synthetic(recordings: int) -> bytes:
    """Return a store whose index has as many recordings; only its index is right."""
    names = [f"{('Train', 'Test')[i % 2]}/{i % 10}/{i:07d}.bin" for i in range(recordings)]
    place = BEGIN + 8 * np.arange(recordings + 1)
    facts = {"dataset": "n-mnist", "split": "all", "fold": 0}
    folders = [".", *sorted({name.rsplit("/", 1)[0] for name in names})]
    numbers = {"place": place, "bytes": [1] * recordings, "check": [0] * recordings}
    index = packed_index(facts, name=names, folder=folders, **numbers)
    return file_head(int(place[-1]), index) + bytes(8 * recordings) + index


def opened(path: Path) -> tuple[float, float]:
    """Open a store; return the seconds and the bytes of memory that this takes beyond the modules that it imports."""
    small = path.with_name("small.nvs")
    put(small, synthetic(1))
    nvsdata.NMNIST(small, "all")
    before, began = resident(), time.process_time()
    dataset = nvsdata.NMNIST(path, "all")
    seconds = time.process_time() - began
    return seconds, resident() - before if len(dataset) else 0.0


def resident() -> float:
    """Return the memory of this process in bytes (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4_096.0


def constants(found: Measured, recordings: int) -> str:
    """Return what was measured and assumed."""
    rows = (
        ("packing a folder, one core", f"{found.packing / 1e6:,.0f} MB/s"),
        ("verifying a store, one core", f"{found.verifying / 1e6:,.0f} MB/s"),
        ("a window of 30 ms from a local store, one core", f"{found.window * 1e6:,.0f} µs"),
        (f"opening a dataset of {recordings:,} recordings", f"{found.opening * recordings:,.1f} s"),
        ("its memory, in each process that doesn't share it", f"{found.memory * recordings / 1e6:,.0f} MB"),
    )
    lines = [f"Measured on {machine()}:", "", "| what | CPU time or rate |", "|---|---|"]
    return "\n".join([*lines, *(f"| {what} | {value} |" for what, value in rows)])


def table(found: Measured, name: str) -> str:
    """Return what a size needs on each number of machines."""
    size = SIZES[name]
    count = size / MEAN
    lines = [
        f"**{name}: {count:,.0f} recordings, {size / BLOCK:,.0f} blocks, "
        f"${size / 1e9 * PRICES['month']:,.0f} a month to store**",
        "",
        "| machines | packing | fetching or pushing | opening, memory of each process | an epoch, remote |",
        "|---|---|---|---|---|",
    ]
    for machines in MACHINES:
        cores = machines * CLUSTER["cores"]
        copying = {
            "network": size / (machines * CLUSTER["network"]),
            "latency": size / BLOCK * CLUSTER["latency"] / (machines * CLUSTER["requests"]),
        }
        packing = {"disk": size / (machines * CLUSTER["disk"]), "cores": size / found.packing / cores}
        index = count * found.opening
        reading = count * found.window / cores + size / REMOTE / cores
        epoch = {**copying, "cores": reading, "opening of the index": index}
        cells = (
            f"{machines:,}",
            longest(packing),
            longest(copying),
            f"{duration(index)}, {count * found.memory / 1e9:,.2f} GB",
            f"{longest(epoch)}, ${size / BLOCK * PRICES['request']:,.2f}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def longest(steps: dict[str, float]) -> str:
    """Return the duration of the longest of some steps at the same time, and its name."""
    name = max(steps, key=lambda step: steps[step])
    return f"{duration(steps[name])} ({name})"


def duration(seconds: float) -> str:
    """Return a duration in words."""
    for unit, length in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:,.1f} {unit}"
    return f"{seconds:,.2f} s"


if __name__ == "__main__":
    main()
