"""Compare incremental inference of a trained network with inference on windows: accuracy, operations, time per event.

    python recipes/bench/streaming_accuracy.py runs/digits/model.safetensors --dataset n-mnist --root N-MNIST

Windows that end at the fractions `PLACES` of each test recording are classified twice: as a graph of the window, and by
a stream that was fed the recording up to there, in pieces of 50 events. Time is measured on one core for `TIMED` single
events in each of several recordings: an event is fed, then scores are read. Operations of a window are those that are
executed (`models.complexity`); each multiplication of a stream counts as two operations.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nvsdata import models
from nvsdata.commands.options import at_least_1
from nvsdata.datasets import DATASETS
from nvsdata.training import TrainTestSplit, run

PLACES = 0.3, 0.5, 0.7, 0.9  # fractions of a recording's events
PIECE, TIMED = 50, 40


def main() -> None:
    args = arguments()
    torch.set_num_threads(1)
    trained = models.load(args.model)
    recordings = TrainTestSplit(args.dataset, args.root, seed=args.seed).test(lambda recording: recording.read())
    decider = models.OnlineClassifier(trained)
    decider.prepare()
    live, batch = decider.stream, models.fused(trained.model)
    right = {"windows": 0, "streamed": 0}
    same, count, apart, nodes = 0, 0, 0.0, []
    for events, label in (recordings[n] for n in range(len(recordings))):
        live.reset()
        done = 0
        for fraction in PLACES:
            stop = max(round(fraction * len(events)), 1)
            for at in range(done, stop, PIECE):
                live.feed(events[at : min(at + PIECE, stop)])
            done = stop
            streamed, whole = live.scores(), scores(batch, window_of(live, events[:stop])())
            count, same = count + 1, same + int(streamed.argmax() == whole.argmax())
            apart = max(apart, float((streamed - whole).abs().max()))
            right["windows"] += int(whole.argmax() == label)
            right["streamed"] += int(streamed.argmax() == label)
            nodes.append(len(live))
    found: dict[str, Any] = {
        "windows": count,
        "nodes": round(np.mean(nodes)),
        "same class": same,
        "largest difference": apart,
    }
    found |= {f"accuracy, {name}": round(value / count, 4) for name, value in right.items()}
    print(json.dumps(found | cost(live, trained.model, recordings, args.recordings), indent=1))


def cost(live: Any, model: Any, recordings: Any, some: int) -> dict[str, Any]:
    """Measure µs and MFLOP per event, and of windows."""
    batch, fed, read, whole, flops, products = models.fused(model), [], [], [], [], 0
    for n in np.linspace(0, len(recordings) - 1, min(some, len(recordings))).astype(int):
        events = recordings[n][0]
        live.reset()
        start = len(events) // 2
        live.feed(events[:start])
        for at in range(start, start + 3):
            # buffers are filled after a few steps
            live.feed(events[at : at + 1])
            live.scores()
        before = live.products
        for at in range(start + 3, min(start + 3 + TIMED, len(events))):
            fed.append(seconds(lambda events=events, at=at: live.feed(events[at : at + 1])))
            read.append(seconds(live.scores))
        products += live.products - before
        graph = window_of(live, events[: at + 1])
        whole.append(min(seconds(lambda graph=graph: scores(batch, graph())) for _ in range(2)))  # with its graph
        flops.append(models.complexity(model, graph()).executed)
    both = 1e6 * (np.array(fed) + read)
    return {
        "µs per event, fed": percentiles(1e6 * np.array(fed)),
        "µs per event, fed and scores read": percentiles(both),
        "MFLOP per event": round(2e-6 * products / len(fed), 3),
        "µs of a window": percentiles(1e6 * np.array(whole)),
        "MFLOP of a window": round(float(np.mean(flops)) / 1e6, 1),
    }


def window_of(live: Any, events: Any) -> Any:
    """Return a function that makes the graph of the stream's window after these events."""
    last = int(events.t[-1])
    return lambda: live.graph(events.window(last - live.window + 1, last + 1))


@torch.no_grad()
def scores(network: Any, graph: Any) -> torch.Tensor:
    scores: torch.Tensor = network(graph)[0]
    return scores


def percentiles(values: np.ndarray) -> dict[str, int]:
    return {"median": round(float(np.median(values))), "p99": round(float(np.quantile(values, 0.99)))}


def seconds(work: Any) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("model", type=Path, help="file of `nvsdata.models.save`, with its transform")
    add("--dataset", required=True, choices=sorted(DATASETS), help="dataset of the training")
    add("--root", required=True, type=Path, help="folder or packed store of the recordings")
    add("--seed", type=int, default=0, help="seed of the training, which determines the split (default 0)")
    add("--recordings", type=at_least_1, default=20, help="number of recordings for measuring time (default 20)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
