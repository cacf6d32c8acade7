import json
import re
import runpy
from dataclasses import replace
from types import SimpleNamespace

import pytest
from places import RECIPES

import nvsdata
from nvsdata import training
from nvsdata.datasets import dataset_named


def test_an_ablation_goes_on_where_it_was_and_draws_its_groups(run, many, tmp_path, monkeypatch):
    given = []

    def noted(*arguments, real=training.votes):
        given.append(real(*arguments))
        return given[-1]

    monkeypatch.setattr(training, "votes", noted)
    flags = ["--dataset", "n-mnist", "--root", many, "--out", tmp_path, "--only", "metric", "--seeds", 0, "--epochs", 1]
    assert "0 runs are done, 2 are left" in run("ablation.py", *flags)
    head, *lines = map(json.loads, (tmp_path / "runs.jsonl").read_text().splitlines())
    assert head["epochs"] == 1
    assert "'k': 1, " in head["defaults"]
    assert {line["settings"] for line in lines} == {"default", "beta 5e-06"}
    assert len(lines) == len(given) == 2
    # of the training recordings, not of those for testing
    _, held_out = nvsdata.NMNIST(many, "train").hold_out(0.25)
    for line, found in zip(lines, given, strict=True):
        voters = found.voters.double().numpy()
        targets = found.targets.numpy()
        assert targets.tolist() == held_out.targets
        assert voters.shape[1:] == (5, len(targets), 10)
        assert line["one"] == round((voters.argmax(-1) == targets).mean(), 4)
        # mean log-probabilities of five windows
        assert line["five"] == round((voters.mean(1).argmax(-1) == targets).mean(), 4)
    assert all(line["window_ms"] > 0 for line in lines)
    pictures = {"metric.png", "front-window_ms.png", "front-minutes.png"}
    assert pictures <= {path.name for path in tmp_path.iterdir()}
    again = run("ablation.py", *flags)
    assert "2 runs are done, 0 are left" in again
    assert "beta = 5e-6" in again
    # two more seeds
    ones = {"default": (0.5, 0.6, 0.7), "beta 5e-06": (0.49, 0.58, 0.67)}
    more = [line | {"seed": seed, "one": ones[line["settings"]][seed]} for line in lines for seed in range(3)]
    (tmp_path / "runs.jsonl").write_text("".join(json.dumps(line) + "\n" for line in (head, *more)))
    default, beta = (re.split("  +", row.strip()) for row in run("ablation.py", *flags).splitlines()[-2:])
    assert (len(default), *default[:2], default[-1]) == (6, "beta = (5e-6)^2", "0.600 ± 0.100", "3")
    # differences of 1, 2 and 3 points
    assert (len(beta), beta[1], beta[5], beta[-1]) == (8, "0.580 ± 0.090", "-2.0 (-4.5 to +0.5)", "3")
    with pytest.raises(SystemExit, match="has runs with other epochs"):
        run("ablation.py", *flags[:-1], 2)


def test_groups_belong_to_a_dataset(run, tmp_path, capsys):
    with pytest.raises(SystemExit):
        run("ablation.py", "--dataset", "n-cars", "--root", tmp_path, "--out", tmp_path, "--only", "width", "k")
    assert "--only: no group of n-cars is named k" in capsys.readouterr().err


# settings that change the number of weights
STRUCTURE = {"depth", "kernel_size", "width", "network", "convolution", "features", "root_weight", "pseudo"}


def test_only_changes_of_a_network_change_its_weights():
    ablation = SimpleNamespace(**runpy.run_path(str(RECIPES / "ablation.py")))
    for study in ablation.STUDIES.values():
        info = dataset_named(study.base.dataset).info

        def weights(protocol, info=info):
            network = protocol.build(info.sensor_size, len(info.classes))
            return sum(weight.numel() for weight in network.parameters())

        usual = weights(study.base)
        for changes in (changes for group in study.groups.values() for changes in group.values()):
            if not STRUCTURE & changes.keys():
                assert weights(replace(study.base, **changes)) == usual, changes
        names = {ablation.label_of(study, changes) for group in study.groups.values() for changes in group.values()}
        assert "default" in names
        assert len(names) > len(study.groups)
