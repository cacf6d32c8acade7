"""Training protocol for objects (thesis, section 4.4): input, settings, optimization."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

from torch import nn

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.common.validation import positive, probability, whole
from nvsdata.data.pseudo import Pseudo, axes
from nvsdata.training.data import TrainTestSplit
from nvsdata.training.negatives import Negatives
from nvsdata.training.optimizers import adam, one_cycle, sgd
from nvsdata.training.processes import Team
from nvsdata.training.trainer import Trainer
from nvsdata.transforms.events.crops import downsampled_size
from nvsdata.transforms.events.sampling import BETA
from nvsdata.transforms.graphs.edges import PSEUDO

EPOCHS, BATCH = 150, 64
LEAST_STEPS = 4_000  # minimum number of steps for convergence: small datasets get more epochs
ITERATIONS = 10_000  # steps after which the rate of image networks is decayed
IMAGE_NETWORKS: dict[str, type[nn.Module]] = {
    "vgg19": models.reference.VGG,
    "inception-v4": models.reference.InceptionV4,
    "resnet50": models.reference.ResNet,
}
NETWORKS = ("rgcnn", "gcnn", *IMAGE_NETWORKS)
DIGITS = ("n-mnist", "mnist-dvs")
BACKGROUND = "background"  # class of samples that show none of the objects
CROPS = ("n-cars",)  # datasets of crops of different sizes, all in one corner of the sensor
SMALL = "n-mnist"  # dataset with so few events that each event is a node
# default settings for SMALL, and for all other datasets
USUAL: dict[str, tuple[Any, Any]] = {"k": (1, 8), "depth": (5, None), "dropout": (0.2, 0.5)}
# settings for 34x34 pixels, and for larger sensors: streams of a causal graph are pooled after the last block only
CAUSAL: tuple[dict[str, Any], ...] = ({"channels": (32, 64, 128)}, {"channels": (64, 128, 128)})
# settings for a node per pixel, by the sensor's largest side
PIXELS: dict[int, dict[str, Any]] = {
    side: {
        "channels": (32, 64, 64, 128, 128),
        "clusters": tuple((cell * side // 64,) * 2 for cell in (2, 2, 4, 4, 8)),
        "hidden": 128,
        "sensor_size": (side, side),
    }
    for side in (64, 128)
}
TIMES: Final = ("first", "last", "mean")
NODES = ("events", "pixels")
SCHEDULES = ("one-cycle", "steps")
FEATURES: dict[str, Any] = {
    "age": T.Age(),
    **{f"patch{size}": T.Patch(size) for size in (3, 5, 7)},
    **{f"mean{size}": T.PatchMean(size) for size in (3, 5, 7)},
    **{f"bins{bins}": T.TimeBins(bins) for bins in (2, 4, 8)},
}


@dataclass(frozen=True)
class Objects:
    """Training protocol of the thesis, section 4.4, for a dataset and one of `NETWORKS`.

    The defaults are those of docs/dev/measurements/departures.md, which lists the differences from the thesis and their
    effects.

    Args:
        dataset: Name of the dataset. Digits (n-mnist, mnist-dvs) aren't mirrored.
        network: One of `NETWORKS` (default "rgcnn").
        convolution: Convolution of gcnn (Table 4.8) or rgcnn: "spline" (default) or one of `models.CONVOLUTIONS`.
        nodes: "events" (default) for a node per event, or "pixels" for a node per pixel, with log(1 + number) of its
            ON and of its OFF events, and their first, last and mean times, in place of polarity.
        downsample: Number of pixels along each axis that become one, after augmentation (default 1).
        window: Duration of a sample in µs, at a random position of the recording (default 30,000; Table 4.3).
        k: Maximum number of events per box of the non-uniform sampling, 1 for no sampling (Table 4.1). None (default):
            1 for n-mnist and for pixels, otherwise 8.
        radius: Radius of a neighborhood (default 3.0; Table 4.2). See `RadiusGraph` for this and the next arguments.
        alpha: Weight of squared pixels (default 1.0).
        beta: Weight of squared µs (default (0.5e-5)²).
        max_degree: Maximum number of neighbors of a node (default 8).
        pseudo: Kind of pseudo-coordinates (default "signed").
        features: Names of node features of `FEATURES`, in addition to polarity (default ("patch5",)).
        causal: True for edges from earlier events only and a network that pools only at its end, so that it can stream
            in real time (`models.stream`). k is 1 then, and features must be empty, because they depend on later
            events (default False).
        depth: Number of convolutions, for 240x180 (Table 4.4) or 34x34. None (default): 5 for n-mnist and for
            pixels, otherwise that of `models.rgcnn` for the dataset.
        kernel_size: Number of cells of a kernel along an axis (default 5; Table 4.5).
        width: Factor by which the numbers of channels are multiplied (default 1.0).
        dropout: Probability of dropout before the last layer. None (default): 0.2 for n-mnist, otherwise 0.5 as in the
            thesis.
        loops: True (default) for self-loops; see `RGCNN`.
        root_weight: True (default) for root weights; see `RGCNN`.
        shortcut_start: Initial scale of shortcuts (default 0.0); see `RGCNN`.
        augment: True (default) for augmentation of training samples.
        negatives: Probability that a training sample of another class than "background" becomes one of the background,
            see `Negatives` (default 0.0).
        schedule: "one-cycle" (default): Adam's rate rises to 3e-3 (image networks: 1e-3) and falls again. "steps" as in
            the thesis: Adam's rate of 1e-3 is divided by 10 after 60/150 and 110/150 of the epochs; image networks are
            trained by SGD, whose rate of 1e-3 is divided by 10 after every 10,000 steps.
        smoothing: Label smoothing (default 0.05); see `Trainer`.
        image_size: Side of event images in pixels, for `IMAGE_NETWORKS` (default 224; Table 4.6).

    Raises:
        ValueError: For an unknown network, feature or schedule, and for a causal network with features, a depth, or k >
            1.

    Example:
        >>> from nvsdata.training.objects import Objects
        >>> Objects("n-mnist").setting("depth"), Objects("n-cars").setting("k")
        (5, 8)
    """

    dataset: str
    network: str = "rgcnn"
    convolution: str = "spline"
    nodes: Literal["events", "pixels"] = "events"
    downsample: int = 1
    window: int = 30_000
    k: int | None = None
    radius: float = 3.0
    alpha: float = 1.0
    beta: float = BETA
    max_degree: int = 8
    pseudo: Pseudo = PSEUDO
    features: tuple[str, ...] = ("patch5",)
    causal: bool = False
    depth: int | None = None
    kernel_size: int = 5
    width: float = 1.0
    dropout: float | None = None
    loops: bool = True
    root_weight: bool = True
    shortcut_start: float = 0.0
    augment: bool = True
    negatives: float = 0.0
    schedule: Literal["one-cycle", "steps"] = "one-cycle"
    smoothing: float = 0.05
    image_size: int = 224

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise ValueError(f"network must be one of {NETWORKS}, not {self.network!r}")
        for name, least in (("k", 1), ("window", 1), ("downsample", 1), ("kernel_size", 1), ("image_size", 1)):
            if getattr(self, name) is not None:
                whole(name, getattr(self, name), least)
        positive("width", self.width)
        probability("smoothing", self.smoothing)
        probability("negatives", self.negatives)
        if self.dropout is not None:
            probability("dropout", self.dropout)
        self._graph()
        if self.convolution not in ("spline", *models.CONVOLUTIONS):
            raise ValueError(f"convolution must be one of {('spline', *models.CONVOLUTIONS)}, not {self.convolution!r}")
        if self.schedule not in SCHEDULES:
            raise ValueError(f"schedule must be one of {SCHEDULES}, not {self.schedule!r}")
        if self.nodes not in NODES:
            raise ValueError(f"nodes must be one of {NODES}, not {self.nodes!r}")
        if unknown := set(self.features) - FEATURES.keys():
            raise ValueError(f"features must be of {tuple(FEATURES)}, not {', '.join(sorted(unknown))}")
        given = {
            "features": self.features,
            "depth": self.depth,
            "k": (self.k or 1) > 1,
            "network": self.network in IMAGE_NETWORKS,
            "nodes": self.nodes != "events",
        }
        if self.causal and (wrong := [name for name, value in given.items() if value]):
            given_value = f"{wrong[0]} is {getattr(self, wrong[0])!r}"
            raise ValueError(
                f"a causal network is an rgcnn or gcnn of events, with features=() and no depth or k: {given_value}"
            )

    def setting(self, name: str) -> Any:
        """Return a setting, with the dataset's default in place of None."""
        given = getattr(self, name)
        if self.causal and name in ("k", "depth"):
            return 1 if name == "k" else None
        if given is None and name == "k" and self.nodes == "pixels":
            return 1
        return given if given is not None or name not in USUAL else USUAL[name][self.dataset != SMALL]

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, with the dataset's defaults in place of None."""
        return {name: self.setting(name) for name in vars(self)}

    def pipeline(self, *, training: bool, within: tuple[float, float] = (0.0, 1.0)) -> T.Compose:
        """Return the transform from a recording to the network's input, with augmentation for training.

        `within` is the part of the recording, as fractions of its duration, from which windows are sampled.
        """
        window: Any = T.RandomWindow(self.window, within)
        if self.network in IMAGE_NETWORKS:
            scaled, size = T.Resize(round(self.image_size * 256 / 224)), self.image_size
            crops: list[Any] = [T.RandomCrop(size), T.RandomFlip()] if training else [T.CenterCrop(size)]
            return T.Compose([window, T.EventImage(), scaled, *crops, T.Normalize()])
        sample: list[Any] = [T.NonUniformSample(k, self.alpha, self.beta)] if (k := self.setting("k")) > 1 else []
        graph: Any = self._graph()
        if self.nodes == "pixels":
            graph = T.Compose([T.MergePixels(TIMES, log=True), graph])
        changes = training and self.augment
        smaller: list[Any] = [T.Downsample(self.downsample)] if self.downsample > 1 else []
        if not self.features and self.dataset not in DIGITS and self.nodes == "events":
            # graphs are augmented, as in the thesis; features of the events around a node would no longer fit
            moved: list[Any] = [T.RandomScale(), T.RandomFlip(0), T.RandomFlip(1), T.RandomRotate()] if changes else []
            return T.Compose([window, *smaller, *sample, graph, *moved])
        if self.features:
            graph = T.NodeFeatures(T.Compose([*sample, graph]), [FEATURES[name] for name in self.features])
            sample = []
        center = [T.Center()] if self.dataset in CROPS else []
        return T.Compose([window, *center, *(self._changes() if changes else []), *smaller, *sample, graph])

    def training_set(self, data: TrainTestSplit) -> Any:
        """Return the training dataset with augmentation. ValueError if `negatives` need a class that doesn't exist."""
        pipeline = self.pipeline(training=True)
        if not self.negatives:
            return data.train(pipeline)
        if BACKGROUND not in data.classes:
            raise ValueError(f"negatives need a class {BACKGROUND!r}, but {data.data['dataset']} has none")
        dataset = data.train(None)
        dataset.transforms = Negatives(pipeline, data.classes.index(BACKGROUND), self.negatives)
        return dataset

    def _graph(self) -> T.RadiusGraph:
        metric = self.radius, self.alpha, self.beta
        return T.RadiusGraph(*metric, self.max_degree, self.pseudo, causal=self.causal)

    def _changes(self) -> list[Any]:
        """Return the augmentation of events in training."""
        if self.dataset in DIGITS:
            # a digit's mirror image is not a digit
            return [T.RandomAffine((0.85, 1.1), degrees=15, shift=2, shear=0.1, stretch=0.1), T.DropEvents(0.4)]
        if self.dataset in CROPS:
            # EventDrop (Gu et al. 2021): single events, an interval or a rectangle
            drop = T.RandomChoice([T.DropEvents(0.6), T.DropByTime(0.25), T.DropByArea(0.2)])
            return [T.RandomTranslate(6), T.RandomFlip(0), T.RandomApply(drop, 0.75)]
        return [T.RandomAffine(), T.RandomFlip(0), T.RandomFlip(1), T.DropEvents(0.4)]

    def build(self, sensor_size: tuple[int, int], classes: int) -> nn.Module:
        """Return the network, configured for the dataset or, if there is no such configuration, for the sensor size.

        For the sensor size, the configuration of the smallest sensor that is at least as large is used.

        ValueError for an unknown depth, and for a sensor larger than those of all configurations.
        """
        if self.network in IMAGE_NETWORKS:
            return IMAGE_NETWORKS[self.network](classes)
        sensor_size = downsampled_size(sensor_size, self.downsample)
        side = max(sensor_size)
        nearest = "n-mnist" if side <= 34 else "cifar10-dvs" if side <= 128 else "asl-dvs"
        name = self.dataset if self.dataset in models.CONFIGURATIONS else nearest
        own = 2 + len(TIMES) if self.nodes == "pixels" else 1
        settings = dict(models.CONFIGURATIONS[name]) | {
            "num_classes": classes,
            "kernel_size": self.kernel_size,
            "in_channels": own + sum(FEATURES[name].channels for name in self.features),
            "dim": axes(self.pseudo),
            "loops": self.loops,
            "root_weight": self.root_weight,
            "dropout": self.setting("dropout"),
        }
        if self.causal:
            settings |= CAUSAL[side > 34] | {"clusters": (None, None, settings["clusters"][-1])}
        elif (depth := self.setting("depth")) is not None:
            settings |= self._of_depth(depth, side)
        elif self.nodes == "pixels" and 34 < side <= max(PIXELS):
            settings |= next(network for largest, network in PIXELS.items() if side <= largest)
        if any(ours > theirs for ours, theirs in zip(sensor_size, settings["sensor_size"], strict=True)):
            raise ValueError(
                "the network is for {}x{} pixels, not {}x{}".format(*settings["sensor_size"], *sensor_size)
            )
        settings["channels"] = tuple(round(channels * self.width) for channels in settings["channels"])
        if self.network == "rgcnn":
            return models.RGCNN(**settings, convolution=self.convolution, shortcut_start=self.shortcut_start)
        return models.GCNN(**settings, convolution=self.convolution)

    def _of_depth(self, depth: int, side: int) -> dict[str, Any]:
        sizes, common = models.DEPTHS, {"sensor_size": (240, 180), "hidden": 1024}
        if side <= 34:
            sizes, common = models.SMALL_DEPTHS, {}
        if depth not in sizes:
            raise ValueError(f"depth must be one of {tuple(sizes)} for a sensor of {side} pixels, not {depth}")
        return common | sizes[depth]

    def optimization(self, model: nn.Module, epochs: int, steps: int) -> tuple[Any, Any]:
        """Return optimizer and schedule for `epochs` of `steps` steps each."""
        image = self.network in IMAGE_NETWORKS
        if self.schedule == "one-cycle":
            return one_cycle(model, epochs, 1e-3 if image else 3e-3)
        if image:
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
        """Build a network and its trainer.

        Args:
            out: Folder of the training; see `Trainer`.
            recordings: Number of training recordings.
            sensor_size: (width, height) in pixels.
            classes: Number of classes.
            data: Description of the training data; see `Trainer`.
            team: The processes that train together.
            epochs: Number of epochs (default: 150 as in the thesis, or more if needed for 4,000 steps).
            batch: Samples per step, over all processes (default 64).
            seed: Seed; see `Trainer` (default 0).
            resume: True to continue from a checkpoint; see `Trainer` (default False).

        Returns:
            The `Trainer`.
        """
        steps = -(-recordings // batch)
        epochs = epochs or max(EPOCHS, -(-LEAST_STEPS // steps))
        model = self.build(sensor_size, classes).to(team.device)
        optimizer, schedule = self.optimization(model, epochs, steps)
        smoothing = 0.0 if self.network in IMAGE_NETWORKS else self.smoothing
        options: dict[str, Any] = {"batch": batch, "team": team, "seed": seed, "smoothing": smoothing, "resume": resume}
        return Trainer(
            model,
            optimizer,
            schedule,
            out,
            data=data | {"protocol": repr(replace(self, **self.settings))},
            epochs=epochs,
            **options,
        )
