"""Operations of torch counted by hand, and the table of them."""

import pytest
import torch
from torch import nn

from nvsdata.models import Complexity, complexity
from nvsdata.models.operations import LayerCost


class Does(nn.Module):
    """A function of torch as a network."""

    def __init__(self, function):
        super().__init__()
        self.function = function

    def forward(self, x):
        return self.function(x)


ROWS = torch.tensor([0, 1, 1, 3])
# of x [4, 6]: what is done, and its operations by the text of `Counting`
DONE = {
    "sum": (lambda x: x.sum(), 24),
    "sum of rows": (lambda x: x.sum(0), 24),
    "running sum": (lambda x: x.cumsum(1), 24),
    # all values summed up, and a quotient for each result
    "mean": (lambda x: x.mean(), 25),
    "mean of rows": (lambda x: x.mean(0), 30),
    "root": (lambda x: x.sqrt(), 24),
    "product": (lambda x: x * x, 24),
    "of scalars": (lambda x: x * 2 + 1, 48),
    "in place": (lambda x: x.clone().add_(1), 24),
    "rows added to others": (lambda x: x.new_zeros(5, 6).index_add(0, ROWS, x), 24),
    "values added to others": (lambda x: x.new_zeros(4, 6).scatter_add(0, ROWS.view(4, 1).expand(4, 6), x), 24),
    "matrix and vector": (lambda x: x @ x[0], 2 * 4 * 6),
    "two vectors": (lambda x: x[0].dot(x[1]), 2 * 6),
    "matrices": (lambda x: x @ x.T, 2 * 4 * 6 * 4),
    "matrices added": (lambda x: x.new_zeros(4, 4).addmm_(x, x.T), 2 * 4 * 6 * 4),
    "sums of products": (lambda x: torch.addcmul(x, x, x), 48),
    "sums of quotients": (lambda x: torch.addcdiv(x, x, x), 48),
    "in between": (lambda x: torch.lerp(x, 2 * x, 0.5), 24 + 48),
    # between each two of 4 rows 6 differences, squares and sums, and a root
    "distances": (lambda x: torch.cdist(x, x), 16 * (3 * 6 + 1)),
    "averages along one axis": (lambda x: nn.functional.avg_pool2d(x[None, None], (2, 3)), 4 * (6 + 1)),
    "averages in three": (lambda x: nn.functional.avg_pool3d(x.view(1, 1, 2, 2, 6), 2), 3 * (8 + 1)),
    "adaptive averages": (lambda x: nn.functional.adaptive_avg_pool3d(x.view(1, 2, 2, 1, 6), (1, 1, 4)), 2 * 2 * 8 + 8),
    "copies": (lambda x: torch.cat((x, x.clone(), x.T.contiguous().view(4, 6))), 0),
    "choices": (lambda x: x.clamp(0, 1).amax(1).relu().sort().values, 0),
    "comparisons": (lambda x: torch.where(x > 0.5, x, 0).maximum(x), 0),
    "integers": (lambda x: (ROWS * 3 + 1).sum() * ROWS.cumsum(0), 0),
    "integers added to others": (lambda x: torch.zeros(5, dtype=torch.long).index_add(0, ROWS, ROWS), 0),
    # a real and a whole number of each
    "two results": (lambda x: x.frexp()[0], 24),
    "complex numbers": (lambda x: x.to(torch.complex64) * 2, 24),
}


@pytest.mark.parametrize("name", DONE)
def test_operations_are_those_by_hand(name):
    function, wanted = DONE[name]
    counted = complexity(Does(function), torch.rand(4, 6))
    assert counted.executed == wanted
    assert counted.uncounted == ()


def test_unknown_operations_are_named_once():
    found = complexity(nn.Sequential(Does(lambda x: x.logcumsumexp(0).logcumsumexp(1))), torch.rand(4, 6))
    assert found.uncounted == ("0 (Does): aten.logcumsumexp",)


@pytest.mark.parametrize(("kind", "gates"), [("tanh", 1), ("relu", 0)])
def test_plain_recurrent_layers(kind, gates):
    # each step: products with the input and the state, and a function of each unit
    expected = 10 * (2 * 6 * (4 + 6) + gates * 6)
    assert complexity(nn.RNN(4, 6, nonlinearity=kind), torch.rand(5, 2, 4)).executed == expected


def test_packed_sequences_have_as_many_steps_as_values():
    packed = nn.utils.rnn.pack_padded_sequence(torch.rand(5, 2, 4), torch.tensor([5, 2]))
    assert complexity(nn.GRU(4, 6), packed).executed == 7 * (2 * 18 * (4 + 6) + 8 * 6)


def test_the_table_has_a_line_for_each_layer_and_their_sums():
    layers = (
        LayerCost("first", "SplineConv", 1_234_567, 2_000_000, 12_345, 12_346),
        LayerCost("a.very.long.name", "AClassOfAVeryLongName", None, 500, None, 7),
    )
    table = str(Complexity(layers, ("first (SplineConv): aten.odd",), 12_353)).splitlines()
    assert table == [
        "layer             class                       MFLOPs     executed   parameters      weights",
        "first             SplineConv                   1.235        2.000       12,345       12,346",
        "a.very.long.name  AClassOfAVeryLongName            -        0.001            -            7",
        "all                                            1.235        2.001       12,345       12,353",
        "not counted: first (SplineConv): aten.odd",
    ]
    short = str(Complexity((LayerCost("a", "B", 1, 1, 1, 1),), (), 1)).splitlines()
    assert short[0].startswith("layer     class                MFLOPs ")
    assert len({len(line) for line in short}) == 1
    assert Complexity(layers, (), 0).size == 12_345 * 4 / 1024**2


def test_layers_without_weights_or_work_are_left_out():
    model = nn.Sequential(nn.Flatten(), nn.Linear(6, 2), nn.ReLU(), nn.Sequential(nn.Sigmoid(), nn.Identity()))
    layers = complexity(model, torch.rand(4, 6)).layers
    assert [(layer.name, layer.executed, layer.weights) for layer in layers] == [("1", 96, 14), ("3.0", 8, 0)]


def test_grouped_convolutions_have_fewer_parameters():
    counted = complexity(nn.Conv2d(4, 6, 3, groups=2, bias=False), torch.rand(1, 4, 3, 3))
    assert (counted.parameters, counted.weights) == ((2 * 9 + 1) * 6, 2 * 9 * 6)
    assert counted.flops == 2 * (2 * 9 + 1) * 6
