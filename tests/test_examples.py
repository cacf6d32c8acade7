"""Examples in docstrings run, and everything public has one."""

import doctest
import importlib
import inspect
import pkgutil
import warnings
from enum import Enum

import pytest
import signatures

import nvsdata

# they import packages that aren't dependencies
NEEDS_EXTRA = {"nvsdata.benchmarks.peers.digits", "nvsdata.benchmarks.peers.pyg"}
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(nvsdata.__path__, "nvsdata.")
    if module.name not in NEEDS_EXTRA
    and not module.name.startswith("nvsdata.kernels.triton.")
    and not module.name.endswith(("._native", ".__main__"))
)


@pytest.mark.parametrize("name", MODULES)
@pytest.mark.usefixtures("same_registries")
def test_examples_of_a_module_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        assert doctest.testmod(module).failed == 0


def without_example(package):
    module = importlib.import_module(package)
    for name in sorted(module.__all__):
        thing = getattr(module, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            if inspect.isclass(thing) and issubclass(thing, Enum | Exception):
                continue
            if ">>>" not in (thing.__doc__ or ""):
                yield name


@pytest.mark.parametrize("package", signatures.PACKAGES)
def test_every_public_class_and_function_has_an_example(package):
    assert list(without_example(package)) == []
