"""Networks.

`rgcnn(name)` and `gcnn(name)` build the thesis's networks for single graphs (thesis, section 4.4.2), configured for the
dataset `name`. `rgcnn3d(name, temporal)` builds those for sequences of graphs (thesis, section 5.3.1). `reference`
contains the baselines, and `NETWORKS` all networks by name. `save` and `load` write and read trained networks, `fused`
speeds up inference, and `complexity` counts operations and weights.
"""

from __future__ import annotations

from typing import Any, Literal

from nvsdata.common.text import plain_name
from nvsdata.models import reference
from nvsdata.models.checkpoint import load, save
from nvsdata.models.conv import CONVOLUTIONS
from nvsdata.models.decisions import OnlineClassifier
from nvsdata.models.event_tensors import EST
from nvsdata.models.fusing import fused
from nvsdata.models.graph_cnn import GCNN, RGCNN, Pooling
from nvsdata.models.graph_cnn3d import RGCNN3D
from nvsdata.models.grid import Graph2GridLayer
from nvsdata.models.incremental.streaming import stream
from nvsdata.models.matrix_lstm import MatrixLSTM
from nvsdata.models.norm import BatchNorm
from nvsdata.models.operations import Complexity, complexity
from nvsdata.models.pool import GraphPool
from nvsdata.models.prediction import Trained
from nvsdata.models.registry import NETWORKS, register_network
from nvsdata.models.spline import SplineConv
from nvsdata.models.temporal import TEMPORAL

__all__ = [
    "CONFIGURATIONS",
    "CONFIGURATIONS_3D",
    "CONVOLUTIONS",
    "DEPTHS",
    "EST",
    "GCNN",
    "NETWORKS",
    "RGCNN",
    "RGCNN3D",
    "SMALL_DEPTHS",
    "TEMPORAL",
    "BatchNorm",
    "Complexity",
    "Graph2GridLayer",
    "GraphPool",
    "MatrixLSTM",
    "OnlineClassifier",
    "SplineConv",
    "Trained",
    "complexity",
    "fused",
    "gcnn",
    "load",
    "reference",
    "register_network",
    "rgcnn",
    "rgcnn3d",
    "save",
    "stream",
]

# networks for 34x34 pixels by number of convolutions: 3 as in the thesis; 4 and 5 have two convolutions at a resolution
SMALL_DEPTHS: dict[int, dict[str, Any]] = {
    3: {"channels": (32, 64, 128), "clusters": ((2, 2), (4, 4), (7, 7))},
    4: {"channels": (32, 64, 64, 128), "clusters": ((2, 2), (2, 2), (4, 4), (7, 7))},
    5: {"channels": (32, 64, 64, 128, 128), "clusters": ((2, 2), (2, 2), (4, 4), (4, 4), (7, 7))},
}
_SMALL: dict[str, Any] = {**SMALL_DEPTHS[3], "hidden": 128}
_WIDE: dict[str, Any] = {"channels": (64, 128, 256, 512), "hidden": 1024}
_DVS128: dict[str, Any] = {**_WIDE, "sensor_size": (128, 128), "clusters": ((4, 4), (6, 6), (20, 20), (32, 32))}
_DAVIS240: dict[str, Any] = {**_WIDE, "sensor_size": (240, 180), "clusters": ((4, 3), (16, 12), (30, 23), (60, 45))}

CONFIGURATIONS: dict[str, dict[str, Any]] = {
    "n-mnist": {**_SMALL, "sensor_size": (34, 34), "num_classes": 10},
    "mnist-dvs": {**_SMALL, "sensor_size": (128, 128), "num_classes": 10},
    "cifar10-dvs": {**_DVS128, "num_classes": 10},
    "n-cars": {**_DVS128, "num_classes": 2},
    "n-caltech101": {**_DAVIS240, "num_classes": 101},
    "asl-dvs": {**_DAVIS240, "num_classes": 24},
}


# networks for 240x180 pixels with FC(1024) by number of convolutions (thesis, Table 4.4)
DEPTHS: dict[int, dict[str, Any]] = {
    2: {"channels": (128, 256), "clusters": ((16, 12), (60, 45))},
    3: {"channels": (64, 128, 256), "clusters": ((8, 6), (16, 12), (60, 45))},
    4: {"channels": (64, 128, 256, 512), "clusters": ((4, 3), (16, 12), (30, 23), (60, 45))},
    5: {"channels": (64, 128, 256, 512, 512), "clusters": ((4, 3), (8, 6), (16, 12), (30, 23), (60, 45))},
    6: {"channels": (64, 128, 256, 512, 512, 512), "clusters": ((2, 2), (4, 3), (8, 6), (16, 12), (30, 23), (60, 45))},
}

