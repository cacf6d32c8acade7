"""Learn thresholds of DVS pixels by gradient, and compare them with those of `emulation.fit` on unseen frames.

    python recipes/learned_emulator.py slider_depth.npz street.aedat4 cups.npz --out learned

Pairs, halves, parts and figures are those of emulation_accuracy.py. The settings are learned on one half of the frames
and compared with the events of the other half; then the halves are swapped. There are two learned emulators: one
learns the two thresholds and `dark`; in the other, a network of 2,946 weights also maps each pixel's surroundings in
two frames to its own two thresholds. For learning, the number of events is a continuous function of the light: its
mean over pixels whose distances to the next event are random. For the comparison, pixels fire as those of DVS. The loss
is the Poisson likelihood of the numbers of events per pixel, polarity and interval between frames. The network begins
with the settings that were learned without it. A quarter of the blocks of pixels of the training half is held out: its
likelihood decides when to stop, and by how many pixels predicted numbers are blurred. The events of the other half are
used only for the comparison.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from emulation_accuracy import FITTED, Row, bootstrap, measure_parts, part, read_pair
from torch import Tensor, nn
from torch.nn import functional

from nvsdata import Events
from nvsdata.common.files import claimed, put
from nvsdata.common.text import aligned
from nvsdata.emulation import DVS, fit
from nvsdata.emulation.correlation import count_images
from nvsdata.emulation.state import brightness
from nvsdata.emulation.thresholds import polarity_counts
from nvsdata.training import run
from nvsdata.video.frames import VideoFrame
from nvsdata.video.upsample import upsample_frames

LEARNED, NETWORK = "DVS, learned", "DVS, learned, network"
BLURS = (1.0, 2.0)  # standard deviations in pixels
CROP, INTERVALS = 64, 2  # sides in pixels, and intervals between frames, of the random crops that are learned from
CHECKED = 30  # training steps between checks of the held-out blocks
PATIENCE = 3  # checks without progress after which learning stops
BLOCKS = 8  # blocks per side of the sensor
MATCHED = 6  # rounds of the search for factors of the thresholds


class Scene(NamedTuple):
    """Frames with those that upsampling made between them, and the sensor's events.

    Args:
        times: Times in µs, int64 [N].
        gray: Brightness, float32 [N, H, W].
        whole: Indices of the recorded frames, with the first and the last one.
        counts: Numbers of OFF and ON events per interval between recorded frames, float32 [intervals, 2, H, W].
    """

    times: np.ndarray
    gray: Tensor
    whole: list[int]
    counts: Tensor

    @classmethod
    def of(cls, frames: list[VideoFrame], events: Events) -> Scene:
        """Return the scene of frames and events whose times begin at 0."""
        more = list(upsample_frames(iter(frames), "flow"))
        gray = torch.from_numpy(np.stack([brightness(frame) for frame in more]).astype(np.float32))
        times = np.array([frame.time for frame in more])
        counts = [count_images(events.window(a.time, b.time)) for a, b in pairwise(frames)]
        whole = np.searchsorted(times, [frame.time for frame in frames]).tolist()
        return cls(times, gray, whole, torch.from_numpy(np.stack(counts).astype(np.float32)))


class Pixels(nn.Module):
    """DVS pixels with a learned `dark` and thresholds, the same for all pixels or with a factor from a network.

    The network's inputs are the mean logarithm of light in the two frames of an interval, its spatial gradient, and its
    change and absolute change from frame to frame. In training mode, numbers of events are continuous.

    Args:
        network: Whether a network maps frames to thresholds.
        start: Settings to begin with.
    """

    def __init__(self, network: bool = False, start: DVS | None = None) -> None:
        super().__init__()
        start = start or DVS()
        self.thresholds = nn.Parameter(torch.tensor([start.off, start.on]).log())
        self.dark = nn.Parameter(torch.tensor(start.dark).log())
        self.floor = nn.Parameter(torch.tensor([0.05, 0.05]).log())  # other events per pixel and interval
        self.network: nn.Sequential | None = None
        if network:
            layers = nn.Conv2d(4, 16, 3, padding=1), nn.ReLU(), nn.Conv2d(16, 16, 3, padding=1), nn.ReLU()
            last = nn.Conv2d(16, 2, 1)
            nn.init.zeros_(last.weight)
            self.network = nn.Sequential(*layers, last)

    def each(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the OFF and ON thresholds of pixels between two frames [H, W], [2, H, W] or [2, 1, 1]."""
        logarithm = self.thresholds[:, None, None]
        if self.network is not None:
            a, b = (before + 10).log(), (after + 10).log()
            light = functional.pad((a + b)[None, None] / 2, (1, 1, 1, 1), "replicate")[0, 0]
            across, down = light[1:-1, 2:] - light[1:-1, :-2], light[2:, 1:-1] - light[:-2, 1:-1]
            inputs = torch.stack((light[1:-1, 1:-1] - 4, across.hypot(down), b - a, (b - a).abs()))
            logarithm = logarithm + self.network(inputs[None])[0].tanh()
        return logarithm.exp()

    def crossings(self, changes: Tensor) -> Tensor:
        """Return the numbers of events of changes from the memory, which are given in thresholds.

        A pixel whose distance to its next event is random fires x - 1/2 times on average if light changes by x > 1/2
        thresholds, and then needs a change of both half thresholds to fire with the other polarity.
        """
        return (changes - 0.5).relu() if self.training else changes.floor()

    def __str__(self) -> str:
        off, on = self.thresholds.exp().tolist()
        return f"on {on:.3g}, off {off:.3g}, dark {self.dark.exp():.3g}"

    def forward(self, gray: Tensor, whole: list[int]) -> Tensor:
        """Return the numbers of events [intervals, 2, H, W] of frames [N, H, W]."""
        found: list[Tensor] = []

        def add(step: int, before: Tensor, after: Tensor, memory: Tensor, thresholds: Tensor, count: Tensor) -> None:
            if step - 1 in whole:
                found.append(count)
            else:
                found[-1] = found[-1] + count

        self.simulate(gray, whole, add)
        return torch.stack(found)

    def simulate(self, gray: Tensor, whole: list[int], each_step: Callable[..., None]) -> None:
        """Call a function for each frame but the first.

        Its arguments are the frame's index, the levels before and after it, the memory of the pixels before it, the
        thresholds, and the numbers of OFF and ON events [2, H, W].
        """
        levels = (gray + self.dark.exp()).log().unbind()
        memory = levels[0]
        for first, last in pairwise(whole):
            thresholds = self.each(gray[first], gray[last])
            for step in range(first + 1, last + 1):
                above = levels[step] - memory
                count = self.crossings(torch.stack((-above, above)).relu() / thresholds)
                each_step(step, levels[step - 1], levels[step], memory, thresholds, count)
                off, on = count * thresholds
                memory = memory + on - off

    @torch.no_grad()
    def emulate(self, frames: list[VideoFrame]) -> Events:
        """Return the events of frames; light changes linearly between the frames that upsampling makes."""
        self.eval()
        height, width = frames[0].pixels.shape[:2]
        scene = Scene.of(frames, Events.empty((width, height)))
        rows = []

        def add(step: int, before: Tensor, after: Tensor, memory: Tensor, thresholds: Tensor, count: Tensor) -> None:
            start, span = scene.times[step - 1], scene.times[step] - scene.times[step - 1]
            for p, sign in enumerate((-1, 1)):
                each = thresholds[p].expand(height, width)
                for k in range(1, int(count[p].max()) + 1):
                    y, x = torch.nonzero(count[p] >= k, as_tuple=True)
                    change = (after - before)[y, x]
                    # a threshold that has just become lower is crossed at once
                    late = ((memory + sign * k * each - before)[y, x] / change).nan_to_num(0, 0, 0).clamp(0, 1)
                    t = start + np.ceil(late.double().numpy() * span).astype(np.int64)
                    rows.append(np.stack((t, x.numpy(), y.numpy(), np.full(t.size, p))))

        self.simulate(scene.gray, scene.whole, add)
        t, x, y, p = np.concatenate(rows, axis=1) if rows else np.empty((4, 0), np.int64)
        order = np.argsort(t, kind="stable")
        columns = t[order], x[order], y[order], p[order] > 0
        return Events(*columns, (width, height), start=0, end=int(scene.times[-1]))


