"""Layers and networks as the thesis's text has them: in float64, node by node and edge by edge.

Networks here take the weights of the library's by their names, and nothing else of it.
"""

import itertools
from dataclasses import replace

import numpy as np
import torch

from nvsdata import GraphBatch


def weights_of(model):
    """Everything that a network keeps, float64, by name."""
    return {name: value.double().numpy() for name, value in model.state_dict().items()}


def hat(k, u, size):
    """Open B-spline of degree 1: 1 at knot k, 0 at its neighbors, straight between."""
    return max(0.0, 1.0 - abs(u * (size - 1) - k)) if size > 1 else 1.0


def slow_spline_conv(x, edge_index, u, weight, size, bias=None, root=None):
    """Equation 4.6 in any number of dimensions: all cells, term by term, in float64 and without the activation."""
    x, u, weight = (np.asarray(torch.as_tensor(a).detach().double()) for a in (x, u, weight))
    out = np.zeros((len(x), weight.shape[2]))
    for i in range(len(x)):
        incoming = [e for e in range(edge_index.shape[1]) if edge_index[1, e] == i]
        for e in incoming:
            for knots in itertools.product(range(size), repeat=u.shape[1]):
                basis = np.prod([hat(k, v, size) for k, v in zip(knots, u[e], strict=True)])
                cell = sum(k * size**axis for axis, k in enumerate(knots))
                if basis:
                    out[i] += basis * (x[edge_index[0, e]] @ weight[cell]) / len(incoming)
    if root is not None:
        out += x @ np.asarray(torch.as_tensor(root).detach().double())
    return out if bias is None else out + np.asarray(torch.as_tensor(bias).detach().double())


