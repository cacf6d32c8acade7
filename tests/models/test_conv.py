"""The other convolutions against dense matrices, and against PyTorch Geometric where it is installed."""

import pytest
import torch

from nvsdata import Events, collate, models
from nvsdata import transforms as T
from nvsdata.models.conv import ChebConv, GCNConv, GINConv, GMMConv

LAYERS = {
    "gcn": lambda a, b: GCNConv(a, b),
    "cheb": lambda a, b: ChebConv(a, b, 4),
    "monet": lambda a, b: GMMConv(a, b, 6),
    "gin": lambda a, b: GINConv(a, b),
}
every_layer = pytest.mark.parametrize("name", LAYERS)


def graph(nodes=9, seed=0, directed=False):
    """Edges grouped by target, without loops; the last node is alone."""
    generator = torch.Generator().manual_seed(seed)
    joined = torch.rand(nodes, nodes, generator=generator) < 0.35
    if not directed:
        joined = joined | joined.T
    joined.fill_diagonal_(False)
    joined[-1], joined[:, -1] = False, False
    target, source = joined.nonzero(as_tuple=True)
    u = torch.rand(source.numel(), 2, generator=generator, dtype=torch.float64)
    return torch.stack((source, target)), u, torch.randn(nodes, 3, generator=generator, dtype=torch.float64)


def layer(name, a=3, b=5):
    torch.manual_seed(1)
    made = LAYERS[name](a, b).double()
    for parameter in made.parameters():
        torch.nn.init.normal_(parameter)
    return made


def dense(edges, nodes):
    matrix = torch.zeros(nodes, nodes, dtype=torch.float64)
    matrix[edges[1], edges[0]] = 1  # row hears column
    return matrix


@pytest.mark.parametrize("directed", [False, True])
def test_gcn_is_its_formula(directed):
    edges, u, x = graph(directed=directed)
    conv, a = layer("gcn"), dense(edges, len(x)) + torch.eye(len(x), dtype=torch.float64)
    scale = torch.diag(a.sum(1) ** -0.5)
    torch.testing.assert_close(conv(x, edges, u), scale @ a @ scale @ x @ conv.linear.weight.T + conv.bias)


def test_cheb_is_its_formula():
    edges, u, x = graph()
    conv, a = layer("cheb"), dense(edges, len(x))
    degree = a.sum(1)
    scale = torch.diag(torch.where(degree > 0, degree.clamp(min=1) ** -0.5, 0.0))
    laplacian = -scale @ a @ scale
    terms = [x, laplacian @ x]
    while len(terms) < 4:
        terms.append(2 * laplacian @ terms[-1] - terms[-2])
    expected = sum(term @ linear.weight.T for term, linear in zip(terms, conv.linears, strict=True)) + conv.bias
    torch.testing.assert_close(conv(x, edges, u), expected)


def test_monet_is_its_formula():
    edges, u, x = graph(directed=True)
    conv = layer("monet")
    expected = conv.root(x)
    matrices = conv.linear.weight.view(6, 5, 3)
    for node in range(len(x)):
        mine = (edges[1] == node).nonzero().flatten().tolist()
        for e in mine:
            for k in range(6):
                far = ((u[e] - conv.mean[k]) ** 2 / (conv.deviation[k] ** 2 + 1e-15)).sum()
                expected[node] = expected[node] + torch.exp(-far / 2) * matrices[k] @ x[edges[0, e]] / len(mine)
    torch.testing.assert_close(conv(x, edges, u), expected)


def test_gin_is_its_formula():
    edges, u, x = graph(directed=True)
    conv = layer("gin")
    torch.testing.assert_close(conv(x, edges, u), conv.mlp((1 + conv.eps) * x + dense(edges, len(x)) @ x))


@every_layer
def test_gradients(name):
    edges, u, x = graph(5)
    conv = layer(name, 3, 2)
    x.requires_grad_()
    assert torch.autograd.gradcheck(lambda *values: conv(values[0], edges, u), (x, *conv.parameters()))


@every_layer
def test_no_edges_and_no_nodes(name):
    conv = layer(name)
    none = torch.empty(2, 0, dtype=torch.int64), torch.empty(0, 2, dtype=torch.float64)
    assert conv(torch.ones(3, 3, dtype=torch.float64), *none).isfinite().all()
    assert conv(torch.empty(0, 3, dtype=torch.float64), *none).shape == (0, 5)


@every_layer
def test_agrees_with_pytorch_geometric(name):
    pyg = pytest.importorskip("torch_geometric.nn")
    edges, u, x = graph()
    ours = layer(name)
    if name == "gcn":
        theirs = pyg.GCNConv(3, 5).double()
        theirs.lin.weight.data, theirs.bias.data = ours.linear.weight.data, ours.bias.data
    elif name == "cheb":
        theirs = pyg.ChebConv(3, 5, 4).double()
        for mine, other in zip(ours.linears, theirs.lins, strict=True):
            other.weight.data = mine.weight.data
        theirs.bias.data = ours.bias.data
    elif name == "monet":
        theirs = pyg.GMMConv(3, 5, dim=2, kernel_size=6).double()
        theirs.g.data = ours.linear.weight.data.T.contiguous()
        theirs.mu.data, theirs.sigma.data = ours.mean.data, ours.deviation.data
        theirs.root.weight.data, theirs.bias.data = ours.root.weight.data, ours.root.bias.data
    else:
        theirs = pyg.GINConv(ours.mlp, eps=ours.eps.item(), train_eps=True).double()
    found = theirs(x, edges, u) if name == "monet" else theirs(x, edges)
    torch.testing.assert_close(ours(x, edges, u), found)


