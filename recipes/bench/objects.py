"""Run time of the object pipeline on N-MNIST recordings, as ratios to its peers in the same run.

    python recipes/bench/objects.py --root N-MNIST --out objects.json

If a peer isn't installed (tonic; torch_cluster and torch_geometric; torch_spline_conv), there is only
the time quoted from another run. One core, except for the DataLoader's workers. Each pair of times is
the median over rounds in which ours and the peer take turns, so that a slow phase of the machine
affects both.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import NMNIST, models
from nvsdata import transforms as T
from nvsdata.transforms.defaults import BETA

SENSOR = (34, 34)
ROUNDS = 7
Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True, help="N-MNIST recordings")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    dataset = NMNIST(args.root)
    paths = [str(dataset.root / sample.name) for sample in dataset.samples][::4]
    window = T.RandomWindow(30_000)
    events = [window(nvsdata.open(path, sensor_size=SENSOR)) for path in paths]
    rows = [decode(paths), graph(events), training_step(events), loading(args.root)]
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    if args.out:
        machine = {"processor": platform.processor() or platform.machine(), "torch": torch.__version__}
        args.out.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1))


def decode(paths: list[str]) -> Row:
    """From a file to its events."""
    peer: Callable[[Any], Any] | None = None
    try:
        from tonic.io import read_mnist_file

        types = np.dtype([("x", int), ("y", int), ("t", int), ("p", int)])

        def peer(path: str) -> Any:
            return read_mnist_file(path, types)
    except ImportError:
        pass
    ours, theirs = race(lambda path: nvsdata.read(path, sensor_size=SENSOR), peer, paths)
    return line("decode a file", "tonic", ours, theirs, quoted=0.45)


def graph(events: list[nvsdata.Events]) -> Row:
    """From the events of a 30 ms window to a graph with edge attributes."""
    peer: Callable[[Any], Any] | None = None
    try:
        import torch_cluster
        from torch_geometric.data import Data
        from torch_geometric.transforms import Cartesian

        attributes = Cartesian(max_value=3.0)

        def peer(ev: nvsdata.Events) -> Any:
            scaled = (ev.t - ev.start) * BETA**0.5
            pos = torch.from_numpy(np.stack([ev.x, ev.y, scaled], 1).astype(np.float32))
            edges = torch_cluster.radius_graph(pos, 3.0, max_num_neighbors=32)
            return attributes(Data(x=torch.from_numpy(ev.p * 2.0 - 1), pos=pos[:, :2], edge_index=edges))
    except ImportError:
        pass
    ours, theirs = race(T.radius_graph, peer, events)
    nodes = statistics.mean(len(ev) for ev in events)
    return line(f"window of {nodes:.0f} events to graph", "torch_cluster + PyG", ours, theirs, quoted=0.52)


def training_step(events: list[nvsdata.Events]) -> Row:
    """Forward, backward and Adam of RG-CNN (L = 2) on a batch of 64, per sample."""
    batch, targets = nvsdata.collate([(T.radius_graph(ev), i % 10) for i, ev in enumerate(events[:64])])
    steps = [stepper(models.rgcnn("n-mnist"), batch, targets)]
    try:
        from peers import PyGRGCNN

        steps.append(stepper(PyGRGCNN(), batch.to_pyg(), targets))
    except ImportError:
        pass
    ours, theirs = race(steps[0], steps[1] if len(steps) > 1 else None, [None], rounds=5)
    return line(
        "RG-CNN training step per sample", "PyG + torch_spline_conv", ours / 64, theirs and theirs / 64, quoted=56.0
    )


def stepper(model: torch.nn.Module, batch: Any, targets: torch.Tensor) -> Callable[[Any], None]:
    """A function that trains the model by one step."""
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)

    def step(_: Any) -> None:
        optimizer.zero_grad()
        cross_entropy(model(batch), targets).backward()
        optimizer.step()

    return step


def loading(root: Path) -> Row:
    """From files to batches of 64 graphs through a DataLoader with two workers, in samples/s."""
    pipeline = T.Compose([T.RandomWindow(30_000), T.NonUniformSample(8), T.RadiusGraph()])
    dataset = torch.utils.data.ConcatDataset([NMNIST(root, transform=pipeline)] * 10)
    dataset[0]
    loader: DataLoader[Any] = DataLoader(
        dataset, batch_size=64, shuffle=True, num_workers=2, collate_fn=nvsdata.collate, persistent_workers=True
    )
    rates = []
    for _ in range(4):
        start = time.perf_counter()
        seen = sum(len(targets) for _, targets in loader)
        rates.append(seen / (time.perf_counter() - start))
    # the first pass starts the workers
    return {"what": "DataLoader, 2 workers, file to batched graphs", "samples/s": round(statistics.median(rates[1:]))}


def race(
    ours: Callable[[Any], Any], theirs: Callable[[Any], Any] | None, items: Sequence[Any], rounds: int = ROUNDS
) -> tuple[float, float | None]:
    """Median ms per item of both, in turns."""
    runners = [run for run in (ours, theirs) if run is not None]
    times: list[list[float]] = [[] for _ in runners]
    for run in runners:
        for item in items[:3]:
            run(item)
    for _ in range(rounds):
        for run, spent in zip(runners, times, strict=True):
            start = time.perf_counter()
            for item in items:
                run(item)
            spent.append((time.perf_counter() - start) / len(items) * 1e3)
    medians = [statistics.median(spent) for spent in times]
    return medians[0], medians[1] if theirs is not None else None


def line(what: str, peer: str, ours: float, theirs: float | None, quoted: float) -> Row:
    """A row: times in ms, the ratio in this run, and the ratio to the quoted time."""
    row: Row = {"what": what, "ours_ms": round(ours, 4), "peer": peer}
    if theirs is not None:
        row |= {"peer_ms": round(theirs, 4), "ratio": round(theirs / ours, 1)}
    return row | {"quoted_peer_ms": quoted, "ratio_to_quoted": round(quoted / ours, 1)}


if __name__ == "__main__":
    main()