def learn(scene: Scene, model: Pixels, blur: float, steps: int) -> float:
    """Change pixels until they no longer predict held-out blocks better; return the loss in these blocks."""
    held_out = held_out_blocks(scene.gray.shape[1:])
    settings = [model.thresholds, model.dark, model.floor]
    groups: list[dict[str, Any]] = [{"params": settings, "lr": 0.05}]
    if model.network is not None:
        groups.append({"params": model.network.parameters(), "lr": 0.003, "weight_decay": 1e-3})
    optimizer = torch.optim.AdamW(groups, weight_decay=0)
    best: dict[str, Tensor] = {}
    least, since = math.inf, 0
    for step in range(steps + 1):
        if step % CHECKED == 0:
            with torch.no_grad():
                found = loss(model, scene, held_out, blur).item()
            since = 0 if found < least else since + 1
            if not since:
                best, least = {name: one.clone() for name, one in model.state_dict().items()}, found
            if since == PATIENCE:
                break
        crop, window = random_crop(scene)
        optimizer.zero_grad()
        loss(model, crop, ~held_out[window], blur).backward()
        optimizer.step()
    model.load_state_dict(best)
    return least


def loss(model: Pixels, scene: Scene, mask: Tensor, blur: float) -> Tensor:
    """Return the negative Poisson log-likelihood of the sensor's numbers of events, a mean over the pixels in a mask.

    The predicted numbers are blurred, because frames and flow place an edge only to about a pixel.
    """
    found = model(scene.gray, scene.whole)
    if blur:
        radius = math.ceil(2 * blur)
        kernel = torch.exp(-((torch.arange(-radius, radius + 1) / blur) ** 2) / 2)
        kernel = kernel / kernel.sum()
        flat = functional.pad(found.flatten(0, 1)[:, None], (radius,) * 4, "replicate")
        flat = functional.conv2d(functional.conv2d(flat, kernel[None, None, None]), kernel[None, None, :, None])
        found = flat[:, 0].reshape(found.shape)
    rate = found + model.floor.exp()[:, None, None]
    each: Tensor = rate - scene.counts * rate.log()
    return each[..., mask].mean()


