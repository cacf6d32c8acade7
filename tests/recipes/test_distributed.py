"""Two processes train as one does."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

RECIPE = Path(__file__).parents[2] / "recipes" / "train_objects.py"


def test_two_processes_give_the_same_training_as_one(fake_nmnist, tmp_path):
    logs = {}
    for count in (1, 2):
        out = tmp_path / str(count)
        launch = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(count)] if count > 1 else []
        # 40 recordings in batches of 15: the last one, of 10, is cut to shares of another size
        flags = ["--dataset", "n-mnist", "--root", fake_nmnist, "--out", out, "--epochs", 2, "--batch", 15]
        flags += ["--votes", 1, "--device", "cpu"]
        command = [sys.executable, *launch, str(RECIPE), *map(str, flags)]
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)
        assert result.returncode == 0, result.stderr[-3000:]
        logs[count] = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [line["epoch"] for line in logs[2]] == [1, 2]
    for one, two in zip(logs[1], logs[2], strict=True):
        assert two["loss"] == pytest.approx(one["loss"], rel=1e-4)
        assert two["train_accuracy"] == one["train_accuracy"]
    one, two = (torch.load(tmp_path / c / "checkpoint.pt", weights_only=True)["model"] for c in ("1", "2"))
    # Adam steps by the sign of a gradient where that is all but zero, so a few weights may go another way
    for name in one:
        assert torch.allclose(one[name], two[name], atol=5e-3), name
