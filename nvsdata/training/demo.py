"""Demo: moving shapes, converted to events by PIX2NVS and classified by a graph CNN."""

from __future__ import annotations

import math
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nvsdata import formats, models, plots, training
from nvsdata import transforms as T
from nvsdata.common.errors import shown
from nvsdata.common.progress import bar
from nvsdata.datasets import EventFolder
from nvsdata.emulation import PIX2NVS
from nvsdata.training.evaluation import validation

SIZE = 34  # pixels, as in N-MNIST
FPS = 2_000
FRAMES = 161  # 80 ms
CAMERA = PIX2NVS(threshold=0.6, new=False, exp=False)  # threshold: change of log brightness since the last event
MARK = ".nvsdata-demo"  # file next to the recordings; it contains their seed when all are written
COUNTS = {"train": 40, "test": 15}  # recordings per class
WINDOW = 30_000  # µs
BATCH = 32
VOTES = 5  # windows per recording


def train(out: Path, epochs: int, seed: int) -> None:
    """Make the data, train, print the accuracy and write two figures."""
    with training.team("cpu") as here, here.claiming(out):
        _train(out, epochs, seed, here)


def _train(out: Path, epochs: int, seed: int, here: training.Team) -> None:
    torch.manual_seed(seed)
    data = out / "shapes"
    kept = [name for name in ("log.jsonl", "checkpoint.pt", "model.safetensors") if (out / name).exists()]
    if kept and not (data / MARK).exists():
        found = ", ".join(kept)
        raise FileExistsError(f"{out} contains a training ({found}) that isn't the demo's: choose another --out")
    make_dataset(data, seed)
    train, held_out = EventFolder(data, "train", transform=pipeline(augmented=True)).split(0.8, seed=seed)
    held_out.transform = pipeline(augmented=False)
    test = EventFolder(data, "test", transform=pipeline(augmented=False))
    counts = f"{len(train)} recordings for training, {len(held_out)} for validation, {len(test)} for testing"
    print(f"{counts}, in {shown(data)}")
    plots.save_png(_samples_picture(data), out / "samples.png")

    model = models.rgcnn("n-mnist", len(train.classes))
    optimizer, schedule = training.adam(model, epochs, (60, 110))
    facts = training.data_of(train, test, seed)
    trainer = training.Trainer(
        model, optimizer, schedule, out, data=facts, epochs=epochs, batch=BATCH, team=here, seed=seed
    )
    best = trainer.fit(train, validation(trainer, held_out))
    trainer.publish(train.classes, test.transform, best)
    curves = [(name, [line[f"{name}_accuracy"] for line in trainer.lines]) for name in ("train", "validation")]
    plots.save_png(plots.curves(curves, "nvsdata demo: accuracy", "epoch"), out / "learning.png")
    batches = training.loader(test, BATCH, here, seed=seed, last=VOTES, whole_batches=True)
    tested = training.votes(model, batches, VOTES, here)
    print(f"accuracy on {len(test)} test recordings, with 95% intervals")
    print(f"  one 30 ms window:       {tested.single:.3f}")
    print(f"  vote of {VOTES} such windows: {tested.together:.3f}")
    print(f"plots: {shown(out / 'samples.png')}, {shown(out / 'learning.png')}")
    print(f"network: {shown(out / 'model.safetensors')}")
    example = shlex.quote(shown(data / "test/disc/000.h5"))
    print(f"next, a page that plays a recording: nvsdata view {example}")
    print("next, a network for recordings of your own: docs/tutorials/train.md in nvsdata's repository")


def pipeline(*, augmented: bool) -> T.Compose:
    """Return the transform from a recording to a graph."""
    augment: list[Any] = [T.RandomScale(), T.RandomRotate()] if augmented else []
    return T.Compose([T.RandomWindow(WINDOW), T.NonUniformSample(2), T.RadiusGraph(), *augment])


def _disc(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(np.hypot(u, v) - 1)


def _ring(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(np.hypot(u, v) - 0.8) - 0.25)


def _square(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(np.maximum(np.abs(u), np.abs(v)) - 0.9)


def _triangle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(np.maximum(np.abs(u) * 0.87 + v * 0.5, -v) - 0.55)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    upright = np.maximum(np.abs(u) - 0.3, np.abs(v) - 1)
    return np.asarray(np.minimum(upright, np.maximum(np.abs(u) - 1, np.abs(v) - 0.3)))


# signed distance from the edge of each shape, whose radius is about 1
SHAPES: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "cross": _cross,
    "disc": _disc,
    "ring": _ring,
    "square": _square,
    "triangle": _triangle,
}


def scene(shape: str, rng: np.random.Generator) -> np.ndarray:
    """Return frames of a bright shape that circles and turns on a dark background: float32 [T, H, W] in (0, 1]."""
    distance = SHAPES[shape]
    radius, phase, turn = rng.uniform(6, 9), rng.uniform(0, 2 * math.pi), rng.uniform(-0.4, 0.4)
    tilt = rng.uniform(-0.25, 0.25)
    center = SIZE / 2 + rng.uniform(-2, 2, 2)
    y, x = np.mgrid[:SIZE, :SIZE]
    frames = np.empty((FRAMES, SIZE, SIZE), np.float32)
    for i, s in enumerate(np.linspace(0, 1, FRAMES)):
        angle = phase + 2 * math.pi * s
        u, v = x - center[0] - 4 * math.cos(angle), y - center[1] - 4 * math.sin(angle)
        c, d = math.cos(tilt + turn * s), math.sin(tilt + turn * s)
        edge = distance((c * u + d * v) / radius, (c * v - d * u) / radius) * radius
        frames[i] = 0.15 + 0.85 * np.clip(0.5 - edge, 0, 1)
    return frames


def make_dataset(folder: Path, seed: int) -> None:
    """Write `train` and `test` class folders of recordings. A complete folder isn't changed.

    FileExistsError for a folder with other files, because it would be deleted.
    """
    mark = folder / MARK
    if mark.exists() and mark.read_text() == str(seed):
        return
    if folder.exists() and not mark.exists() and any(folder.iterdir()):
        raise FileExistsError(f"{folder} contains other files than the demo's: choose another --out")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    mark.touch()
    rng = np.random.default_rng(seed)
    jobs = [(split, shape, i) for split, count in COUNTS.items() for shape in SHAPES for i in range(count)]
    for split, shape, i in bar(jobs, "recordings", leave=False):
        path = folder / split / shape / f"{i:03d}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        formats.write(CAMERA.stream(scene(shape, rng), FPS), path)
    mark.write_text(str(seed))


def _samples_picture(data: Path) -> np.ndarray:
    rows = []
    for shape in SHAPES:
        paths = sorted((data / "train" / shape).iterdir())[:8]
        rows.append((shape, [plots.event_image(formats.read(path, 0, 10_000), zoom=3) for path in paths]))
    return plots.contact_sheet(rows)
