"""Benchmarks of inference: scores of networks, and classification of windows."""

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
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import DIGITS, WINDOW, digits, outlines, sensor_recording
from nvsdata.benchmarks.networks import NETWORKS, digit_batch, fixed_network, in_float64, sample_batch, synchronize
from nvsdata.data.events import Events
from nvsdata.data.graph import GraphBatch
from nvsdata.data.grid import to_grid
from nvsdata.training.objects import Objects
from nvsdata.transforms.events.sampling import BETA

RELATIVE = "largest difference of scores from float64, relative to the largest score"
TRAINED = "classification error on N-MNIST's validation part after 40 epochs with it (docs/figures/ablation.jsonl)"
# classification errors of single windows, by setting of the pipeline: means of three seeds
ERRORS: dict[str, dict[Any, float]] = {
    "k": {1: 0.0760, 2: 0.0916, 4: 0.1056, 8: 0.1536},
    "radius": {2.0: 0.0911, 3.0: 0.0760, 4.0: 0.0749, 5.0: 0.0699, 7.0: 0.0692},
    "max_degree": {4: 0.0807, 8: 0.0760, 16: 0.0708, 32: 0.0720},
    "beta": {BETA: 0.0760, 5e-6: 0.0925},
}
DEFAULTS: dict[str, Any] = {"k": 1, "radius": 3.0, "max_degree": 8, "beta": BETA}
# classification errors by window length in µs, and by number of votes (docs/results.md)
LENGTH_ERRORS = {7_500: 0.26, 15_000: 0.09, 30_000: 0.034, 60_000: 0.024}
VOTE_ERRORS = {1: 0.034, 2: 0.022, 3: 0.020, 4: 0.018, 5: 0.017}


def cases(options: Options) -> list[Case]:
    """Return the cases: latency; precision; time and accuracy by settings; all networks; larger graphs; Graph2Grid."""
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
    """Yield a case for each value of the settings in Tables 4.1 to 4.3, and of window lengths and votes.

    Their error is the classification error of networks trained with the setting.
    """
    for name, errors in ERRORS.items():
        for value in errors:
            yield Case(
                *("infer", f"a window to its class, by {name}", partial(_with_setting, options, name, value)),
                settings={name: value},
                axis=name,
                default=DEFAULTS[name] == value,
                error_kind=TRAINED,
            )
    for length in LENGTH_ERRORS:
        yield Case(
            *("infer", "a window to its class, by length", partial(_of_length, options, length)),
            settings={"µs": length},
            axis="µs",
            default=length == WINDOW,
            error_kind="classification error on N-MNIST, one network for all lengths (docs/results.md)",
        )
    for votes in VOTE_ERRORS:
        yield Case(
            *("infer", "a recording to its class, by votes", partial(_voted, options, votes)),
            settings={"votes": votes},
            axis="votes",
            default=votes == 5,
            error_kind="classification error on N-MNIST, by votes (docs/results.md)",
        )


def _every(options: Options) -> Iterator[Case]:
    for name in NETWORKS:
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
    for fraction in (0.01, 0.1, 1.0):
        yield Case(
            *("infer", "Graph2Grid of partly occupied cells", partial(_on_grid, options, True, fraction)),
            settings={"fraction of cells": fraction},
            axis="fraction of cells",
        )


def _network(options: Options, name: str = "n-mnist") -> torch.nn.Module:
    return fixed_network(partial(models.rgcnn, name), options.device).eval()


def _relative(found: torch.Tensor, exact: torch.Tensor) -> float:
    return float(((found.double() - exact).abs().max() / exact.abs().max()).item())


def _window_to_class(options: Options, name: str, fuse: bool) -> PreparedCase:
    """Prepare the classification of single windows at random times."""
    plain = _network(options, name)
    model = models.fused(plain) if fuse else plain
    recordings = digits(options) if name == "n-mnist" else [sensor_recording(options)]
    steps = [T.Window(0, WINDOW)] if name == "n-mnist" else [T.NonUniformSample(8)]
    graph_of = T.Compose([*steps, T.RadiusGraph()])
    places = _random_windows(recordings)

    def run() -> torch.Tensor:
        with torch.inference_mode():
            scores: torch.Tensor = model(graph_of(next(places)).to(options.device))
            scores.argmax().item()
        return scores

    graph = GraphBatch.from_graphs([graph_of(next(_random_windows(recordings)))]).to(options.device)
    with torch.inference_mode():
        exact: torch.Tensor = _network(options, name).double()(in_float64(graph))
    return PreparedCase(run, lambda found: _relative(found, exact))


