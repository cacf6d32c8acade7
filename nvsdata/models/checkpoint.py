"""Trained networks in one safe file: weights, what the network was built with, classes, transform, metrics.

The file is of the safetensors format, whose reader runs no code; all but the weights is JSON in its header.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pooch
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from nvsdata.errors import FormatError
from nvsdata.files import atomic
from nvsdata.models import reference, rgcnn, rgcnn3d
from nvsdata.models.zoo import NETWORKS
from nvsdata.transforms import from_repr

VERSION = 1
SUFFIX = ".safetensors"
# importing these fills the registry
_ = reference, rgcnn, rgcnn3d


@dataclass(frozen=True)
class Trained:
    """A network from a file, in evaluation mode, and what was kept with it.

    `transform` makes the network's input of a recording; None if none was kept.
    """

    model: nn.Module
    classes: tuple[str, ...]
    transform: Any
    metrics: Mapping[str, Any]

    @torch.no_grad()
    def __call__(self, recording: Any) -> torch.Tensor:
        """Class probabilities [num_classes] of a recording: its path, a `Recording` or `Events`.

        ValueError if the file keeps no transform.
        """
        from nvsdata import formats
        from nvsdata.batching import collate

        if self.transform is None:
            raise ValueError("no transform was saved with this network: make its input yourself, and call .model")
        opened = formats.open(recording) if isinstance(recording, str | os.PathLike) else recording
        batch, _ = collate([(self.transform(opened), 0)])
        device = next(self.model.parameters()).device
        probabilities: torch.Tensor = self.model(batch.to(device)).softmax(1)[0]
        return probabilities

    def predict(self, recording: Any) -> str:
        """Name of the most probable class."""
        best = int(self(recording).argmax())
        return self.classes[best] if self.classes else str(best)


def save(
    model: nn.Module,
    path: str | os.PathLike[str],
    *,
    classes: Sequence[str] = (),
    transform: Any = None,
    metrics: Mapping[str, Any] | None = None,
) -> Path:
    """Write a network of `nvsdata.models` with what belongs to it; the path of the file.

    A bare name ("asl", without folder or suffix) goes to the model folder, where `load` looks for it:
    $NVSDATA_MODELS, or `models` in nvsdata's cache. `transform` is kept as its repr, `metrics` as JSON.
    ValueError for a network that isn't of the zoo or is fused, or a transform whose repr doesn't build it.
    """
    kind, settings = getattr(model, "kind", None), getattr(model, "settings", None)
    if kind not in NETWORKS or type(model) is not NETWORKS[str(kind)]:
        raise ValueError(f"{type(model).__name__} can't be saved: it is no network of nvsdata.models, or fused")
    state = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    header = {
        "version": VERSION,
        "network": kind,
        "settings": settings,
        "classes": list(classes),
        "transform": _checked(transform),
        "metrics": dict(metrics or {}),
    }
    text = json.dumps(header)
    where = _place(path)
    where.parent.mkdir(parents=True, exist_ok=True)
    with atomic(where) as temporary:
        save_file(state, temporary, {"nvsdata": text, "sha256": _digest(text, state)})
    return where


def load(path: str | os.PathLike[str], *, device: str | torch.device = "cpu") -> Trained:
    """A network that `save` wrote, by path or bare name.

    FileNotFoundError if there is none. FormatError for a file that is something else, was cut short or altered, is of
    a newer version, or whose weights don't fit the network that it names.
    """
    where = _place(path)
    if not where.is_file():
        known = sorted(file.stem for file in where.parent.glob("*" + SUFFIX))
        there = f"; there are {', '.join(known)}" if known else ""
        raise FileNotFoundError(f"no trained network {where}{there}")
    try:
        with safe_open(where, framework="pt") as file:
            kept = file.metadata() or {}
            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        text = kept["nvsdata"]
        header = json.loads(text)
        version = int(header["version"])
    except KeyError:
        raise FormatError(where, None, "holds no network of nvsdata") from None
    except (SafetensorError, ValueError, OSError) as error:
        raise FormatError(where, None, f"is no network that nvsdata saved: {error}") from None
    if version > VERSION:
        raise FormatError(where, None, f"is of version {version}, this nvsdata reads up to {VERSION}")
    if kept.get("sha256") != _digest(text, state):
        raise FormatError(where, None, "doesn't have the checksum it was written with: it was damaged or altered")
    return _built(where, header, state, device)


def _built(where: Path, header: dict[str, Any], state: dict[str, torch.Tensor], device: Any) -> Trained:
    if header["network"] not in NETWORKS:
        raise FormatError(where, None, f"is of a network {header['network']!r}, which this nvsdata doesn't have")
    try:
        model = NETWORKS[header["network"]](**_tuples(header["settings"]))
        model.load_state_dict(state)
        transform = from_repr(header["transform"]) if header["transform"] else None
    except (TypeError, ValueError, RuntimeError) as error:
        raise FormatError(where, None, f"doesn't fit the network {header['network']!r}: {error}") from None
    return Trained(model.to(device).eval(), tuple(header["classes"]), transform, header["metrics"])


def _tuples(value: Any) -> Any:
    """JSON's lists as the tuples they were."""
    if isinstance(value, dict):
        return {name: _tuples(inner) for name, inner in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _place(path: str | os.PathLike[str]) -> Path:
    given = Path(path)
    if given.suffix or len(given.parts) > 1:
        return given
    home = os.environ.get("NVSDATA_MODELS") or Path(pooch.os_cache("nvsdata")) / "models"
    return Path(home) / f"{given}{SUFFIX}"


def _checked(transform: Any) -> str | None:
    if transform is None:
        return None
    text = repr(transform)
    if repr(from_repr(text)) != text:
        raise ValueError(f"the transform can't be built from its repr: {text}")
    return text


def _digest(text: str, state: Mapping[str, torch.Tensor]) -> str:
    """Of the header and all weights."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(state):
        value = state[name]
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()