# networks for sequences of graphs (thesis, section 5.3.1)
_ACTIONS240: dict[str, Any] = {
    "sensor_size": (240, 180),
    "channels": (32, 64, 128),
    "clusters": ((2, 2), (4, 3), (8, 6)),
}
_ACTIONS128: dict[str, Any] = {"sensor_size": (128, 128), "channels": (64, 128), "clusters": ((2, 2), (4, 4))}

CONFIGURATIONS_3D: dict[str, dict[str, Any]] = {
    "dvs128-gesture": {**_ACTIONS128, "num_classes": 11},
    "ucf101-dvs": {**_ACTIONS240, "num_classes": 101},
    "hmdb51-dvs": {**_ACTIONS240, "num_classes": 51},
}


def rgcnn3d(
    name: str,
    temporal: Literal["plain", "inception", "residual"] = "residual",
    num_classes: int | None = None,
    *,
    pooling: Pooling = "max",
) -> RGCNN3D:
    """Build the thesis's network for sequences of graphs, configured for a dataset (thesis, section 5.3.1).

    Args:
        name: "dvs128-gesture", "ucf101-dvs" or "hmdb51-dvs".
        temporal: 3D CNN after the graph layers: "plain", "inception" or "residual" (default).
        num_classes: Number of scores (default None: the dataset's number of classes).
        pooling: "max" (default) or "average" of the features of a cluster.

    Returns:
        An `RGCNN3D` with random weights, in training mode.

    Raises:
        ValueError: For an unknown `name`, `temporal` or `pooling`.

    Example:
        >>> from nvsdata import models
        >>> models.rgcnn3d("dvs128-gesture", "plain").classify.out_features
        11
    """
    return RGCNN3D(temporal=temporal, **_configuration(CONFIGURATIONS_3D, name, num_classes), pooling=pooling)


def rgcnn(name: str, num_classes: int | None = None, *, pooling: Pooling = "max") -> RGCNN:
    """Build the thesis's residual graph CNN, configured for a dataset (thesis, section 4.4.2).

    Args:
        name: "n-mnist", "mnist-dvs", "cifar10-dvs", "n-cars", "n-caltech101" or "asl-dvs".
        num_classes: Number of scores (default None: the dataset's number of classes). Another number is for other data
            of the same sensor.
        pooling: "max" (default) or "average" of the features of a cluster.

    Returns:
        An `RGCNN` with random weights, in training mode.

    Raises:
        ValueError: For an unknown `name` or `pooling`.

    Example:
        >>> from nvsdata import models
        >>> models.rgcnn("n-mnist", num_classes=5).classify.out_features
        5
    """
    return RGCNN(**_configuration(CONFIGURATIONS, name, num_classes), pooling=pooling)


def gcnn(name: str, num_classes: int | None = None, *, convolution: str = "spline", pooling: Pooling = "max") -> GCNN:
    """Build the thesis's plain graph CNN, configured for a dataset (thesis, section 4.4.2).

    Args:
        name: "n-mnist", "mnist-dvs", "cifar10-dvs", "n-cars", "n-caltech101" or "asl-dvs".
        num_classes: Number of scores (default None: the dataset's number of classes). Another number is for other data
            of the same sensor.
        convolution: "spline" (default), "gcn", "cheb", "monet" or "gin"; see `GCNN`.
        pooling: "max" (default) or "average" of the features of a cluster.

    Returns:
        A `GCNN` with random weights, in training mode.

    Raises:
        ValueError: For an unknown `name`, `convolution` or `pooling`.

    Example:
        >>> from nvsdata import models
        >>> models.gcnn("n-mnist", convolution="gin").sensor_size
        (34, 34)
    """
    return GCNN(**_configuration(CONFIGURATIONS, name, num_classes), convolution=convolution, pooling=pooling)


def _configuration(known: dict[str, dict[str, Any]], name: str, num_classes: int | None) -> dict[str, Any]:
    # "NMNIST" and "n_mnist" are "n-mnist"
    found = next((one for one in known if plain_name(one) == plain_name(str(name))), None)
    if found is None:
        kind = "RGCNN3D" if known is CONFIGURATIONS_3D else "RGCNN"
        other = f"for other data, build models.{kind}(num_classes, sensor_size=(width, height), ...)"
        raise ValueError(f"no configuration {name!r}; there are {', '.join(known)}; {other}")
    chosen = dict(known[found])
    if num_classes is not None:
        chosen["num_classes"] = num_classes
    return chosen
