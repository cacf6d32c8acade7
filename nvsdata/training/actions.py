"""Training protocol for actions and scenes (thesis, section 5.3.1): input, settings, optimization."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.common.validation import whole
from nvsdata.training.optimizers import adam, sgd
from nvsdata.training.processes import Team
from nvsdata.training.trainer import Trainer
from nvsdata.transforms.events.windows import T_VOL

# network, pixels of the smaller side of its frames, pixels of the square that is cut out of them
FRAME_NETWORKS: dict[str, tuple[type[nn.Module], int, int]] = {
    "c3d": (models.reference.C3D, 128, 112),
    "i3d": (models.reference.I3D, 256, 224),
    "resnet3d": (models.reference.ResNet3D, 128, 112),
    "p3d": (models.reference.P3D, 178, 160),
    "r2plus1d": (models.reference.R2Plus1D, 128, 112),
    "resnext3d": (models.reference.ResNeXt3D, 128, 112),
}
POINT_NETWORKS: dict[str, type[nn.Module]] = {
    "pointnet": models.reference.PointNet,
    "pointnet++": models.reference.PointNet2,
    "lstm": models.reference.LSTM,
}
EPOCHS = 150
SMALL = (64, 64)  # sensors up to this size have a grid of a quarter of the cells
NETWORKS = ("rgcnn3d", *FRAME_NETWORKS, *POINT_NETWORKS)


@dataclass(frozen=True)
class Actions:
    """Training protocol of the thesis, section 5.3.1, for one of `NETWORKS`.

    Args:
        network: One of `NETWORKS` (default "rgcnn3d").
        temporal: 3D CNN of rgcnn3d, one of `models.TEMPORAL` (default "residual").
        graphs: S, the number of graphs or frames per sample, 8 (default) or 16.
        duration: Duration in µs of the part of each recording that is used, at a random position (default None: all).
        events: Events per sample of PointNet, PointNet++ and LSTM (default 1024).
        flip: True (default) for left-right flips as augmentation.
        width: Factor of the channels of rgcnn3d (default 1.0).
        image_size: Side in pixels of the square frames of 3D CNNs (default None: that of the thesis, 112 to 224).
        adam: True to train 3D CNNs on frames by Adam, like the other networks, in place of gradient descent (default
            False).

    Raises:
        ValueError: For an unknown network, or an image size below 1.

    Example:
        >>> from nvsdata.training.actions import Actions
        >>> Actions(graphs=16).batch
        16
    """

    network: str = "rgcnn3d"
    temporal: str = "residual"
    graphs: int = 8
    duration: int | None = None
    events: int = 1024
    flip: bool = True
    width: float = 1.0
    image_size: int | None = None
    adam: bool = False

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise ValueError(f"network must be one of {NETWORKS}, not {self.network!r}")
        if self.image_size is not None:
            whole("image_size", self.image_size, 1)

    def pipeline(self, *, training: bool) -> T.Compose:
        """Return the transform from a recording to the network's input, with augmentation for training.

        The recording is divided into S equal parts, and a window of 1/30 s is cut from each. For RG-CNN, each window
        becomes a graph in which each node has an edge from its nearest neighbor. In training, graphs are scaled by a
        factor from [0.8, 1). For 3D CNNs, each window becomes a frame of ON and OFF counts, scaled and cropped. For
        PointNet, PointNet++ and LSTM, events are sampled from the entire recording.
        """
        cut = [T.RandomWindow(self.duration)] if self.duration else []
        if self.network in POINT_NETWORKS:
            return T.Compose([*cut, T.Points(self.events)])
        flip = training and self.flip
        volumes = T.RandomWindows(self.graphs, T_VOL)
        if self.network in FRAME_NETWORKS:
            _, side, full = FRAME_NETWORKS[self.network]
            square = self.image_size or full
            side = round(side * square / full)
            crop = T.RandomCrop(square) if training else T.CenterCrop(square)
            mirror = [T.RandomFlip()] if flip else []
            return T.Compose([*cut, volumes, T.EventImage(), T.Normalize(), T.Resize(side), crop, *mirror])
        graphs = T.Each(T.Compose([T.NonUniformSample(8), T.KNNGraph()]))
        augment = [T.RandomScale(0.8, 1.0)] if training else []
        return T.Compose([*cut, volumes, graphs, *augment, *([T.RandomFlip(0)] if flip else [])])

    def build(self, sensor_size: tuple[int, int], classes: int) -> nn.Module:
        """Return the network.

        RG-CNN has the layers for 128x128 pixels if the sensor fits, otherwise those for 240x180. Up to 64x64 pixels,
        its grid is smaller, too.
        """
        if self.network in FRAME_NETWORKS:
            return FRAME_NETWORKS[self.network][0](classes)
        if self.network in POINT_NETWORKS:
            return POINT_NETWORKS[self.network](classes)
        name = "dvs128-gesture" if max(sensor_size) <= 128 else "ucf101-dvs"
        own: dict[str, Any] = {"num_classes": classes, "temporal": self.temporal, "width": self.width}
        if max(sensor_size) <= max(SMALL):
            own["sensor_size"] = SMALL
        return models.RGCNN3D(**models.CONFIGURATIONS_3D[name] | own)

    @property
    def batch(self) -> int:
        """Samples per step, over all processes."""
        return 32 if self.graphs == 8 else 16

    def trainer(
        self,
        out: Path,
        *,
        sensor_size: tuple[int, int],
        classes: int,
        data: dict[str, Any],
        team: Team,
        epochs: int = EPOCHS,
        batch: int | None = None,
        seed: int = 0,
        resume: bool = False,
    ) -> Trainer:
        """Build a network and its trainer.

        Args:
            out: Folder of the training; see `Trainer`.
            sensor_size: (width, height) in pixels.
            classes: Number of classes.
            data: Description of the training data; see `Trainer`.
            team: The processes that train together.
            epochs: Number of epochs (default 150).
            batch: Samples per step, over all processes (default: 32 for 8 graphs, 16 for 16).
            seed: Seed; see `Trainer` (default 0).
            resume: True to continue from a checkpoint; see `Trainer` (default False).

        Returns:
            The `Trainer`.
        """
        model = self.build(sensor_size, classes).to(team.device)
        optimizer, schedule = self.optimization(model, epochs)
        options: dict[str, Any] = {"batch": batch or self.batch, "team": team, "seed": seed, "resume": resume}
        return Trainer(model, optimizer, schedule, out, data=data | {"protocol": repr(self)}, epochs=epochs, **options)

    def optimization(self, model: nn.Module, epochs: int) -> tuple[Any, Any]:
        """Return optimizer and schedule: Adam, or for 3D CNNs SGD with a rate of 0.01, divided by 10 every 50 epochs.

        The thesis doesn't describe the training of point networks; they are trained by Adam, too.
        """
        by_descent = self.network in FRAME_NETWORKS and not self.adam
        return sgd(model, 0.01, 50, epochs) if by_descent else adam(model, epochs, (60, 100))