@every_layer
def test_the_plain_network_takes_it(name, tiny_batch):
    network = models.gcnn("n-mnist", convolution=name)
    batch, targets = tiny_batch
    torch.nn.functional.cross_entropy(network(batch), targets).backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


@pytest.fixture
def tiny_batch():
    samples = []
    for n in range(3):
        generator = torch.Generator().manual_seed(n)
        x, y = (torch.randint(0, 34, (30 * n,), generator=generator).numpy() for _ in range(2))
        samples.append((T.RadiusGraph()(Events(range(30 * n), x, y, x % 2, (34, 34))), n))
    return collate(samples)


def test_unknown_convolutions():
    with pytest.raises(ValueError, match="convolution must be one of"):
        models.gcnn("n-mnist", convolution="gat")
    with pytest.raises(ValueError, match=r"convolution must be one of \('spline', .*, or a class of your own, not 3"):
        models.RGCNN(10, convolution=3)
    with pytest.raises(ValueError, match=r"convolution must return a torch\.nn\.Module, not 8"):
        models.RGCNN(10, convolution=lambda a, b: 8)


class Offsets(torch.nn.Module):
    """A convolution of one's own: the mean over neighbors of features and pseudo-coordinates."""

    def __init__(self, in_channels, out_channels):
        super().__init__()
        self.linear = torch.nn.Linear(in_channels + 2, out_channels)

    def forward(self, x, edge_index, edge_attr):
        assert (edge_index[0] != edge_index[1]).all()
        assert edge_attr.shape == (edge_index.shape[1], 2)
        source, target = edge_index
        heard = torch.zeros(len(x), x.shape[1] + 2).index_add_(0, target, torch.cat((x[source], edge_attr), 1))
        return self.linear(heard / torch.bincount(target, minlength=len(x)).clamp(min=1).unsqueeze(1))


@pytest.mark.parametrize("build", [models.RGCNN, models.GCNN])
@pytest.mark.parametrize("convolution", [Offsets, lambda a, b: Offsets(a, b), "gcn"])
def test_networks_take_a_convolution_of_ones_own(build, convolution, tiny_batch):
    network = build(4, convolution=convolution)
    kind = GCNConv if convolution == "gcn" else Offsets
    assert sum(isinstance(module, kind) for module in network.modules()) == 3
    batch, targets = tiny_batch
    torch.nn.functional.cross_entropy(network(batch), targets).backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


def test_a_layer_of_pytorch_geometric_is_a_convolution(tiny_batch):
    pyg = pytest.importorskip("torch_geometric.nn")
    network = models.RGCNN(4, convolution=lambda a, b: pyg.GATConv(a, b, edge_dim=2))
    assert network(tiny_batch[0]).shape == (3, 4)


def test_a_convolution_of_ones_own_counts_with_its_parts(tiny_batch):
    counted = models.complexity(models.RGCNN(4, convolution=Offsets), tiny_batch[0])
    layers = {layer.name: layer for layer in counted.layers}
    own, linear = layers["features.0.conv"], layers["features.0.conv.linear"]
    assert (own.kind, linear.kind) == ("Offsets", "Linear")
    # one product of [90, 3] and [3, 32]; the means over neighbors are the convolution's own
    assert (linear.executed, linear.weights) == (2 * 90 * 3 * 32, 4 * 32)
    assert (own.flops, own.weights) == (None, 0)
    assert own.executed > 0


def test_other_convolutions_begin_as_they_say():
    assert len(ChebConv(2, 3).linears) == 3
    assert len(ChebConv(2, 3, 1).linears) == 1
    with pytest.raises(ValueError, match="size must be at least 1, not 0"):
        ChebConv(2, 3, 0)
    torch.manual_seed(0)
    plain = GMMConv(2, 3)
    assert plain.mean.shape == plain.deviation.shape == (25, 2)
    assert (plain.deviation == 0.5).all()
    assert 0 <= plain.mean.min() < 0.2
    assert 0.8 < plain.mean.max() <= 1
    # as many Gaussians as the B-spline's kernel has cells
    assert models.CONVOLUTIONS["monet"](2, 3, 4, 3).mean.shape == (64, 3)
    assert len(models.CONVOLUTIONS["cheb"](2, 3, 4, 3).linears) == 4
    assert GINConv(2, 3).eps == 0
    for layer in (GCNConv(2, 3), ChebConv(2, 3)):
        assert not layer.bias.any()
