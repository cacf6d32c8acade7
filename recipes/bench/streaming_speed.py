"""Measure incremental inference, compared with the same networks on windows: time, memory, and difference of scores.

    python recipes/bench/streaming_speed.py davis240c_IMU_translBoxes.aedat n-mnist.bin         # all on one core

Exact streams are fed 1, 10, 78 (1 ms of the recording of boxes) and 1,000 events at a time. They are compared with the
graph of the window and the fused network. Causal streams are fed event by event, in windows of more and more events.
Memory and rounding errors are measured over --events events. With --recordings (the folder of N-MNIST), the classes of
all recordings are compared, streamed and as one graph.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

import nvsdata
from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.common.files import put
from nvsdata.common.text import aligned
from nvsdata.data.events import concatenate_events
from nvsdata.datasets import NMNIST
from nvsdata.training.objects import Objects
from nvsdata.transforms.events.sampling import BETA, LITERAL_BETA

WINDOW = 30_000  # µs
STEPS = 1, 10, 78, 1_000
CAUSAL: dict[str, Any] = {"clusters": (None, None, (7, 7)), "channels": (32, 64, 128), "hidden": 128}
WIDE: dict[str, Any] = {"clusters": (None, None, (60, 45)), "channels": (64, 128, 128), "hidden": 1024}
NODES = 1_000, 4_000, 16_000, 64_000
Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, nargs="+", help="recordings of sensors of 240x180 or 34x34 pixels")
    parser.add_argument("--recordings", type=Path, help="folder of N-MNIST, to compare classes (default: none)")
    parser.add_argument(
        "--events", type=int, default=1_000_000, help="number of events for memory and rounding (default 1e6)"
    )
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    args = parser.parse_args()
    torch.set_num_threads(1)
    found: dict[str, list[Row]] = {"exact": [], "causal": [], "long": [], "decisions": []}
    for path in args.recording:
        events = nvsdata.read(path)
        for beta in (BETA, LITERAL_BETA):
            found["exact"] += [exact(path.stem, events, beta, step) for step in STEPS]
        found["causal"].append(causal(path.stem, events, WINDOW))
    longest = max(map(nvsdata.read, args.recording), key=len)
    spans = [int(longest.t[nodes + 2_000] - longest.t[2_000]) for nodes in NODES if nodes + 4_000 < len(longest)]
    found["causal"] += [causal("growing windows", longest, span, CAUSAL) for span in spans]
    found["long"] = [long(args.events, causal=flag) for flag in (False, True)]
    if args.recordings:
        found["decisions"] = [decisions(args.recordings)]
    for rows in filter(None, found.values()):
        lines = [tuple(rows[0]), *(tuple(shown(value) for value in row.values()) for row in rows)]
        print(aligned(lines), end="\n\n")
    if args.out:
        put(args.out, json.dumps(found, indent=1).encode())


def exact(name: str, events: Events, beta: float, step: int) -> Row:
    """Measure an exact stream that is fed `step` events at a time."""
    small = max(events.sensor_size) <= 34
    settings = Objects("n-mnist" if small else "asl-dvs", features=(), k=1)
    network, graph = with_statistics(settings.build(events.sensor_size, 10)), T.RadiusGraph(max_degree=16, beta=beta)
    live, start = models.stream(network, WINDOW, graph), len(events) // 2
    live.feed(events[:start])
    for at in range(start, start + 3):
        live.feed(events[at : at + 1])
        live.scores()
    start += 3
    rounds = min(max(400 // step, 12), (len(events) - start) // step)
    before, times, wholes = live.products, [], []
    batch = models.fused(network)
    for k in range(rounds):
        piece = events[start + k * step : start + (k + 1) * step]
        times.append(seconds(lambda piece=piece: (live.feed(piece), live.scores())))
        last = int(piece.t[-1])
        window = events[: start + (k + 1) * step].window(last - WINDOW + 1, last + 1)
        if k % max(rounds // 12, 1) == 0:
            with torch.no_grad():
                wholes.append(min(seconds(lambda window=window: batch(graph(window))) for _ in range(2)))
    with torch.no_grad():
        expected = network(graph(window))[0]
    return {
        "exact": name,
        "beta": f"{beta:.1e}",
        "nodes": len(live),
        "events per step": step,
        "ms": 1e3 * float(np.median(times)),
        "p99": 1e3 * float(np.quantile(times, 0.99)),
        "window, ms": 1e3 * float(np.median(wholes)),
        "speedup": float(np.median(wholes) / np.median(times)),
        "M products": (live.products - before) / rounds / 1e6,
        "largest difference": float((live.scores() - expected).abs().max()),
    }


def causal(name: str, events: Events, window: int, settings: Row | None = None) -> Row:
    """Measure a causal stream that is fed event by event."""
    settings = settings or (CAUSAL if max(events.sensor_size) <= 34 else WIDE)
    graph = T.RadiusGraph(max_degree=8, causal=True)
    network = with_statistics(models.RGCNN(10, sensor_size=events.sensor_size, **settings))
    live = models.stream(network, window, graph)
    skipped = min(int(events.t.searchsorted(int(events.t[0]) + window)) + 1_000, len(events) - 1_500)
    live.feed(events[:skipped])
    live.scores()
    before, fed, read = live.products, [], []
    for at in range(skipped, skipped + 1_500):
        piece = events[at : at + 1]
        fed.append(seconds(lambda piece=piece: live.feed(piece)))
        read.append(seconds(live.scores))
    return {
        "causal": name,
        "nodes": len(live),
        "us per event": 1e6 * float(np.median(fed)),
        "p99": 1e6 * float(np.quantile(fed, 0.99)),
        "us to read scores": 1e6 * float(np.median(read)),
        "k products": (live.products - before) / 1_500 / 1e3,
    }


def long(count: int, *, causal: bool) -> Row:
    """Measure memory and rounding errors over many events."""
    rng = np.random.default_rng(0)
    graph = T.RadiusGraph(max_degree=8, causal=causal)
    network = with_statistics(models.RGCNN(10, **CAUSAL)) if causal else with_statistics(models.rgcnn("n-mnist"))
    live, now, peaks = models.stream(network, WINDOW, graph), 0, []
    kept: deque[Events] = deque(maxlen=WINDOW // 250 + 1)
    started = time.perf_counter()
    for part in range(10):
        for _ in range(count // 10 // 5):
            t = now + np.sort(rng.integers(0, 250, 5))
            now += 250
            kept.append(Events(t, *rng.integers(0, 34, (2, 5)), rng.integers(0, 2, 5), (34, 34)))
            live.feed(kept[-1])
            live.scores()
        if part:
            peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    taken = time.perf_counter() - started
    last = concatenate_events(list(kept)).window(int(kept[-1].t[-1]) - WINDOW + 1, None)
    fresh = models.stream(network, WINDOW, graph)
    fresh.feed(last)
    return {
        "long": "causal" if causal else "exact",
        "events": count,
        "us per event": 1e6 * taken / count,
        "MB after a fifth": peaks[0],
        "MB at the end": peaks[-1],
        "difference from a new stream": float("nan") if causal else float((live.scores() - fresh.scores()).abs().max()),
    }


def decisions(root: Path) -> Row:
    """Count the recordings with the same class, streamed and as one causal graph."""
    graph = T.RadiusGraph(max_degree=8, causal=True)
    network, same, apart = with_statistics(models.RGCNN(10, **CAUSAL)), 0, 0.0
    recordings = NMNIST(root, "all", transform=lambda recording: recording.read())
    for n in range(len(recordings)):
        events = recordings[n][0]
        live = models.stream(network, None, graph)
        for at in range(0, len(events), 50):
            live.feed(events[at : at + 50])
        with torch.no_grad():
            whole = network(graph(events))[0]
        same += int(live.scores().argmax() == whole.argmax())
        apart = max(apart, float((live.scores() - whole).abs().max()))
    return {"decisions": len(recordings), "same class": same, "largest difference": apart}


def with_statistics(network: Any) -> Any:
    """Give a network random statistics and weights of batch normalization, as after training."""
    torch.manual_seed(0)
    for part in network.modules():
        if getattr(part, "running_mean", None) is not None:
            part.running_mean.normal_(0, 0.2)
            part.running_var.uniform_(0.5, 1.5)
            torch.nn.init.uniform_(part.weight, 0.5, 1.5)
    return network.eval()


def seconds(work: Callable[[], Any]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)


if __name__ == "__main__":
    main()
