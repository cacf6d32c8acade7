"""Names, parameters and defaults of everything public, as text.

    python tests/signatures.py     # writes tests/signatures.txt anew; look at what changed before you commit it

`test_signatures.py` compares: a default that changes unnoticed changes the results of everybody who relies on it.
"""

import argparse
import dataclasses
import importlib
import inspect
from enum import Enum
from pathlib import Path

import numpy as np

from nvsdata import cli
from nvsdata.datasets.resumable import ResumableBatches
from nvsdata.emulation.frame_emulator import FrameEmulator

FILE = Path(__file__).with_suffix(".txt")
PACKAGES = (
    "nvsdata",
    "nvsdata.datasets",
    "nvsdata.transforms",
    "nvsdata.models",
    "nvsdata.models.reference",
    "nvsdata.metrics",
    "nvsdata.training",
    "nvsdata.emulation",
    "nvsdata.formats",
    "nvsdata.plots",
)


def lines() -> list[str]:
    """A line for each function, class, public method and option of a command."""
    found = []
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in sorted(module.__all__):
            thing = getattr(module, name)
            if inspect.isclass(thing) or inspect.isfunction(thing):
                found += described(f"{package}.{name}", thing)
            elif isinstance(thing, int | float | str | tuple):
                found.append(f"{package}.{name} = {thing!r}")
    # whose methods both emulators have
    found += described("nvsdata.emulation.frame_emulator.FromFrames", FrameEmulator)
    # whose methods all batches that can be resumed have
    found += described("nvsdata.datasets.resumable.ResumableBatches", ResumableBatches)
    for name, command in cli.COMMANDS.items():
        parser = argparse.ArgumentParser()
        importlib.import_module(f"nvsdata.commands.{command.module}").add_arguments(parser)
        for action in parser._actions:
            words = " ".join(action.option_strings) or action.dest
            given = [f"default {shown(action.default)}", f"choices {action.choices}" if action.choices else ""]
            found.append(f"nvsdata {name} {words}: {', '.join(filter(None, given))}")
    return found


def described(name: str, thing: object) -> list[str]:
    """The lines of a function, or of a class and its public methods."""
    if inspect.isfunction(thing):
        return [name + parameters(thing)]
    found = []
    if issubclass(thing, Enum | Exception):
        found.append(name)
    elif issubclass(thing, tuple):
        found.append(f"{name}{thing._fields}" if hasattr(thing, "_fields") else name)
    else:
        kind = "frozen " if dataclasses.is_dataclass(thing) and thing.__dataclass_params__.frozen else ""
        found.append(f"{kind}{name}{parameters(thing)}")
    for method in sorted(vars(thing)):
        member = inspect.unwrap(getattr(thing, method)) if callable(getattr(thing, method, None)) else None
        if not method.startswith("_") and inspect.isfunction(member):
            found.append(f"{name}.{method}{parameters(member)}")
    return found


def parameters(thing: object) -> str:
    """Names and defaults, without types."""
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return "(...)"
    given = []
    for one in signature.parameters.values():
        star = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        only = "keyword " if one.kind is one.KEYWORD_ONLY else ""
        default = "" if one.default is one.empty else f"={shown(one.default)}"
        given.append(f"{only}{star}{one.name}{default}")
    return f"({', '.join(given)})"


def shown(value: object) -> str:
    """A default without addresses and paths of this machine."""
    if inspect.isfunction(value) or inspect.isclass(value) or inspect.isbuiltin(value):
        return value.__qualname__
    if isinstance(value, np.ndarray):
        return repr(value.tolist())
    if isinstance(value, Path):
        return f"Path({str(value)!r})"
    text = repr(value)
    return type(value).__name__ if " at 0x" in text else text


if __name__ == "__main__":
    FILE.write_text("\n".join(lines()) + "\n")
