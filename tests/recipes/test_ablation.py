import json

import pytest


def test_an_ablation_goes_on_where_it_was_and_draws_its_groups(run, fake_nmnist, tmp_path):
    flags = ["--root", fake_nmnist, "--out", tmp_path, "--only", "metric", "--seeds", 0, "--epochs", 1]
    assert "0 runs are there, 2 are left" in run("ablation.py", *flags)
    head, *lines = map(json.loads, (tmp_path / "runs.jsonl").read_text().splitlines())
    assert head["epochs"] == 1
    assert head["defaults"].startswith("Objects(dataset='n-mnist', ")
    assert {line["settings"] for line in lines} == {"default", "beta 5e-06"}
    assert all(0 <= line[name] <= 1 for line in lines for name in ("one", "five"))
    assert all(line["window_ms"] > 0 for line in lines)
    pictures = {"metric.png", "front-window_ms.png", "front-minutes.png"}
    assert pictures <= {path.name for path in tmp_path.iterdir()}
    again = run("ablation.py", *flags)
    assert "2 runs are there, 0 are left" in again
    assert "literal" in again
    with pytest.raises(SystemExit, match="has runs of other epochs"):
        run("ablation.py", *flags[:-1], 2)
