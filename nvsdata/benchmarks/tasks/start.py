"""Benchmarks of the time from the start of a process to its first result, and of its memory."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from importlib import import_module

from nvsdata import formats
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import digits
from nvsdata.benchmarks.tasks.emulate import clip

READ = """import nvsdata
events = nvsdata.read(sys.argv[1], sensor_size=(34, 34))
"""
# first steps of a new user
OURS = {
    "import": "import nvsdata",
    "N-MNIST file to frames": f"{READ}nvsdata.transforms.ToFrames(10)(events)",
    "N-MNIST file to graph": f"{READ}nvsdata.transforms.RadiusGraph(3.0)(events[:1000])",
    "N-MNIST file to scores of RG-CNN": f"""{READ}from nvsdata import models
graph = nvsdata.transforms.RadiusGraph(3.0)(events[:1000])
models.rgcnn("n-mnist").eval()(graph)""",
    "video to events": "import nvsdata; nvsdata.PIX2NVS().emulate(sys.argv[2])",
    "first scores of a stream": f"""{READ}from nvsdata import models
live = models.stream(models.rgcnn("n-mnist").eval())
live.feed(events[:1000])
live.scores()""",
}
THEIRS = {
    "import": ("torch", "import torch"),
    "N-MNIST file to frames": (
        "tonic",
        """import tonic
from tonic.io import read_mnist_file
import numpy as np
dtype = np.dtype([("x", int), ("y", int), ("t", int), ("p", int)])
tonic.transforms.ToFrame(sensor_size=(34, 34, 2), n_time_bins=10)(read_mnist_file(sys.argv[1], dtype))""",
    ),
}
# VmHWM, because getrusage would include the peak of the parent process before exec
REPORT = """
try:
    with open("/proc/self/status") as file:
        print(next(line.split()[1] for line in file if line.startswith("VmHWM")))
except OSError:
    print(0)
"""


def cases(options: Options) -> list[Case]:
    """Return the cases: the time of imports, and the time to first results."""
    return list(_each(options))


def _each(options: Options) -> Iterator[Case]:
    for benchmark, script in OURS.items():
        if benchmark in THEIRS:
            library, theirs = THEIRS[benchmark]
            yield Case("start", benchmark, partial(_process, options, theirs, library), library=library)
        yield Case("start", benchmark, partial(_process, options, script), default=True)


def _process(options: Options, script: str, library: str = "") -> PreparedCase:
    if library:
        import_module(library)
    recording = options.scratch / "start.bin"
    if not recording.exists():
        formats.write(digits(options, 1)[0], recording)
    command = [sys.executable, "-c", f"import sys\n{script}\n{REPORT}", str(recording), str(clip(options))]

    def run() -> int:
        return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    def memory(kilobytes: int) -> Mapping[str, int]:
        return {"memory in MB": kilobytes // 1024}

    return PreparedCase(run, counters=memory)
