"""Trained networks in one safe file: weights, constructor arguments, classes, transform and metrics.

The file has the safetensors format, whose reader runs no code. Everything but the weights is JSON in its header.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from threading import get_ident
from types import NoneType
from typing import Any

import torch
from safetensors.torch import load as from_safetensors
from safetensors.torch import save as as_safetensors
from torch import nn
from torch.nn.modules.module import register_module_parameter_registration_hook

from nvsdata.common.errors import FormatError, line_of
from nvsdata.common.files import put
from nvsdata.models import graph_cnn, graph_cnn3d, reference
from nvsdata.models.prediction import Trained
from nvsdata.models.registry import NETWORKS
from nvsdata.transforms import from_repr

VERSION = 1
SUFFIX = ".safetensors"
# importing these fills the registry
_ = reference, graph_cnn, graph_cnn3d


def save(
    model: nn.Module,
    path: str | os.PathLike[str],
    *,
    classes: Sequence[str] = (),
    transform: Any = None,
    metrics: Mapping[str, Any] | None = None,
    data: Mapping[str, Any] | None = None,
) -> Path:
    """Write a network with its classes, transform and metrics into one file.

    Of a convolution of your own (see `RGCNN`), the file contains the name and the weights, but no code. Pass its class
    or function to `load`.

    Args:
        model: A registered network (`register_network`), such as those of `nvsdata.models`.
        path: Path of the file. A bare name ("asl", without folder or suffix) is a file in the model folder:
            $NVSDATA_MODELS, or `models` in nvsdata's cache folder.
        classes: Class names, in the order of the scores (default: none).
        transform: Transform from a recording to the network's input, stored as its repr (default None).
        metrics: Results such as the accuracy, stored as JSON (default None).
        data: Description of the training data, stored as JSON (default None).

    Returns:
        The path of the file.

    Raises:
        ValueError: For a network that isn't registered or is fused, for a transform that isn't registered or can't be
            built from its repr, and for a convolution without a name (a lambda).

    Example:
        >>> import tempfile
        >>> from nvsdata import models
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = models.save(models.rgcnn("n-mnist"), f"{folder}/digits.safetensors", metrics={"accuracy": 0.97})
        ...     models.load(path).metrics
        {'accuracy': 0.97}
    """
    kind, settings = getattr(model, "kind", None), getattr(model, "settings", None)
    if kind not in NETWORKS or type(model) is not NETWORKS[str(kind)]:
        name = type(model).__name__
        raise ValueError(
            f"{name} can't be saved: the network is fused or not registered by @models.register_network('a-name')"
        )
    state = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    header = {
        "version": VERSION,
        "network": kind,
        "settings": _without_classes(settings or {}),
        "classes": list(classes),
        "transform": _checked(transform),
        "metrics": dict(metrics or {}),
        "data": dict(data or {}),
    }
    text = json.dumps(header)
    where = _place(path)
    where.parent.mkdir(parents=True, exist_ok=True)
    put(where, as_safetensors(state, {"nvsdata": text, "sha256": _digest(text, state)}), through_link=True)
    return where


def load(
    path: str | os.PathLike[str],
    *,
    device: str | torch.device = "cpu",
    convolution: Callable[[int, int], nn.Module] | None = None,
) -> Trained:
    """Read a network that `save` wrote.

    Args:
        path: Path of the file, or a bare name as for `save`.
        device: Device of the network (default "cpu").
        convolution: The class or function of your own that the network was built with. The file contains only its name,
            because reading a file runs no code (default None).

    Returns:
        A `Trained`, whose network is in evaluation mode.

    Raises:
        FileNotFoundError: If there is no such file.
        FormatError: For a file that isn't a saved network, that is truncated, altered or of another version, that names
            a network or transform that isn't registered, that needs another `convolution`, or whose weights don't fit
            the network.
        ValueError: For a `convolution` that the file doesn't need.

    Example:
        >>> import tempfile
        >>> from nvsdata import models
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = models.save(models.rgcnn("n-mnist", 2), f"{folder}/letters.safetensors", classes=["a", "b"])
        ...     models.load(path).classes
        ('a', 'b')
    """
    where = _place(path)
    if not where.is_file():
        known = sorted(file.stem for file in where.parent.glob("*" + SUFFIX))
        there = f"; there are {', '.join(known)}" if known else ""
        raise FileNotFoundError(f"no trained network {where}{there}")
    try:
        # read instead of mapped: a mapped file can't be replaced on Windows, and the process ends if it is truncated
        whole = where.read_bytes()
        state = from_safetensors(whole)
        length = int.from_bytes(whole[:8], "little")
        kept = json.loads(whole[8 : 8 + length]).get("__metadata__") or {}
    except Exception as error:  # safetensors' own errors, and those of torch for invalid sizes
        raise FormatError(where, f"is not a network that nvsdata saved: {line_of(error)}") from None
    if "nvsdata" not in kept:
        raise FormatError(where, "doesn't contain a network of nvsdata")
    header = _header(where, kept["nvsdata"])
    if kept.get("sha256") != _digest(kept["nvsdata"], state):
        raise FormatError(where, "fails its checksum: it was damaged or altered")
    settings = _with_convolution(where, header.settings, convolution)
    try:
        model = _network(header.network, settings, state)
    except Exception as error:  # any error of a constructor with invalid settings
        raise FormatError(where, f"doesn't fit the network {header.network!r}: {line_of(error)}") from None
    try:
        transform = None if header.transform is None else from_repr(header.transform)
    except Exception as error:  # any error of a constructor, too
        raise FormatError(where, f"has a transform that can't be built: {line_of(error)}") from None
    if transform is not None and repr(transform) != header.transform:
        raise FormatError(where, f"has a transform without some settings of this version: {header.transform:.300}")
    if transform is not None and not callable(transform):
        raise FormatError(where, f"doesn't contain a transform, but {header.transform!r:.200}")
    model = model.to_empty(device=device)
    model.load_state_dict(state)
    return Trained(model.eval(), tuple(header.classes), transform, header.metrics, header.data)


@dataclass(frozen=True)
class _Header:
    """JSON header of a file; the defaults define the types."""

    version: int = VERSION
    network: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    classes: list[str] = field(default_factory=list)
    transform: str | None = None
    metrics: dict[str, Any] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)


def _header(where: Path, text: str) -> _Header:
    """Return the header. FormatError if an entry is missing or has another type."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(where, f"has a header that isn't JSON: {line_of(error)}") from None
    version = found.get("version") if isinstance(found, dict) else None
    if type(version) is not int:
        raise FormatError(where, "has a header without a version")
    if version != VERSION:
        raise FormatError(where, f"is of version {version!r:.20}, this nvsdata reads {VERSION}")
    expected = asdict(_Header())
    for name, default in expected.items():
        kinds = (str, NoneType) if name == "transform" else type(default)
        if name not in found or not isinstance(found[name], kinds):
            raise FormatError(where, f"has a header whose {name} is {found.get(name, 'missing')!r:.100}")
    if not all(isinstance(name, str) for name in found["classes"]):
        raise FormatError(where, "has a header whose classes aren't names")
    if found["network"] not in NETWORKS:
        raise FormatError(
            where,
            f"is of a network {found['network']!r:.100}, which isn't registered here: import the module"
            " that defines it, with @models.register_network",
        )
    return _Header(**{name: found[name] for name in expected})


