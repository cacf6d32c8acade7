"""Dropout: as often and as much as it says, in training only; and where the thesis has it."""

import golden
import pytest
import torch

from nvsdata import models
from nvsdata.models.distributed import Dropout


@pytest.mark.parametrize("p", [0.0, 0.3, 0.5, 0.9])
def test_a_share_p_becomes_0_and_the_rest_makes_up_for_it(p):
    layer, x = Dropout(p), torch.arange(1.0, 40_001.0).view(200, 200)
    out = layer(x)
    kept = out != 0
    torch.testing.assert_close(out[kept], x[kept] / (1 - p))
    # five standard deviations
    assert (~kept).double().mean().item() == pytest.approx(p, abs=5 * (p * (1 - p) / x.numel()) ** 0.5)
    assert torch.equal(layer(x), x) == (p == 0)
    assert torch.equal(layer.eval()(x), x)


@pytest.mark.parametrize("build", [models.rgcnn, models.gcnn])
@pytest.mark.parametrize("name", ["n-mnist", "asl-dvs"])
def test_graph_cnns_drop_half_after_the_first_full_layer(build, name):
    """Section 4.4.2."""
    model = golden.fill(build(name))
    seen = {}
    for part in ("hidden", "classify"):
        layer = getattr(model, part)
        layer.register_forward_hook(lambda _, given, out, part=part: seen.update({part: (given[0], out)}))
    batch = golden.graphs(model.sensor_size)
    with torch.no_grad():
        model(batch)
        activated = torch.relu(seen["hidden"][1])
        assert torch.equal(seen["classify"][0], activated)
        assert (activated == 0).any()
        for part in model.train().features.modules():
            part.training = False
        shares = []
        for _ in range(20):
            model(batch)
            given = seen["classify"][0]
            alive = activated > 0
            shares.append((given[alive] == 0).double().mean().item())
            kept = alive & (given > 0)
            torch.testing.assert_close(given[kept], 2 * activated[kept])
    count = 20 * int(alive.sum())
    assert sum(shares) / 20 == pytest.approx(0.5, abs=5 * 0.5 / count**0.5)
    assert count > 1000
