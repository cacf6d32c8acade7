"""Networks give what they gave when their outputs were last looked at; see golden.py."""

import json

import golden
import pytest
import torch

from nvsdata import models

KEPT = json.loads(golden.PATH.read_text())


def test_every_network_and_every_configuration_has_its_numbers():
    assert list(KEPT) == list(golden.CASES)
    names = [name for name in golden.CASES if golden.CASES[name].given]
    assert set(models.NETWORKS) <= {name.split()[0] for name in names}
    wanted = [f"{kind} {name}" for kind in ("rgcnn", "gcnn") for name in models.CONFIGURATIONS]
    wanted += [f"{kind} of depth {depth}" for kind in ("rgcnn", "gcnn") for depth in models.DEPTHS]
    wanted += [f"rgcnn of depth {depth} for 34x34" for depth in models.SMALL_DEPTHS if depth > 3]
    wanted += [f"rgcnn3d {name} {temporal}" for name in models.CONFIGURATIONS_3D for temporal in models.TEMPORAL]
    wanted += [f"gcnn {convolution}" for convolution in models.CONVOLUTIONS]
    assert set(wanted) <= set(names)


@pytest.mark.parametrize("name", golden.CASES)
def test_names_and_shapes_of_weights_are_as_before(name):
    assert golden.weights_of(golden.CASES[name]) == {key: KEPT[name][key] for key in KEPT[name] if key != "scores"}


@pytest.mark.parametrize("name", [name for name, case in golden.CASES.items() if case.given])
def test_scores_are_as_before(name):
    scores = golden.scores_of(golden.CASES[name])
    kept = torch.tensor(KEPT[name]["scores"], dtype=torch.float64)
    size = kept.abs().max()
    # neither dead nor the same for any input
    assert (kept[0] - kept[1]).abs().max() > 0.01 * size
    assert kept[:, -1].min() > 0.01 * size
    torch.testing.assert_close(
        torch.tensor(golden.summary(scores)).double(), kept, rtol=0, atol=golden.TOLERANCE * size.item()
    )


def test_the_builders_by_name_build_the_configurations():
    for name, settings in models.CONFIGURATIONS.items():
        with torch.device("meta"):
            built = models.rgcnn(name), models.gcnn(name)
        assert all(settings.items() <= model.settings.items() for model in built)
    for name, settings in models.CONFIGURATIONS_3D.items():
        with torch.device("meta"):
            model = models.rgcnn3d(name, "plain")
        assert (settings | {"temporal": "plain"}).items() <= model.settings.items()


def test_the_script_tells_what_changed(tmp_path, monkeypatch, capsys):
    path = tmp_path / "golden.json"
    path.write_text(golden.PATH.read_text())
    monkeypatch.setattr(golden, "PATH", path)
    monkeypatch.setattr(golden, "CASES", {name: golden.CASES[name] for name in ("lstm", "rgcnn by default")})
    golden.main()
    output = capsys.readouterr().out
    assert "vgg:\n  was {" in output
    assert "lstm:" not in output
    assert json.loads(path.read_text()) == {name: KEPT[name] for name in golden.CASES}


def test_another_processors_digits_are_no_change(tmp_path, monkeypatch, capsys):
    (tmp_path / "golden.json").write_text(golden.PATH.read_text())
    monkeypatch.setattr(golden, "PATH", tmp_path / "golden.json")
    monkeypatch.setattr(golden, "CASES", {"lstm": golden.CASES["lstm"]})
    kept = KEPT["lstm"]
    size = max(abs(value) for one in kept["scores"] for value in one)
    for share, changed in ((0.9, False), (-0.9, False), (1.1, True)):
        scores = [[value + share * golden.TOLERANCE * size for value in one] for one in kept["scores"]]
        monkeypatch.setattr(golden, "record", lambda _, scores=scores: kept | {"scores": scores})
        golden.main()
        assert ("lstm:" in capsys.readouterr().out) is changed
        assert json.loads(golden.PATH.read_text())["lstm"]["scores"] == (scores if changed else kept["scores"])
        golden.PATH.write_text(json.dumps(KEPT))
    for other in (
        {"parameters": 1},
        {"hash": ""},
        {"scores": kept["scores"][:1]},
        {"scores": [[float("nan")] * 7] * 2},
    ):
        assert not golden.agree(kept, kept | other)
    assert not golden.agree(None, kept)
    assert not golden.agree(kept, {key: value for key, value in kept.items() if key != "scores"})
