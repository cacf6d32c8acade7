"""Run time of the graph networks and their layers, as ratios to peers in the same run.

    python recipes/bench/networks.py --out networks.json
    python recipes/bench/networks.py --nmnist N-MNIST --recording davis240.aedat --device cuda

One core. Graphs of 1,000 nodes show the outlines of squares that move over a sensor of 240x180. Latency is from a
recording's window to its class, for recordings of --nmnist, for --recording, or for such outlines.
torch_spline_conv is left out if it isn't installed.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from racing import race

import nvsdata
from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T
from nvsdata.data.grid import to_grid
from nvsdata.models import GraphPool, SplineConv
from nvsdata.models.spline import spline_conv, spline_conv_torch

Row = dict[str, Any]
SENSOR = (240, 180)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nmnist", type=Path, help="N-MNIST recordings")
    parser.add_argument("--recording", type=Path, help="recording of a 240x180 sensor")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    device = torch.device(args.device)
    graphs = [T.radius_graph(outlines(seed, 1_000)) for seed in range(64)]
    rows = [*layers(GraphBatch.from_graphs(graphs[:16]).to(device)), pooling(GraphBatch.from_graphs(graphs).to(device))]
    rows += [latency("n-mnist", digits(args.nmnist), device), latency("asl-dvs", windows(args.recording), device)]
    rows.append(graph2grid(device))
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    if args.out:
        machine = {"processor": platform.processor() or platform.machine(), "torch": torch.__version__}
        args.out.write_text(json.dumps({"machine": machine, "device": args.device, "rows": rows}, indent=1))


def outlines(seed: int, count: int, duration: int = 30_000) -> Events:
    """Events of the outlines of four moving squares."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, duration, count))
    side, x, y, vx, vy = (rng.uniform(low, high, 4) for low, high in ((20, 50), (0, 180), (0, 120), (0, 9), (0, 9)))
    which, along, edge = rng.integers(0, 4, count), rng.uniform(0, 1, count), rng.integers(0, 4, count)
    across = np.where(edge % 2, along, edge // 2), np.where(edge % 2, edge // 2, along)
    px = x[which] + side[which] * across[0] + vx[which] * t / duration
    py = y[which] + side[which] * across[1] + vy[which] * t / duration
    xs, ys = (np.clip(np.rint(p), 0, top - 1).astype(np.int16) for p, top in ((px, SENSOR[0]), (py, SENSOR[1])))
    return Events(t, xs, ys, rng.integers(0, 2, count), SENSOR)


def layers(batch: GraphBatch) -> list[Row]:
    """Forward and backward of each B-spline convolution of the RG-CNN for 240x180."""
    model = models.rgcnn("asl-dvs").to(batch.x.device)
    given: dict[str, tuple[torch.Tensor, ...]] = {}
    for name, module in model.named_modules():
        if isinstance(module, SplineConv):
            module.register_forward_hook(
                lambda module, inputs, _, name=name: given.__setitem__(name, (*inputs, module.weight))
            )
    model(batch)
    return [layer(name, *(tensor.detach() for tensor in tensors)) for name, tensors in given.items()]


def layer(name: str, x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor, weight: torch.Tensor) -> Row:
    """The row of one layer."""
    cells, width, out = weight.shape
    size = round(cells**0.5)

    def ours(x: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        return spline_conv(x.new_zeros(x.shape[0], out), x, edges, u, weight, size)

    def plain(x: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        return gather_scatter(x, edges, u, weight, size)

    runs = {"ours": ours, "gather-scatter": plain}
    if x.device.type != "cpu":
        runs["aggregated"] = lambda x, w: spline_conv_torch(x.new_zeros(x.shape[0], out), x, edges, u, w, size)
    try:
        from torch_spline_conv import spline_conv as theirs

        sizes = torch.tensor([size, size], device=x.device)
        is_open = torch.ones(2, dtype=torch.uint8, device=x.device)
        runs["torch_spline_conv"] = lambda x, w: theirs(x, edges, u, w, sizes, is_open, 1, True, None, None)
    except ImportError:
        pass
    expected = plain(x.double(), weight.double())
    error = ((ours(x, weight).double() - expected).abs().max() / expected.abs().max()).item()
    times = race({kind: stepper(run, x, weight) for kind, run in runs.items()})
    row: Row = {"what": f"{name} {width}->{out}", "nodes": x.shape[0], "edges": edges.shape[1]}
    row |= {"ours_ms": round(times["ours"] * 1e3, 3), "error": f"{error:.0e}"}
    return row | {f"x {kind}": round(spent / times["ours"], 1) for kind, spent in times.items() if kind != "ours"}


def stepper(run: Callable[..., torch.Tensor], x: torch.Tensor, weight: torch.Tensor) -> Callable[[], None]:
    """A function that runs forward and backward."""
    x, weight = x.clone().requires_grad_(), weight.clone().requires_grad_()

    def step() -> None:
        x.grad = weight.grad = None
        run(x, weight).sum().backward()
        settle(x.device)

    return step


def gather_scatter(
    x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor, weight: torch.Tensor, size: int
) -> torch.Tensor:
    """The obvious implementation: products of all nodes with all cells, gathered and summed along edges."""
    source, target = edges
    v = u.to(x.dtype) * (size - 1)
    lower = v.floor().clamp(max=max(size - 2, 0)).long()
    upper = v - lower
    degree = torch.bincount(target, minlength=x.shape[0]).clamp(min=1).to(x.dtype)
    products = torch.einsum("nc,kco->nko", x, weight).flatten(0, 1)
    out = x.new_zeros(x.shape[0], weight.shape[2])
    for a in range(min(size, 2)):
        for b in range(min(size, 2)):
            share = (upper[:, 0] if a else 1 - upper[:, 0]) * (upper[:, 1] if b else 1 - upper[:, 1])
            row = source * size**2 + lower[:, 0] + a + size * (lower[:, 1] + b)
            out = out.index_add(0, target, (share / degree[target]).unsqueeze(1) * products[row])
    return out


def pooling(batch: GraphBatch) -> Row:
    """Share of the forward pass that the graph poolings take."""
    model = models.rgcnn("asl-dvs").to(batch.x.device).eval()
    spent = {"pool": 0.0, "all": 0.0}
    began = [0.0]

    def clock() -> float:
        settle(batch.x.device)
        return time.perf_counter()

    for module in model.modules():
        if isinstance(module, GraphPool):
            module.register_forward_pre_hook(lambda *_: began.__setitem__(0, clock()))
            module.register_forward_hook(lambda *_: spent.__setitem__("pool", spent["pool"] + clock() - began[0]))
    with torch.no_grad():
        model(batch)
        spent["pool"] = 0.0
        for _ in range(10):
            start = clock()
            model(batch)
            spent["all"] += clock() - start
    share = spent["pool"] / spent["all"]
    what = f"pooling of {batch.num_graphs} graphs of 1,000 nodes"
    return {"what": what, "forward_ms": round(spent["all"] * 100, 2), "share": f"{share:.1%}", "aim": "15%"}


def latency(name: str, recordings: list[Any], device: torch.device) -> Row:
    """Time in ms from a window of a recording to its class, batch size 1: median and 99th percentile.

    The network as trained and the network fused for inference take turns.
    """
    model = models.rgcnn(name).to(device).eval()
    runs = {"": model, "fused_": models.fused(model)}
    sampling = [] if name == "n-mnist" else [T.NonUniformSample(8)]
    pipeline = T.Compose([T.RandomWindow(30_000), *sampling, T.RadiusGraph()])
    spent: dict[str, list[float]] = {kind: [] for kind in runs}
    nodes = []
    with torch.inference_mode():
        for n in range(600):
            for kind, network in runs.items():
                start = time.perf_counter()
                graph = pipeline(recordings[n % len(recordings)])
                network(graph.to(device)).argmax().item()
                spent[kind].append((time.perf_counter() - start) * 1e3)
            nodes.append(graph.num_nodes)
    row: Row = {"what": f"window to class, RG-CNN {name}, {np.mean(nodes):.0f} nodes"}
    for kind, times in spent.items():
        median, worst = np.percentile(times[100:], (50, 99))
        row |= {f"{kind}median_ms": round(float(median), 2), f"{kind}p99_ms": round(float(worst), 2)}
    return row


def digits(root: Path | None) -> list[Any]:
    """Undecoded recordings of N-MNIST; without `root`, outlines on its sensor."""
    if root is None:
        events = [outlines(seed, 4_000, 300_000) for seed in range(32)]
        return [Events(e.t, e.x * 33 // 239, e.y * 33 // 179, e.p, (34, 34)) for e in events]
    paths = sorted(root.rglob("*.bin"))[::20]
    return [nvsdata.open(path, sensor_size=(34, 34)) for path in paths]


def windows(path: Path | None) -> list[Any]:
    """A recording of 240x180; without `path`, outlines."""
    return [outlines(seed, 80_000, 300_000) for seed in range(32)] if path is None else [nvsdata.open(path)]


def graph2grid(device: torch.device) -> Row:
    """Features of 16 x 8 graphs on a 30x30 grid, compared with one `index_copy_` of the same size."""
    cells, channels = 900, 128
    graphs = torch.arange(16 * 8, device=device).repeat_interleave(600)
    at = torch.stack([torch.randperm(cells, device=device)[:600] for _ in range(16 * 8)]).flatten()
    pos = torch.stack((at % 30 * 8, at // 30 * 6), 1).float()
    x = torch.rand(len(at), channels, device=device)
    flat = graphs * cells + at

    def copy() -> None:
        x.new_zeros(16 * 8 * cells, channels).index_copy_(0, flat, x)
        settle(device)

    def ours() -> None:
        to_grid(x, pos, graphs, 128, 8, (8, 6), (30, 30))
        settle(device)

    times = race({"ours": ours, "copy": copy}, inner=5)
    ratio = times["ours"] / times["copy"]
    return {
        "what": "Graph2Grid",
        "ours_ms": round(times["ours"] * 1e3, 2),
        "x index_copy_": round(ratio, 2),
        "aim": 1.5,
    }


def settle(device: torch.device) -> None:
    """Wait for the device."""
    if device.type == "cuda":
        torch.cuda.synchronize()


if __name__ == "__main__":
    main()
