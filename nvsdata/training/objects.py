"""How networks learn objects (thesis section 4.4): their input, their settings, their optimization."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.training.optimizers import adam, sgd
from nvsdata.training.processes import Team
from nvsdata.training.trainer import Trainer

EPOCHS, BATCH = 150, 64
LEAST_STEPS = 9_000  # fewer are too few to converge: a small dataset is passed more often
ITERATIONS = 10_000  # steps after which the rate of image networks is decayed
IMAGE_NETWORKS: dict[str, type[nn.Module]] = {
    "vgg19": models.reference.VGG,
    "inception-v4": models.reference.InceptionV4,
    "resnet50": models.reference.ResNet,
}
NETWORKS = ("rgcnn", "gcnn", *IMAGE_NETWORKS)
DIGITS = "n-mnist"


@dataclass(frozen=True)
class Objects:
    """The protocol of section 4.4 for a dataset and one of `NETWORKS`.

    - `dataset`: its name; digits (n-mnist) are neither mirrored nor sampled
    - `network`: one of `NETWORKS`
    - `convolution`: of gcnn (Table 4.8), "spline" or one of `models.CONVOLUTIONS`
    - `window`: µs of a recording per sample, at a random place (Table 4.3)
    - `k`: most events per box of the non-uniform sampling, 1 for no sampling (Table 4.1); None: 1 for n-mnist, else 8
    - `radius`: of the graph, in pixels (Table 4.2)
    - `depth`: number of convolutions, for 240x180 (Table 4.4); None for the dataset's own network
    - `kernel_size`: cells of a kernel along an axis (Table 4.5)
    - `image_size`: pixels of event images along a side, for `IMAGE_NETWORKS` (Table 4.6)

    ValueError for an unknown network.
    """

    dataset: str
    network: str = "rgcnn"
    convolution: str = "spline"
    window: int = 30_000
    k: int | None = None
    radius: float = 3.0
    depth: int | None = None
    kernel_size: int = 5
    image_size: int = 224

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise ValueError(f"network must be one of {NETWORKS}, not {self.network!r}")

    def pipeline(self, *, training: bool, within: tuple[float, float] = (0.0, 1.0)) -> T.Compose:
        """From a recording to what the network takes, augmented for training.

        `within` is the part of the recording, as shares of its duration, that windows are drawn from.
        """
        window = T.RandomWindow(self.window, within)
        if self.network in IMAGE_NETWORKS:
            scaled, size = T.Resize(round(self.image_size * 256 / 224)), self.image_size
            crops: list[Any] = [T.RandomCrop(size), T.RandomHorizontalFlip()] if training else [T.CenterCrop(size)]
            return T.Compose([window, T.EventImage(), scaled, *crops, T.Normalize()])
        # a digit is small: it needs every event
        k = self.k or (1 if self.dataset == DIGITS else 8)
        sample: list[Any] = [T.NonUniformSample(k)] if k > 1 else []
        graph = T.RadiusGraph(self.radius)
        if self.dataset == DIGITS:
            # a digit's mirror image is not a digit
            augment: list[Any] = [T.RandomAffine(scale=(0.85, 1.1), degrees=15, shift=2)] if training else []
            return T.Compose([window, *augment, *sample, graph])
        augment_graph: list[Any] = (
            [T.RandomScale(), T.RandomFlip(0), T.RandomFlip(1), T.RandomRotate()] if training else []
        )
        return T.Compose([window, *sample, graph, *augment_graph])

    def build(self, sensor_size: tuple[int, int], classes: int) -> nn.Module:
        """The network; of the thesis's, that for the dataset, or for the smallest sensor that holds this one."""
        if self.network in IMAGE_NETWORKS:
            return IMAGE_NETWORKS[self.network](classes)
        side = max(sensor_size)
        nearest = "n-mnist" if side <= 34 else "cifar10-dvs" if side <= 128 else "asl-dvs"
        name = self.dataset if self.dataset in models.CONFIGURATIONS else nearest
        settings = dict(models.CONFIGURATIONS[name]) | {"num_classes": classes, "kernel_size": self.kernel_size}
        if self.depth:
            settings |= {"sensor_size": (240, 180), "hidden": 1024} | models.DEPTHS[self.depth]
        if self.network == "rgcnn":
            return models.RGCNN(**settings)
        return models.GCNN(**settings, convolution=self.convolution)

    def optimization(self, model: nn.Module, epochs: int, steps: int) -> tuple[Any, Any]:
        """Optimizer and schedule for `epochs` of `steps` steps each: Adam, or for images gradient descent."""
        if self.network in IMAGE_NETWORKS:
            return sgd(model, 1e-3, max(1, ITERATIONS // steps), epochs, decay=1e-5)
        return adam(model, epochs, (60, 110))

    def trainer(
        self,
        out: Path,
        *,
        recordings: int,
        sensor_size: tuple[int, int],
        classes: int,
        data: dict[str, Any],
        team: Team,
        epochs: int | None = None,
        batch: int = BATCH,
        seed: int = 0,
        resume: bool = False,
    ) -> Trainer:
        """A network, and the trainer of it.

        - `out`, `data`, `team`, `seed`, `resume`: see `Trainer`
        - `recordings`: how many there are to train on
        - `sensor_size`: (width, height) in pixels
        - `classes`: how many there are
        - `epochs`: by default the thesis's 150, or as many as make `LEAST_STEPS` steps
        - `batch`: samples per step, over all processes (default 64)
        """
        steps = -(-recordings // batch)
        epochs = epochs or max(EPOCHS, -(-LEAST_STEPS // steps))
        model = self.build(sensor_size, classes).to(team.device)
        optimizer, schedule = self.optimization(model, epochs, steps)
        return Trainer(
            model, optimizer, schedule, out, data=data, epochs=epochs, batch=batch, team=team, seed=seed, resume=resume
        )
