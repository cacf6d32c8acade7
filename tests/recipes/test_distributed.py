"""Two processes train as one does."""

import json
import os
import subprocess
import sys

import pytest
import torch
from places import RECIPES

# the fixtures of conftest.py, for other processes
PLOTLESS = """
import runpy, sys
from nvsdata.training import accuracy_by_window, report
assert all(hasattr(accuracy_by_window, name) for name in ("MOST_DRAWS", "FACTORS", "FRACTIONS"))
assert hasattr(report, "_pictures") and hasattr(report, "_sheet")
accuracy_by_window.MOST_DRAWS, accuracy_by_window.FACTORS, accuracy_by_window.FRACTIONS = 1, (0.5, 1.0), (0.5,)
report._pictures, report._sheet = lambda *_: {{}}, lambda *_: None
sys.path.insert(0, {recipes!r})
runpy.run_path({recipes!r} + "/train_objects.py", run_name="__main__")
"""


@pytest.mark.usefixtures("plotless")
def test_two_processes_give_the_same_training_as_one(run, fake_nmnist, tmp_path):
    # 40 recordings in batches of 15: the last one, of 10, is cut to shares of another size
    flags = ["--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 1, "--batch", 15, "--votes", 1]
    # deeper networks multiply what is left of rounding: 0.1% of the loss after three steps
    flags += ["--depth", 3]
    flags = [*map(str, flags), "--device", "cpu", "--out"]
    run("train_objects.py", *flags, tmp_path / "1")
    (tmp_path / "recipe.py").write_text(PLOTLESS.format(recipes=str(RECIPES)))
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [*launch, str(tmp_path / "recipe.py"), *flags, str(tmp_path / "2")]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert result.returncode == 0, result.stderr[-3000:]
    logs = {
        count: [json.loads(line) for line in (tmp_path / str(count) / "log.jsonl").read_text().splitlines()]
        for count in (1, 2)
    }
    assert [line["epoch"] for line in logs[2]] == [1]
    for one, two in zip(logs[1], logs[2], strict=True):
        assert two["loss"] == pytest.approx(one["loss"], rel=1e-4)
        assert two["train_accuracy"] == one["train_accuracy"]
    one, two = (json.loads((tmp_path / c / "report.json").read_text()) for c in ("1", "2"))
    assert one.keys() == two.keys()
    for quantity in ("accuracy_by_window_us", "accuracy_by_events"):
        assert one[quantity].keys() == two[quantity].keys()
    one, two = (torch.load(tmp_path / c / "checkpoint.pt", weights_only=True)["model"] for c in ("1", "2"))
    rate = logs[1][0]["learning_rate"]
    # Adam steps by the sign of a gradient where that is all but zero, so a few weights may go another way
    for name in one:
        # nothing but rounding is left of the gradient of a bias before a normalization: each of 3 steps may differ
        steps = 3 if name.endswith("conv.bias") else 1
        assert torch.allclose(one[name], two[name], atol=2 * steps * rate), name
