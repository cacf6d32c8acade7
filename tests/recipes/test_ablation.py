import json

import numpy as np
import pytest

from nvsdata import training


def test_an_ablation_goes_on_where_it_was_and_draws_its_groups(run, fake_nmnist, tmp_path, monkeypatch):
    given = []

    def noted(*arguments, real=training.votes):
        given.append(real(*arguments))
        return given[-1]

    monkeypatch.setattr(training, "votes", noted)
    flags = ["--root", fake_nmnist, "--out", tmp_path, "--only", "metric", "--seeds", 0, "--epochs", 1]
    assert "0 runs are done, 2 are left" in run("ablation.py", *flags)
    head, *lines = map(json.loads, (tmp_path / "runs.jsonl").read_text().splitlines())
    assert head["epochs"] == 1
    assert "'k': 1, " in head["defaults"]
    assert {line["settings"] for line in lines} == {"default", "beta 5e-06"}
    assert len(lines) == len(given) == 2
    for line, found in zip(lines, given, strict=True):
        voters = found.voters.double().numpy()
        targets = np.repeat(np.arange(10), 2)
        assert found.targets.tolist() == targets.tolist()
        assert voters.shape[1:] == (5, 20, 10)
        assert line["one"] == round((voters.argmax(-1) == targets).mean(), 4)
        # mean log-probabilities of five windows
        assert line["five"] == round((voters.mean(1).argmax(-1) == targets).mean(), 4)
    assert all(line["window_ms"] > 0 for line in lines)
    pictures = {"metric.png", "front-window_ms.png", "front-minutes.png"}
    assert pictures <= {path.name for path in tmp_path.iterdir()}
    again = run("ablation.py", *flags)
    assert "2 runs are done, 0 are left" in again
    assert "beta = 5e-6" in again
    with pytest.raises(SystemExit, match="has runs of other epochs"):
        run("ablation.py", *flags[:-1], 2)