def slow_pool(batch, cluster, grid, mode):
    """Equations 4.8 and 4.9 with dictionaries: {(graph, row, column): (x, y, t, features)} and edges between them."""
    members = {}
    names = []
    for i in range(batch.num_nodes):
        px, py = batch.pos[i].tolist()
        column = min(max(int(np.floor(px / cluster[0])), 0), grid[0] - 1)
        row = min(max(int(np.floor(py / cluster[1])), 0), grid[1] - 1)
        names.append((int(batch.batch[i]), row, column))
        members.setdefault(names[-1], []).append(i)
    nodes = {}
    for name, ids in members.items():
        mean = batch.pos[ids].double().mean(0).tolist()
        x = batch.x[ids].double()
        features = x.max(0).values if mode == "max" else x.mean(0)
        nodes[name] = (np.floor(mean[0]), np.floor(mean[1]), sum(batch.t[ids].tolist()) // len(ids), features)
    edges = {(names[a], names[b]) for a, b in zip(*batch.edge_index.tolist(), strict=True) if names[a] != names[b]}
    return nodes, edges


def pooled(batch, cluster, sensor_size, mode="max"):
    """The graphs after a pooling, with pseudo-coordinates of their new nodes (4.2.1, 4.2.3)."""
    grid = [-(-side // length) for side, length in zip(sensor_size, cluster, strict=True)]
    nodes, edges = slow_pool(batch, cluster, grid, mode)
    names = sorted(nodes)
    # neighbors are a cluster's side apart, and no nearer than before
    reach = (*(max(old, side) for old, side in zip(batch.reach, cluster, strict=False)), *batch.reach[2:])
    pairs = sorted((names.index(b), names.index(a)) for a, b in edges)
    u = []
    for target, source in pairs:
        apart = [nodes[names[source]][axis] - nodes[names[target]][axis] for axis in range(len(reach))]
        share = [far / most for far, most in zip(apart, reach, strict=True)]
        u.append([min(abs(s), 1) if batch.pseudo == "abs" else min(max((s + 1) / 2, 0), 1) for s in share])
    first = [sum(name[0] < graph for name in names) for graph in range(batch.num_graphs + 1)]
    return GraphBatch(
        x=torch.stack([nodes[name][3] for name in names]),
        pos=torch.tensor([nodes[name][:2] for name in names], dtype=torch.float64),
        t=torch.tensor([nodes[name][2] for name in names]),
        edge_index=torch.tensor([(source, target) for target, source in pairs], dtype=torch.int64).T,
        edge_attr=torch.tensor(u, dtype=torch.float32).view(-1, len(reach)),
        reach=reach,
        pseudo=batch.pseudo,
        sensor_size=batch.sensor_size,
        batch=torch.tensor([name[0] for name in names]),
        ptr=torch.tensor(first),
        volumes=batch.volumes,
    )


def normalized(x, w, name):
    """Equation 4.7 with the running statistics; channels lie along the last axis."""
    spread = np.sqrt(w[f"{name}.running_var"] + 1e-5)
    return (x - w[f"{name}.running_mean"]) / spread * w[f"{name}.weight"] + w[f"{name}.bias"]


def spline(batch, w, name, size, loops=True):
    """Equation 4.6 with a node among its own neighbors, and a root weight."""
    source, target = batch.edge_index.tolist()
    u = batch.edge_attr.tolist()
    if loops:
        # a node, seen from itself, is at distance 0
        here = [0.0 if batch.pseudo == "abs" else 0.5] * batch.edge_attr.shape[1]
        source, target = source + list(range(batch.num_nodes)), target + list(range(batch.num_nodes))
        u = u + [here] * batch.num_nodes
    edges = np.array([source, target])
    return slow_spline_conv(
        batch.x, edges, torch.tensor(u), w[f"{name}.weight"], size, w[f"{name}.bias"], w.get(f"{name}.root")
    )


def block(batch, w, name, *, size, residual, loops=True, convolution=spline):
    """Conv(c_in, c_out) or Res_g(c_in, c_out) of 4.2.5, activated."""
    x = normalized(convolution(batch, w, f"{name}.conv", size, loops), w, f"{name}.norm")
    if residual:
        x = x + normalized(spline(batch, w, f"{name}.shortcut", 1, loops), w, f"{name}.shortcut_norm")
    return replace(batch, x=torch.from_numpy(np.maximum(x, 0)))


def full(x, w, name):
    """A fully connected layer without activation, eq. 4.10."""
    return x @ w[f"{name}.weight"].T + w[f"{name}.bias"]


def on_grid(batch, cluster, sensor_size):
    """Features of nodes in the cells of a grid, [graphs, rows, columns, C]; other cells are 0 (eq. 5.1)."""
    columns, rows = (-(-side // length) for side, length in zip(sensor_size, cluster, strict=True))
    grid = np.zeros((batch.num_graphs, rows, columns, batch.x.shape[1]))
    for n, (x, y) in enumerate(batch.pos.tolist()):
        grid[int(batch.batch[n]), int(y // cluster[1]), int(x // cluster[0])] = batch.x[n]
    return grid


def graph_cnn(batch, w, s, *, residual, convolution=spline):
    """Conv -> MaxP -> (block -> MaxP) x L -> FC -> FC of section 4.2.5, of a network's settings `s`."""
    for depth, cluster in enumerate(s["clusters"]):
        options = {"size": s["kernel_size"], "residual": residual and depth > 0, "loops": s["loops"]}
        batch = block(batch, w, f"features.{3 * depth}", **options, convolution=convolution)
        batch = pooled(batch, cluster, s["sensor_size"], s["pooling"])
    grid = on_grid(batch, s["clusters"][-1], s["sensor_size"])
    return full(np.maximum(full(grid.reshape(len(grid), -1), w, "hidden"), 0), w, "classify")


def conv3d(x, weight):
    """Convolution [T, H, W, C] with stride 1 that keeps the size; `weight` [out, C, k, k, k]."""
    size = weight.shape[2]
    padded = np.pad(x, (*[(size // 2,) * 2] * 3, (0, 0)))
    matrices = np.ascontiguousarray(weight.transpose(2, 3, 4, 1, 0))
    out = np.zeros((x[..., 0].size, len(weight)))
    for t, row, column in itertools.product(range(size), repeat=3):
        moved = padded[t : t + x.shape[0], row : row + x.shape[1], column : column + x.shape[2]]
        out += moved.reshape(len(out), -1) @ matrices[t, row, column]
    return out.reshape(*x.shape[:3], -1)


def pool3d(x, stride):
    """Maxima of 2 x 2 x 2 values with strides (t, h, w); what is left over at an end is pooled by itself."""
    for axis, step in enumerate(stride):
        starts = range(0, x.shape[axis], step) if step > 1 else range(x.shape[axis] - 1)
        x = np.stack([x.take(range(n, min(n + 2, x.shape[axis])), axis).max(axis) for n in starts], axis)
    return x


def around3d(x):
    """Maxima of 3 x 3 x 3 values around each."""
    for axis in range(3):
        length = x.shape[axis]
        spans = [range(max(n - 1, 0), min(n + 2, length)) for n in range(length)]
        x = np.stack([x.take(span, axis).max(axis) for span in spans], axis)
    return x


def layer3d(x, w, name):
    """Conv_3D of 5.3.1: convolution, batch normalization, ReLU."""
    return np.maximum(normalized(conv3d(x, w[f"{name}.0.weight"]), w, f"{name}.1"), 0)


def inception3d(x, w, name):
    """Inc_b of 5.3.1: four streams, concatenated."""
    s = f"{name}.streams"
    two, three = (layer3d(layer3d(x, w, f"{s}.{n}.0"), w, f"{s}.{n}.1") for n in (1, 2))
    return np.concatenate((layer3d(x, w, f"{s}.0"), two, three, layer3d(around3d(x), w, f"{s}.3.1")), -1)


def residual3d(x, w, name):
    """Res of 5.3.1: two convolutions, and a connection from the input of the first to the output of the second."""
    inner = layer3d(x, w, f"{name}.body.0")
    base = normalized(conv3d(inner, w[f"{name}.body.1.weight"]), w, f"{name}.body.2")
    return np.maximum(base + normalized(conv3d(x, w[f"{name}.shortcut.0.weight"]), w, f"{name}.shortcut.1"), 0)


BLOCKS3D = {"plain": (layer3d, 4), "inception": (inception3d, 4), "residual": (residual3d, 2)}


def graph_cnn3d(batch, w, s):
    """(Res_g -> MaxP_g) x L -> Graph2Grid -> 3D CNN -> GlobAvgP -> FC of section 5.3.1."""
    for depth, cluster in enumerate(s["clusters"]):
        batch = block(batch, w, f"spatial.{3 * depth}", size=s["kernel_size"], residual=True)
        batch = pooled(batch, cluster, s["sensor_size"], s["pooling"])
    grids = on_grid(batch, s["clusters"][-1], s["sensor_size"])
    scores = []
    layer, count = BLOCKS3D[s["temporal"]]
    for x in grids.reshape(-1, batch.volumes, *grids.shape[1:]):
        for n in range(count):
            x = pool3d(layer(x, w, f"temporal.{2 * n}"), (2 if n else 1, 2, 2))
        scores.append(full(x.mean((0, 1, 2)), w, "classify"))
    return np.stack(scores)
