"""Networks' scores, and windows of recordings to classes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle, product
from typing import Any

import numpy as np
import torch

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.benchmarks.case import Case, Options, Ready
from nvsdata.benchmarks.inputs import DIGITS, WINDOW, digits, outlines, street
from nvsdata.benchmarks.networks import CONFIGURED, doubled, samples, settle, steady, windows
from nvsdata.data.events import Events
from nvsdata.data.graph import GraphBatch
from nvsdata.data.grid import to_grid
from nvsdata.training.objects import Objects
from nvsdata.transforms.events.sampling import BETA

RELATIVE = "largest difference of scores from float64, of the largest score"
TRAINED = "classification error on N-MNIST of networks trained with it for 40 epochs (docs/ablation.jsonl)"
# settings of the pipeline, and the errors of one window that networks trained with them had: means of three seeds
LEARNED: dict[str, dict[Any, float]] = {
    "k": {1: 0.0628, 2: 0.0723, 4: 0.0841, 8: 0.1253},
    "radius": {2.0: 0.0691, 3.0: 0.0628, 4.0: 0.0582, 5.0: 0.0534, 7.0: 0.0556},
    "max_degree": {4: 0.0628, 8: 0.0628, 16: 0.0612, 32: 0.0584},
    "beta": {BETA: 0.0628, 5e-6: 0.0737},
}
DEFAULTS: dict[str, Any] = {"k": 1, "radius": 3.0, "max_degree": 8, "beta": BETA}
# of trained networks, by windows in µs and by votes (docs/results.md)
WINDOWED = {7_500: 0.26, 15_000: 0.09, 30_000: 0.034, 60_000: 0.024}
VOTED = {1: 0.034, 2: 0.022, 3: 0.020, 4: 0.018, 5: 0.017}


def cases(options: Options) -> list[Case]:
    """Windows to classes; precision and fusing; settings of graphs against accuracy; votes; growing graphs; grids."""
    each = _latency, _precision, _settings, _every, _growing, _grid
    return [replace(case, device=options.device) for some in each for case in some(options)]


def _latency(options: Options) -> Iterator[Case]:
    for name, fuse in product(("n-mnist", "asl-dvs"), (False, True)):
        yield Case(
            *("infer", f"a 30 ms window to its class, RG-CNN {name}", partial(_window_to_class, options, name, fuse)),
            settings={"fused": fuse},
            axis="fused",
            error_kind=RELATIVE,
        )


def _precision(options: Options) -> Iterator[Case]:
    for precision, fuse in (("float64", False), ("float32", False), ("float32", True), ("bfloat16", False)):
        yield Case(
            *("infer", "scores of a batch, RG-CNN n-mnist", partial(_scores, options, precision, fuse)),
            settings={"precision": precision + (", fused" if fuse else "")},
            axis="precision",
            default=(precision, fuse) == ("float32", False),
            error_kind=RELATIVE,
        )


def _settings(options: Options) -> Iterator[Case]:
    """Tables 4.1 to 4.3: what each setting of the graph costs, and the error of networks trained with it."""
    for name, errors in LEARNED.items():
        for value in errors:
            yield Case(
                *("infer", f"a window to its class, by {name}", partial(_with_setting, options, name, value)),
                settings={name: value},
                axis=name,
                default=DEFAULTS[name] == value,
                error_kind=TRAINED,
            )
    for length in WINDOWED:
        yield Case(
            *("infer", "a window to its class, by length", partial(_of_length, options, length)),
            settings={"µs": length},
            axis="µs",
            default=length == WINDOW,
            error_kind="classification error on N-MNIST, one network for all lengths (docs/results.md)",
        )
    for votes in VOTED:
        yield Case(
            *("infer", "a recording to its class, by votes", partial(_voted, options, votes)),
            settings={"votes": votes},
            axis="votes",
            default=votes == 5,
            error_kind="classification error on N-MNIST, by votes (docs/results.md)",
        )


def _every(options: Options) -> Iterator[Case]:
    for name in CONFIGURED:
        make = partial(_configured, options, name)
        yield Case("infer", f"scores of {name}", make, error_kind=RELATIVE, alone=True)


def _growing(options: Options) -> Iterator[Case]:
    for count in (250, 1_000, 4_000, 16_000, *(() if options.quick else (64_000,))):
        yield Case(
            *("infer", "scores of growing graphs, RG-CNN asl-dvs", partial(_of_nodes, options, count)),
            size={"nodes": count},
            axis="nodes",
            alone=True,
        )


def _grid(options: Options) -> Iterator[Case]:
    case = partial(Case, "infer", "Graph2Grid, 32 graphs on 30x30 cells")
    yield case(partial(_on_grid, options, True), default=True)
    yield case(partial(_on_grid, options, False), library="one index_copy_", package="torch")
    for share in (0.01, 0.1, 1.0):
        yield Case(
            *("infer", "Graph2Grid of cells in part occupied", partial(_on_grid, options, True, share)),
            settings={"share of cells": share},
            axis="share of cells",
        )


def _network(options: Options, name: str = "n-mnist") -> torch.nn.Module:
    return steady(partial(models.rgcnn, name), options.device).eval()


def _relative(found: torch.Tensor, exact: torch.Tensor) -> float:
    return float(((found.double() - exact).abs().max() / exact.abs().max()).item())


def _window_to_class(options: Options, name: str, fuse: bool) -> Ready:
    """One window after the other, each elsewhere in a recording."""
    plain = _network(options, name)
    model = models.fused(plain) if fuse else plain
    recordings = digits(options) if name == "n-mnist" else [street(options)]
    steps = [T.Window(0, WINDOW)] if name == "n-mnist" else [T.NonUniformSample(8)]
    graph_of = T.Compose([*steps, T.RadiusGraph()])
    places = _anywhere(recordings)

    def run() -> torch.Tensor:
        with torch.inference_mode():
            scores: torch.Tensor = model(graph_of(next(places)).to(options.device))
            scores.argmax().item()
        return scores

    graph = GraphBatch.from_graphs([graph_of(next(_anywhere(recordings)))]).to(options.device)
    with torch.inference_mode():
        exact: torch.Tensor = _network(options, name).double()(doubled(graph))
    return Ready(run, lambda found: _relative(found, exact))


def _anywhere(recordings: Sequence[Events]) -> Iterator[Events]:
    """Windows without end: of one recording after the other, anywhere in it."""
    shares = np.random.default_rng(0).random(997).tolist()
    for events, share in zip(cycle(recordings), cycle(shares), strict=False):
        start = events.start + int(share * max(events.duration - WINDOW, 1))
        yield events.window(start, start + WINDOW)


def _scores(options: Options, precision: str, fuse: bool) -> Ready:
    batch, _ = windows(options, 16)
    model: Any = _network(options)
    with torch.inference_mode():
        exact = _network(options).double()(doubled(batch))
    if fuse:
        model = models.fused(model)
    if precision == "float64":
        model, batch = model.double(), doubled(batch)

    def run() -> torch.Tensor:
        with torch.inference_mode(), torch.autocast(options.device, torch.bfloat16, enabled=precision == "bfloat16"):
            scores: torch.Tensor = model(batch)
        settle(options.device)
        return scores

    return Ready(run, lambda found: _relative(found, exact))


def _configured(options: Options, name: str) -> Ready:
    """Two samples; exact are the scores in float64 on the CPU, whatever the device."""
    make, sensor_size, sequences = CONFIGURED[name]
    batch = samples(sensor_size, sequences)
    with torch.inference_mode():
        exact = steady(make).eval().double()(doubled(batch))
    model, given = steady(make, options.device).eval(), batch.to(options.device)

    def run() -> torch.Tensor:
        with torch.inference_mode():
            scores: torch.Tensor = model(given)
        settle(options.device)
        return scores

    again = lambda found: {"scores that differ when computed again": int((run() != found).sum())}  # noqa: E731
    return Ready(run, lambda found: _relative(found.cpu(), exact), counters=again)


def _with_setting(options: Options, name: str, value: Any) -> Ready:
    """As the networks were trained: `training.Objects` with this setting."""
    return _classified(options, Objects("n-mnist", **{**DEFAULTS, name: value}), LEARNED[name][value])


def _of_length(options: Options, length: int) -> Ready:
    return _classified(options, Objects("n-mnist", window=length), WINDOWED[length])


def _classified(options: Options, protocol: Objects, error: float) -> Ready:
    """A window at a time, by the protocol's pipeline and network; the number of operations is that of the first one."""
    recordings, graph_of = cycle(digits(options)), protocol.pipeline(training=False)
    model = steady(partial(protocol.build, DIGITS, 10), options.device).eval()

    def run() -> int:
        with torch.inference_mode():
            scores = model(graph_of(next(recordings)).to(options.device))
            return int(scores.argmax().item())

    torch.manual_seed(0)
    flops = models.complexity(model, graph_of(next(recordings)).to(options.device)).flops
    return Ready(run, lambda found: error, counters=lambda found: {"flops": flops})


