"""Steps of training."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import nn
from torch.nn.functional import cross_entropy

from nvsdata import models
from nvsdata.benchmarks.case import Case, Options, Ready
from nvsdata.benchmarks.networks import CONFIGURED, doubled, samples, settle, steady, windows

LOSS = "difference of the first loss from float64 on the CPU"


def cases(options: Options) -> list[Case]:
    """RG-CNN compared with PyTorch Geometric's; every configuration; precision; batches of growing size."""
    each = _beside_pyg, _every, _precisions, _growing
    return [replace(case, device=options.device) for some in each for case in some(options)]


def _beside_pyg(options: Options) -> Iterator[Case]:
    work, size = "a step of RG-CNN (n-mnist, 3 convolutions)", {"graphs": _graphs(options)}
    case = partial(Case, "train", work, size=size)
    yield case(partial(_on_digits, options, size["graphs"]), default=True, error_kind=LOSS)
    yield case(partial(_by_pyg, options, size["graphs"]), library="torch_geometric")


def _every(options: Options) -> Iterator[Case]:
    for name in CONFIGURED:
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


def _on_digits(options: Options, graphs: int, precision: str = "float32") -> Ready:
    batch, targets = windows(options, graphs)
    make = partial(models.rgcnn, "n-mnist")
    return _stepping(options, steady(make, options.device), batch, targets, _exact(make, batch, targets), precision)


def _configured(options: Options, name: str) -> Ready:
    make, sensor_size, sequences = CONFIGURED[name]
    batch, targets = samples(sensor_size, sequences), torch.arange(2)
    model, exact = steady(make, options.device), _exact(make, batch, targets)
    return _stepping(options, model, batch.to(options.device), targets.to(options.device), exact)


def _by_pyg(options: Options, graphs: int) -> Ready:
    """Its weights, and how it scales pseudo-coordinates after pooling, are its own: losses can't be compared."""
    from nvsdata.benchmarks.pyg_network import PyGRGCNN

    batch, targets = windows(options, graphs)
    return _stepping(options, steady(PyGRGCNN, options.device), batch.to_pyg(), targets)


def _exact(make: Any, batch: Any, targets: torch.Tensor) -> float:
    """The loss in float64 on the CPU, before the first step."""
    return cross_entropy(steady(make).double()(doubled(batch.to("cpu"))), targets.cpu()).item()


def _stepping(
    options: Options,
    model: nn.Module,
    batch: Any,
    targets: torch.Tensor,
    exact: float | None = None,
    precision: str = "float32",
) -> Ready:
    """Forward, backward and Adam."""
    if precision == "float64":
        model, batch = model.double(), doubled(batch)
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    first: list[float] = []

    def run() -> list[float]:
        optimizer.zero_grad()
        with torch.autocast(options.device, torch.bfloat16, enabled=precision == "bfloat16"):
            loss = cross_entropy(model(batch), targets)
        torch.autograd.backward(loss)
        optimizer.step()
        settle(options.device)
        if not first:
            first.append(loss.item())
        return first

    return Ready(run, None if exact is None else lambda found: abs(found[0] - exact))
