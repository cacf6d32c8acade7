"""Triton compiles the kernels for GPUs, down to machine code, which needs no GPU."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("triton.language")

COMPILE = """
from triton import compile
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from nvsdata.kernels.triton import neighbors, pool, spline

def compiled(kernel, types, capability, fusion, **constants):
    types = iter(types.split())
    signature = {name: "constexpr" if name in constants else next(types) for name in kernel.arg_names}
    source = ASTSource(kernel, signature, {(kernel.arg_names.index(k),): v for k, v in constants.items()})
    target = GPUTarget("cuda", capability, 32)
    code = compile(source, target=target, options={"enable_fp_fusion": fusion}).asm
    assert code["cubin"]
    # where the last bit counts, products and sums are rounded one by one
    assert fusion or "fma.rn.f64" not in code["ptx"]

for capability, real in (80, "*fp32"), (90, "*fp64"):
    sizes = {"EDGES": spline.EDGES, "SIDE": spline.SIDE}
    compiled(spline._products, f"{real} *i64 {real} *i64 {real} " + 4 * "*i64 " + 5 * "i32 ", capability, True, **sizes)
    sizes["CHUNK"] = spline.CHUNK
    compiled(spline._outer_products, 3 * f"{real} " + 6 * "*i64 " + "i32 i32", capability, True, **sizes)
    compiled(pool._max, f"{real} *i64 *i64 {real} *i64 i32", capability, False, WIDE=64)
    lists = 2 * "*i32 " + "*i64 " + 3 * "*i32 " + 4 * "*i64 " + "*i32 *fp64 " + 6 * "i32 "
    compiled(neighbors._nearest, lists, capability, False, EVENTS=8, LANES=64, FAR=neighbors.FAR)
    compiled(pool._mean, f"{real} *i64 *i64 {real} i32", capability, False, WIDE=64)
"""


def test_kernels_compile_for_gpus(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    environment["TRITON_CACHE_DIR"] = str(tmp_path)
    (tmp_path / "compile_all.py").write_text(COMPILE)
    ran = subprocess.run([sys.executable, tmp_path / "compile_all.py"], env=environment, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