def _voted(options: Options, votes: int) -> Ready:
    """Several windows of a recording in one batch, by the defaults' pipeline and network."""
    protocol, recordings = Objects("n-mnist"), cycle(digits(options))
    model = steady(partial(protocol.build, DIGITS, 10), options.device).eval()
    graph_of = protocol.pipeline(training=False)

    def run() -> int:
        events = next(recordings)
        with torch.inference_mode():
            scores = model(GraphBatch.from_graphs([graph_of(events) for _ in range(votes)]).to(options.device))
        return int(models.prediction.vote(scores).argmax().item())

    return Ready(run, lambda found: VOTED[votes])


def _of_nodes(options: Options, count: int) -> Ready:
    model = _network(options, "asl-dvs")
    graph = T.RadiusGraph(max_degree=8)(outlines(count)).to(options.device)

    def run() -> torch.Tensor:
        with torch.inference_mode():
            scores: torch.Tensor = model(graph)
        settle(options.device)
        return scores

    return Ready(run)


def _on_grid(options: Options, ours: bool, share: float = 2 / 3) -> Ready:
    """Features of sequences of eight graphs, compared with one copy of the same size."""
    cells, channels, graphs, length = 900, 128, 32, 8
    nodes = max(int(cells * share), 1)
    torch.manual_seed(0)
    batch = torch.arange(graphs).repeat_interleave(nodes)
    at = torch.stack([torch.randperm(cells)[:nodes] for _ in range(graphs)]).flatten()
    pos = torch.stack((at % 30 * 8, at // 30 * 6), 1).float()
    x, batch, at, pos = (one.to(options.device) for one in (torch.rand(len(at), channels), batch, at, pos))
    flat = batch * cells + at

    def run() -> torch.Tensor:
        if ours:
            out = to_grid(x, pos, batch, graphs, length, (8, 6), (30, 30))
        else:
            out = x.new_zeros(graphs * cells, channels).index_copy_(0, flat, x)
        settle(options.device)
        return out

    return Ready(run)