def _random_windows(recordings: Sequence[Events]) -> Iterator[Events]:
    """Yield windows at random times without end, cycling through the recordings."""
    fractions = np.random.default_rng(0).random(997).tolist()
    for events, fraction in zip(cycle(recordings), cycle(fractions), strict=False):
        start = events.start + int(fraction * max(events.duration - WINDOW, 1))
        yield events.window(start, start + WINDOW)


def _scores(options: Options, precision: str, fuse: bool) -> PreparedCase:
    batch, _ = digit_batch(options, 16)
    model: Any = _network(options)
    with torch.inference_mode():
        exact = _network(options).double()(in_float64(batch))
    if fuse:
        model = models.fused(model)
    if precision == "float64":
        model, batch = model.double(), in_float64(batch)

    def run() -> torch.Tensor:
        with torch.inference_mode(), torch.autocast(options.device, torch.bfloat16, enabled=precision == "bfloat16"):
            scores: torch.Tensor = model(batch)
        synchronize(options.device)
        return scores

    return PreparedCase(run, lambda found: _relative(found, exact))


def _configured(options: Options, name: str) -> PreparedCase:
    """Prepare scores of two samples; the exact scores are computed in float64 on the CPU."""
    make, sensor_size, sequences = NETWORKS[name]
    batch = sample_batch(sensor_size, sequences)
    with torch.inference_mode():
        exact = fixed_network(make).eval().double()(in_float64(batch))
    model, given = fixed_network(make, options.device).eval(), batch.to(options.device)

    def run() -> torch.Tensor:
        with torch.inference_mode():
            scores: torch.Tensor = model(given)
        synchronize(options.device)
        return scores

    again = lambda found: {"scores that differ in a second run": int((run() != found).sum())}  # noqa: E731
    return PreparedCase(run, lambda found: _relative(found.cpu(), exact), counters=again)


def _with_setting(options: Options, name: str, value: Any) -> PreparedCase:
    """Prepare the classification of windows by `training.Objects` with this setting."""
    return _classified(options, Objects("n-mnist", **{**DEFAULTS, name: value}), ERRORS[name][value])


def _of_length(options: Options, length: int) -> PreparedCase:
    return _classified(options, Objects("n-mnist", window=length), LENGTH_ERRORS[length])


def _classified(options: Options, protocol: Objects, error: float) -> PreparedCase:
    """Prepare the classification of single windows; the operations of the first window are counted."""
    recordings, graph_of = cycle(digits(options)), protocol.pipeline(training=False)
    model = fixed_network(partial(protocol.build, DIGITS, 10), options.device).eval()

    def run() -> int:
        with torch.inference_mode():
            scores = model(graph_of(next(recordings)).to(options.device))
            return int(scores.argmax().item())

    torch.manual_seed(0)
    flops = models.complexity(model, graph_of(next(recordings)).to(options.device)).flops
    return PreparedCase(run, lambda found: error, counters=lambda found: {"flops": flops})


def _voted(options: Options, votes: int) -> PreparedCase:
    """Prepare voting over several windows of a recording in one batch, with default settings."""
    protocol, recordings = Objects("n-mnist"), cycle(digits(options))
    model = fixed_network(partial(protocol.build, DIGITS, 10), options.device).eval()
    graph_of = protocol.pipeline(training=False)

    def run() -> int:
        events = next(recordings)
        with torch.inference_mode():
            scores = model(GraphBatch.from_graphs([graph_of(events) for _ in range(votes)]).to(options.device))
        return int(models.prediction.vote(scores).argmax().item())

    return PreparedCase(run, lambda found: VOTE_ERRORS[votes])


def _of_nodes(options: Options, count: int) -> PreparedCase:
    model = _network(options, "asl-dvs")
    graph = T.RadiusGraph(max_degree=8)(outlines(count)).to(options.device)

    def run() -> torch.Tensor:
        with torch.inference_mode():
            scores: torch.Tensor = model(graph)
        synchronize(options.device)
        return scores

    return PreparedCase(run)


def _on_grid(options: Options, ours: bool, fraction: float = 2 / 3) -> PreparedCase:
    """Prepare Graph2Grid of sequences of eight graphs or, unless `ours`, a copy of the features into the grids."""
    cells, channels, graphs, length = 900, 128, 32, 8
    nodes = max(int(cells * fraction), 1)
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
        synchronize(options.device)
        return out

    return PreparedCase(run)
