"""How kernels are compiled."""

import importlib
import pkgutil
from inspect import isfunction

import numba
import pytest

import nvsdata.kernels
from nvsdata.kernels.compiling import njit

MODULES = [module.name for module in pkgutil.iter_modules(nvsdata.kernels.__path__)]


@njit
def double(number):
    return 2 * number


@njit(error_model="numpy")
def inverse(number):
    return 1 / number


def test_what_is_compiled_is_kept_on_disk_and_lets_other_threads_run():
    for function, value, result in ((double, 3, 6), (inverse, 0.0, float("inf"))):
        assert function(value) == result
        assert function.targetoptions["nogil"]
        assert function.stats.cache_path
    assert not double.targetoptions.get("error_model")


@pytest.mark.parametrize("name", MODULES)
def test_functions_of_kernels_are_compiled(name):
    full = f"nvsdata.kernels.{name}"
    module = importlib.import_module(full)
    functions = {key: value for key, value in vars(module).items() if getattr(value, "__module__", "") == full}
    plain = {key for key, value in functions.items() if isfunction(value)}
    # what is called once, at import
    assert plain <= {"njit", "_around"}
    for function in functions.values():
        if isinstance(function, numba.core.registry.CPUDispatcher):
            assert function.targetoptions["nogil"]
            assert function.stats.cache_path
