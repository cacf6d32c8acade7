"""Kernels give the same bits at every level of instruction sets."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from nvsdata.kernels import _native

LEVELS = range(2, 5)


def run_at(level, *words):
    environment = os.environ | {"NVSDATA_CPU": level}
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, env=environment, check=False)


def digests():
    """Of results: logarithms of all brightnesses, and what emulators give for a video of each kind."""
    from nvsdata.emulation import DVS, PIX2NVS
    from nvsdata.kernels.emulate.frames import logarithm
    from nvsdata.kernels.emulate.pix2nvs import TABLE_SIZE

    out = np.empty(TABLE_SIZE, np.float32)
    for number in (np.int32, np.float32):
        logarithm(np.arange(TABLE_SIZE, dtype=number), 1.5, 0.3, out)
        yield f"logarithm {number.__name__}", out
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (6, 45, 203, 3), dtype=np.uint8)
    color[:, :, 70:150] = color[0, :, 70:150]
    emulators = [
        *(PIX2NVS(mismatch=m, threshold=t, inhibition=i) for m in (0, 0.1) for t in (0.04, 0.2) for i in (1, 2, 3)),
        *(PIX2NVS(difference=name, new=new) for name in ("average", "minimum") for new in (False, True)),
        PIX2NVS(max_events=50, exp=False),
        PIX2NVS(timestamps="random"),
        *(PIX2NVS(mode=mode, threshold=1) for mode in ("CE", "LICE")),
        *(DVS(mismatch=m, leak=leak, cutoff=c) for m in (0, 0.1) for leak in (0, 0.1) for c in (0, 100)),
        DVS(refractory=5_000, bandwidth=1e7),
    ]
    for emulator in emulators:
        for video in (color, color[..., 0].copy()):
            for gap in (33_333, 3_000_000):
                events = emulator.emulate(list(video), times=[gap * k for k in range(len(video))])
                yield f"{emulator} {video.ndim} {gap}", np.stack([c.astype(np.int64) for c in events.columns])


@pytest.fixture(scope="module")
def found():
    done = {level: run_at(f"v{level}", __file__) for level in LEVELS}
    for level, process in done.items():
        assert process.returncode == 0, (level, process.stderr)
    return {level: process.stdout.splitlines() for level, process in done.items()}


def test_levels_are_what_is_allowed_and_available(found):
    # the highest: this process may have been limited by NVSDATA_CPU
    here = max(int(lines[0]) for lines in found.values())
    assert here >= _native.cpu_level()
    assert [int(lines[0]) for lines in found.values()] == [min(level, here) for level in LEVELS]


def test_results_are_the_same_at_every_level(found):
    for level in (3, 4):
        assert found[level][1:] == found[2][1:]
    assert len(found[2]) > 50


def test_an_unknown_level_is_an_error():
    for name in ("v5", "v1", "avx2", "v33"):
        process = run_at(name, "-c", "from nvsdata.kernels import _native; _native.cpu_level()")
        assert process.returncode != 0
        assert f'NVSDATA_CPU is "{name}": it must be v2, v3 or v4' in process.stderr


if __name__ == "__main__":
    print(_native.cpu_level())
    for name, array in digests():
        print(name, array.size, hashlib.sha256(array.tobytes()).hexdigest())