def held_out_blocks(shape: tuple[int, ...]) -> Tensor:
    """Return the mask [H, W] of a quarter of the blocks, which are scattered over the sensor."""
    rows, columns = (torch.arange(side) * BLOCKS // side for side in shape)
    return (rows[:, None] + 2 * columns[None] + columns[None] // 2) % 4 == 0


def random_crop(scene: Scene) -> tuple[Scene, tuple[slice, slice]]:
    """Return at most `INTERVALS` intervals and `CROP` x `CROP` pixels of a scene, and this window of pixels."""
    first = int(torch.randint(max(len(scene.counts) - INTERVALS, 0) + 1, ()))
    corner = [int(torch.randint(max(side - CROP, 0) + 1, ())) for side in scene.gray.shape[1:]]
    window = slice(corner[0], corner[0] + CROP), slice(corner[1], corner[1] + CROP)
    whole = scene.whole[first : first + INTERVALS + 1]
    inside = slice(whole[0], whole[-1] + 1)
    counts = scene.counts[first : first + INTERVALS, :, *window]
    return Scene(scene.times[inside], scene.gray[inside, *window], [n - whole[0] for n in whole], counts), window


@torch.no_grad()
def match_counts(model: Pixels, scene: Scene) -> None:
    """Scale the thresholds of both polarities until there are as many events as the sensor's, as `fit` does."""
    model.eval()
    wanted = scene.counts.sum(dim=(0, 2, 3)).clamp(min=1)
    for _ in range(MATCHED):
        found = model(scene.gray, scene.whole).sum(dim=(0, 2, 3)).clamp(min=1)
        model.thresholds += 0.7 * (found / wanted).log()


def learned(scene: Scene, steps: int, seed: int) -> dict[str, tuple[Pixels, str]]:
    """Return the learned emulators and their descriptions; their numbers of events are those of the sensor."""
    torch.manual_seed(seed)
    tried = {blur: Pixels() for blur in BLURS}
    losses = {blur: learn(scene, model, blur, steps) for blur, model in tried.items()}
    blur = min(losses, key=losses.__getitem__)
    said = ", ".join(f"{found:.4f} with blur {one:g}" for one, found in losses.items())
    refined = Pixels(network=True)
    refined.load_state_dict(tried[blur].state_dict(), strict=False)
    refined_said = f"{learn(scene, refined, blur, steps):.4f} with blur {blur:g}"
    found = {LEARNED: (tried[blur], said), NETWORK: (refined, refined_said)}
    for model, _ in found.values():
        match_counts(model, scene)
    return {name: (model, f"{model}; held-out loss {said}") for name, (model, said) in found.items()}


def compare(path: Path, steps: int, seed: int) -> list[Row]:
    """Return a row for each emulator, measured on the halves that it wasn't fitted to or learned from."""
    frames, events = read_pair(path)
    seen, count = max(len(frames) // 2, 3), len(frames)
    if count <= seen:
        raise ValueError(f"{path}: {count} frames, at least {seen + 1} are needed to learn and to test")
    halves = (
        (slice(0, seen), slice(seen - 1, count)),
        (slice(count - seen, count), slice(0, count - seen + 1)),
    )
    measured: dict[str, list[dict[str, Any]]] = {}
    for known, unknown in halves:
        found = fit(frames[known], events, base=DVS(upsample="flow"), noise=False)
        scene = Scene.of(*part(frames[known], events, found.delay))
        test, real = part(frames[unknown], events, found.delay)
        emulators: dict[str, Any] = {"DVS, not fitted": DVS(), FITTED: found.settings}
        for name, (model, said) in learned(scene, steps, seed).items():
            emulators[name] = model
            print(f"{path.name}, frames {known.start} to {known.stop - 1}, {name}: {said}", flush=True)
        for name, emulator in emulators.items():
            emulated = emulator.emulate(test)
            off, on = polarity_counts(emulated) / np.maximum(polarity_counts(real), 1)
            print(f"  {name}: {off:.3f} times the sensor's OFF events, {on:.3f} times its ON events", flush=True)
            measured.setdefault(name, []).extend(measure_parts(emulated, real, test))
    return [Row(name, bootstrap(parts)) for name, parts in measured.items()]


def table(rows: list[Row]) -> str:
    """Return the rows as a table, with the figures in which each is better or worse than the fitted DVS."""
    fitted = next(row for row in rows if row.emulator == FITTED)
    lines: list[tuple[str, ...]] = [("", *fitted.figures, "better than fitted in", "worse than fitted in")]
    for row in rows:
        figures = ["{:.3g} ({:.3g}, {:.3g})".format(*values) for values in row.summary().values()]
        lines.append((row.emulator, *figures, ", ".join(fitted.worse(row)), ", ".join(row.worse(fitted))))
    return aligned(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path, nargs="+", metavar="PAIR", help="recordings with frames, or .npz files")
    parser.add_argument("--out", type=Path, default=Path("learned"), help="folder for tables (default: learned)")
    parser.add_argument("--steps", type=int, default=150, help="most steps of learning (default: 150)")
    parser.add_argument("--seed", type=int, default=0, help="seed of crops and network (default: 0)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    with claimed(args.out):
        for path in args.pairs:
            rows = compare(path, args.steps, args.seed)
            text = f"{path.name}\n{table(rows)}\n"
            print(text, flush=True)
            put(args.out / f"{path.stem}.txt", text.encode())
            facts = [{"emulator": row.emulator, **row.summary()} for row in rows]
            put(args.out / f"{path.stem}.json", json.dumps(facts, indent=1).encode())


if __name__ == "__main__":
    run(main, "run the command again")