def _network(kind: str, settings: dict[str, Any], state: Mapping[str, torch.Tensor]) -> nn.Module:
    """Return the network on the meta device (without values). ValueError unless the weights `state` fit the network."""
    room, here = len(state), get_ident()

    def count(*_: Any) -> None:
        nonlocal room
        room -= get_ident() == here
        if room < 0 and get_ident() == here:
            raise ValueError(f"the network has more than the file's {len(state)} weights")

    # settings with a billion layers fail at the first weight that the file doesn't have
    with torch.device("meta"), register_module_parameter_registration_hook(count):
        model = NETWORKS[kind](**_tuples(settings))
    expected = {name: (tuple(v.shape), v.is_floating_point()) for name, v in model.state_dict().items()}
    given = {name: (tuple(v.shape), v.is_floating_point()) for name, v in state.items()}
    if different := sorted(name for name in expected.keys() | given.keys() if expected.get(name) != given.get(name)):
        raise ValueError(f"{len(different)} weights are missing or of another size, first {different[0]!r:.100}")
    return model


def _without_classes(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings for JSON: a convolution of the user's own becomes {"name": "module:class"}."""
    given = settings.get("convolution")
    if not callable(given):
        return dict(settings)
    name = getattr(given, "__qualname__", "<nameless>")
    if name.endswith(">"):
        raise ValueError(f"a network with the convolution {given!r} can't be saved: make it a class, or a function")
    return {**settings, "convolution": {"name": f"{given.__module__}:{name}"}}


def _with_convolution(where: Path, settings: dict[str, Any], given: Any) -> dict[str, Any]:
    """Return the settings with the convolution that the file names.

    The module isn't compared, because that of scripts is __main__.
    """
    saved = settings.get("convolution")
    if not (isinstance(saved, dict) and isinstance(saved.get("name"), str)):
        if given is not None:
            raise ValueError(f"{where} has no convolution of your own, but convolution={given!r} was given")
        return settings
    module, _, name = saved["name"].partition(":")
    if getattr(given, "__qualname__", None) != name:
        what = f"was saved with the convolution {name!r:.100} of the module {module!r:.100}"
        instead = "" if given is None else f", not with {given!r}"
        raise FormatError(where, f"{what}{instead}: import it, and load by models.load(path, convolution={name:.100})")
    return {**settings, "convolution": given}


def _tuples(value: Any) -> Any:
    """Turn JSON's lists back into tuples."""
    if isinstance(value, dict):
        return {name: _tuples(inner) for name, inner in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _place(path: str | os.PathLike[str]) -> Path:
    given = Path(path).expanduser()
    if given.suffix or len(given.parts) > 1:
        return given
    return _home() / f"{given}{SUFFIX}"


def _home() -> Path:
    """Return the folder of networks given by a bare name."""
    if chosen := os.environ.get("NVSDATA_MODELS"):
        return Path(chosen)
    # imported here, because importing pooch takes a quarter of a second
    import pooch

    return Path(pooch.os_cache("nvsdata")) / "models"


def _checked(transform: Any) -> str | None:
    if transform is None:
        return None
    text = repr(transform)
    built = from_repr(text)
    if repr(built) != text or not _same_kinds(built, transform):
        raise ValueError(f"the transform can't be built from its repr, or another transform has its name: {text}")
    return text


def _same_kinds(a: Any, b: Any) -> bool:
    """Return True if two transforms, and those within them, are of the same classes."""
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_same_kinds, a, b))
    if type(a) is not type(b):
        return False
    return not is_dataclass(a) or all(_same_kinds(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


def _digest(text: str, state: Mapping[str, torch.Tensor]) -> str:
    """Return the SHA-256 digest of the header and all weights."""
    digest = hashlib.sha256(text.encode())
    for name in sorted(state):
        value = state[name]
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()
