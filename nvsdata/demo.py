"""`nvsdata demo`: shapes that move, seen by an ideal event camera, told apart by a graph CNN."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy
from torch.utils.data import DataLoader
from tqdm import tqdm

from nvsdata import formats, models, plots
from nvsdata import transforms as T
from nvsdata.common.files import claimed
from nvsdata.data.batching import collate
from nvsdata.data.events import Events
from nvsdata.datasets import EventFolder

SIZE = 34  # pixels, as N-MNIST
FRAME_US = 500
FRAMES = 161  # 80 ms
THRESHOLD = 0.6  # of log intensity
MARK = ".nvsdata-demo"  # of the folder of recordings: what it says is their seed, once all are there
COUNTS = {"train": 40, "test": 15}  # recordings a class


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


# signed distance from the edge of each shape, about 1 in radius
SHAPES: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "cross": _cross,
    "disc": _disc,
    "ring": _ring,
    "square": _square,
    "triangle": _triangle,
}


def scene(shape: str, rng: np.random.Generator) -> np.ndarray:
    """Frames of a bright shape that circles and turns on a dark ground: float64 [T, H, W] in (0, 1]."""
    distance = SHAPES[shape]
    radius, phase, turn = rng.uniform(6, 9), rng.uniform(0, 2 * math.pi), rng.uniform(-0.4, 0.4)
    tilt = rng.uniform(-0.25, 0.25)
    centre = SIZE / 2 + rng.uniform(-2, 2, 2)
    y, x = np.mgrid[:SIZE, :SIZE]
    frames = np.empty((FRAMES, SIZE, SIZE))
    for i, s in enumerate(np.linspace(0, 1, FRAMES)):
        angle = phase + 2 * math.pi * s
        u, v = x - centre[0] - 4 * math.cos(angle), y - centre[1] - 4 * math.sin(angle)
        c, d = math.cos(tilt + turn * s), math.sin(tilt + turn * s)
        edge = distance((c * u + d * v) / radius, (c * v - d * u) / radius) * radius
        frames[i] = 0.15 + 0.85 * np.clip(0.5 - edge, 0, 1)
    return frames


def ideal_events(frames: np.ndarray, frame_us: int, threshold: float) -> Events:
    """Events of an ideal camera: one each time log intensity has moved by `threshold` since the last.

    `frames` positive [T, H, W], `frame_us` µs apart; between frames the log intensity is taken to
    move in a straight line, and an event bears the instant of its crossing.
    """
    level = np.log(frames)
    reference = level[0].copy()
    parts: list[tuple[np.ndarray, ...]] = []
    for i in range(1, len(level)):
        steps = np.trunc((level[i] - reference) / threshold).astype(int)
        y, x = np.nonzero(steps)
        count = np.abs(steps[y, x])
        pixel = np.repeat(np.arange(count.size), count)
        nth = np.arange(pixel.size) - np.repeat(np.cumsum(count) - count, count) + 1
        x, y = x[pixel], y[pixel]
        sign = np.sign(steps[y, x])
        crossing = reference[y, x] + sign * nth * threshold
        share = (crossing - level[i - 1, y, x]) / (level[i, y, x] - level[i - 1, y, x])
        t = np.floor((i - 1 + np.clip(share, 0, 1)) * frame_us).astype(np.int64)
        parts.append((t, x, y, sign > 0))
        reference += steps * threshold
    t, x, y, p = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Events(t, x, y, p.astype(np.uint8), frames.shape[:0:-1])


def make_dataset(folder: Path, seed: int) -> None:
    """Write `train` and `test` class folders of recordings; a folder that is complete is left alone.

    FileExistsError for a folder that somebody else made: it would be deleted.
    """
    mark = folder / MARK
    if mark.exists() and mark.read_text() == str(seed):
        return
    if folder.exists() and not mark.exists() and any(folder.iterdir()):
        raise FileExistsError(f"{folder} holds other files than the demo's: choose another --out")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    mark.touch()
    rng = np.random.default_rng(seed)
    jobs = [(split, shape, i) for split, count in COUNTS.items() for shape in SHAPES for i in range(count)]
    for split, shape, i in tqdm(jobs, "recordings", leave=False, disable=None):
        path = folder / split / shape / f"{i:03d}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        formats.write(ideal_events(scene(shape, rng), FRAME_US, THRESHOLD), path)
    mark.write_text(str(seed))


def run(out: Path, *, seconds: float, seed: int) -> int:
    """Make the data, train for `seconds`, print the accuracy, write two pictures; return 0."""
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        return _run(out, seconds, seed)


def _run(out: Path, seconds: float, seed: int) -> int:
    torch.manual_seed(seed)
    data = out / "shapes"
    make_dataset(data, seed)
    graph: list[Any] = [T.RandomWindow(30_000), T.NonUniformSample(2), T.RadiusGraph()]
    augment: list[Any] = [T.RandomScale(), T.RandomRotate()]
    train = EventFolder(data, "train", transform=T.Compose([*graph, *augment]))
    test = EventFolder(data, "test", transform=T.Compose(graph))
    print(f"{len(train)} recordings to train on, {len(test)} to test on, in {data}")
    plots.save(_samples_picture(data), out / "samples.png")

    model = models.rgcnn("n-mnist", len(train.classes))
    history = _fit(model, train, test, seconds)
    plots.save(plots.curves(list(history.items()), "nvsdata demo: accuracy", "epoch"), out / "learning.png")
    print(f"accuracy on {len(test)} recordings not trained on, one 30 ms window each: {history['test'][-1]:.3f}")
    print(f"pictures: {out / 'samples.png'}, {out / 'learning.png'}")
    return 0


def _fit(model: models.RGCNN, train: EventFolder, test: EventFolder, seconds: float) -> dict[str, list[float]]:
    """Train for about `seconds`; accuracy on both sets, an entry an epoch."""
    batches: DataLoader[Any] = DataLoader(train, batch_size=32, shuffle=True, collate_fn=collate)
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    history: dict[str, list[float]] = {"train": [], "test": []}
    # the first batch compiles the kernels: that is no training time
    torch.autograd.backward(model(next(iter(batches))[0]).sum())
    begin = time.monotonic()
    with tqdm(total=round(seconds), unit="s", desc="training", leave=False, disable=None) as bar:
        while not history["test"] or time.monotonic() - begin < seconds:
            model.train()
            right = 0
            for graphs, targets in batches:
                scores = model(graphs)
                optimizer.zero_grad()
                loss = cross_entropy(scores, targets)
                torch.autograd.backward(loss)
                optimizer.step()
                right += int((scores.argmax(1) == targets).sum())
            history["train"].append(right / len(train))
            history["test"].append(accuracy(model, test))
            bar.update(min(round(time.monotonic() - begin), round(seconds)) - bar.n)
            bar.set_postfix(accuracy=f"{history['test'][-1]:.3f}")
    return history


@torch.no_grad()
def accuracy(model: models.RGCNN, dataset: EventFolder) -> float:
    """Share of recordings whose class is told right from one window each."""
    model.eval()
    batches: DataLoader[Any] = DataLoader(dataset, batch_size=64, collate_fn=collate)
    return sum(int((model(graphs).argmax(1) == targets).sum()) for graphs, targets in batches) / len(dataset)


def _samples_picture(data: Path) -> np.ndarray:
    rows = []
    for shape in SHAPES:
        paths = sorted((data / "train" / shape).iterdir())[:8]
        rows.append((shape, [plots.event_image(formats.read(path, 0, 10_000), zoom=3) for path in paths]))
    return plots.contact_sheet(rows)
