"""Benchmarks of training steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import nn
from torch.nn.functional import cross_entropy

from nvsdata import models
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.networks import NETWORKS, digit_batch, fixed_network, in_float64, sample_batch, synchronize

LOSS = "difference of the first loss from that in float64 on the CPU"


def cases(options: Options) -> list[Case]:
    """Return the cases: RG-CNN, compared with PyTorch Geometric; all networks; precision; larger batches."""
    each = _compared_with_pyg, _every, _precisions, _growing
    return [replace(case, device=options.device) for some in each for case in some(options)]


def _compared_with_pyg(options: Options) -> Iterator[Case]:
    benchmark, size = "a step of RG-CNN (n-mnist, 3 convolutions)", {"graphs": _graphs(options)}
    case = partial(Case, "train", benchmark, size=size)
    yield case(partial(_on_digits, options, size["graphs"]), default=True, error_kind=LOSS)
    yield case(partial(_by_pyg, options, size["graphs"]), library="torch_geometric")


def _every(options: Options) -> Iterator[Case]:
    for name in NETWORKS:
        make = partial(_configured, options, name)
        yield Case("train", f"a step of {name}", make, error_kind=LOSS, alone=True)


def _precisions(options: Options) -> Iterator[Case]:
    for name in ("float64", "float32", "bfloat16"):
        yield Case(
            *("train", "a step of RG-CNN by precision", partial(_on_digits, options, _graphs(options), name)),
            settings={"precision": name},
            axis="precision",
            default=name == "float32",
            error_kind=LOSS,
        )


def _growing(options: Options) -> Iterator[Case]:
    for count in (4, 16, 64, *(() if options.quick else (256,))):
        yield Case(
            *("train", "steps of RG-CNN with growing batches", partial(_on_digits, options, count)),
            size={"graphs": count},
            axis="graphs",
            error_kind=LOSS,
            alone=True,
        )


def _graphs(options: Options) -> int:
    return 16 if options.quick else 64


def _on_digits(options: Options, graphs: int, precision: str = "float32") -> PreparedCase:
    batch, targets = digit_batch(options, graphs)
    make = partial(models.rgcnn, "n-mnist")
    return _stepping(
        options, fixed_network(make, options.device), batch, targets, _exact(make, batch, targets), precision
    )


def _configured(options: Options, name: str) -> PreparedCase:
    make, sensor_size, sequences = NETWORKS[name]
    batch, targets = sample_batch(sensor_size, sequences), torch.arange(2)
    model, exact = fixed_network(make, options.device), _exact(make, batch, targets)
    return _stepping(options, model, batch.to(options.device), targets.to(options.device), exact)


def _by_pyg(options: Options, graphs: int) -> PreparedCase:
    """Prepare a step with PyTorch Geometric.

    Its weights and the scale of its pseudo-coordinates after pooling differ from ours, so losses can't be compared.
    """
    from nvsdata.benchmarks.peers.pyg import PyGRGCNN

    batch, targets = digit_batch(options, graphs)
    return _stepping(options, fixed_network(PyGRGCNN, options.device), batch.to_pyg(), targets)


def _exact(make: Any, batch: Any, targets: torch.Tensor) -> float:
    """Return the loss in float64 on the CPU, before the first step."""
    return cross_entropy(fixed_network(make).double()(in_float64(batch.to("cpu"))), targets.cpu()).item()


def _stepping(
    options: Options,
    model: nn.Module,
    batch: Any,
    targets: torch.Tensor,
    exact: float | None = None,
    precision: str = "float32",
) -> PreparedCase:
    """Prepare a training step: forward pass, backward pass and Adam."""
    if precision == "float64":
        model, batch = model.double(), in_float64(batch)
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    first: list[float] = []

    def run() -> list[float]:
        optimizer.zero_grad()
        with torch.autocast(options.device, torch.bfloat16, enabled=precision == "bfloat16"):
            loss = cross_entropy(model(batch), targets)
        torch.autograd.backward(loss)
        optimizer.step()
        synchronize(options.device)
        if not first:
            first.append(loss.item())
        return first

    return PreparedCase(run, None if exact is None else lambda found: abs(found[0] - exact))
