"""Figures of events of the thesis, for thesis_figure.py: 3.2 to 3.6, 4.1, 4.5, 5.1 and 5.3."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from thesis_scenes import (
    GESTURES,
    LETTERS,
    SIDE,
    STATIC,
    Scene,
    gesture_events,
    letter,
    letter_events,
    scene_of,
    shaken,
)

from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.batch.folder import videos_in
from nvsdata.data.recording import as_events
from nvsdata.datasets import DATASETS
from nvsdata.emulation import DVS, PRESETS
from nvsdata.plots import event_image
from nvsdata.plots.axes import new_figure
from nvsdata.plots.drawing import middle
from nvsdata.plots.show import plot
from nvsdata.video.frames import frames_of

Drawn = tuple[Any, str]  # a figure of matplotlib, and its caption
WORST, BEST = PRESETS["table-3.3-row-1"], PRESETS["table-3.3-row-5"]
SIGNS_FPS = 30.0


def figure_3_2(args: argparse.Namespace) -> Drawn:
    """Draw recorded events above those of PIX2NVS."""
    scene = scene_of(args.root)
    made = PRESETS["section-3.4.1"].emulate(scene.frames, times=scene.times)
    start = scene.times[0]
    stop = min(scene.times[min(6, len(scene.times) - 1)], start + 400_000)
    figure = new_figure((900, 980))
    for row, (name, events) in enumerate(((scene.camera, scene.events), ("PIX2NVS, settings of section 3.4.1", made))):
        axes = figure.add_subplot(2, 1, row + 1, projection="3d")
        some = events.window(start, stop + 1)
        plot(some, "cloud", axes)
        axes.set_title(f"{name}: {len(some):,} events", fontsize=10, loc="left")
        axes.set_xlim(0, (stop - start) / 1e3)
        enlarge(axes, some, 1.6, 1.25)
    return figure, f"Data: {scene.about} ({scene.camera}). The thesis has recordings of a DAVIS240C, and green for ON."


def figure_3_3(args: argparse.Namespace) -> Drawn:
    """Draw a frame, the recorded events around it, and those of the worst and best settings of Table 3.3."""
    scene = scene_of(args.root)
    n = typical(scene.events, scene.times)
    start, stop = scene.times[n - 1], scene.times[n]
    figure = new_figure((1000, 800))
    (first, recorded), others = figure.subplots(2, 2)
    show_frame(first, scene.frames[n], "(a) frame")
    panels = [(f"(b) {scene.camera}", recorded, scene.events)]
    for mark, name, axes, settings in (("c", "row 1", others[0], WORST), ("d", "row 5", others[1], BEST)):
        made = settings.emulate(scene.frames, times=scene.times)
        panels.append((f"({mark}) PIX2NVS, Table 3.3 {name}", axes, made))
    for name, axes, events in panels:
        some = events.window(start + 1, stop + 1)
        show_events(axes, some, f"{name}: {len(some):,} events")
    how = f"{(stop - start) / 1e3:.0f} ms before the frame"
    return figure, f"Data: {scene.about} ({scene.camera}), {how}. The thesis has an action of UCF-50, and green for ON."


def figure_3_4(args: argparse.Namespace) -> Drawn:
    """Draw a frame of a video, and the summed polarity of its events: native, and downsampled by 8."""
    scene = scene_of(args.root)
    events = BEST.emulate(scene.frames, times=scene.times)
    n = typical(events, scene.times)
    some = events.window(scene.times[n - 1] + 1, scene.times[n] + 1)
    small = T.ToFrames(fps=1e6 / (scene.times[n] - scene.times[n - 1]), values="sum", factor=8)(some)[0].numpy()
    width, height = events.sensor_size
    figure = new_figure((1300, 130 + round(350 * height / width)))
    first, native, last = figure.subplots(1, 3)
    show_frame(first, scene.frames[n], "(a) frame")
    plot(some, "polarity", native)
    native.set_title("(b) PIX2NVS, native resolution", fontsize=10, loc="left")
    most = float(abs(small).max())
    image = last.imshow(small, "RdBu_r", vmin=-most, vmax=most)
    label_pixels(last, "(c) downsampled by 8", "x (8 px)", "y (8 px)")
    figure.colorbar(image, ax=last, label="the same, mean of 8x8 px", shrink=0.8)
    return figure, f"Data: frames of {scene.about}. The thesis has an archery video of UCF-101."


def figure_3_5(args: argparse.Namespace) -> Drawn:
    """Draw one frame of each class."""
    if args.root is None:
        images = [(name, letter(name)) for name in LETTERS]
        caption = (
            "Data: drawn letters in place of signs; J and Z are signed by a motion, so they aren't in the datasets."
        )
    else:
        images = list(first_frames(args.root))
        caption = f"Data: the first frame of a video of each class of {args.root.name}. The thesis has photos of signs."
    return grid([(name + " (motion)" * (name in ("J", "Z")), image) for name, image in images], 7), caption


def figure_3_6(args: argparse.Namespace) -> Drawn:
    """Draw the three frames that are VGG-16's input, for R and X: recorded and denoised, emulated, and gray."""
    figure = new_figure((1350, 350))
    rows = figure.subplots(2, 9)
    for row, name in zip(rows, "RX", strict=True):
        seed = LETTERS.index(name)
        fine = shaken(letter(name, 2 * SIDE), fps=240, seed=seed)
        gray = fine[:: round(240 / SIGNS_FPS)]
        frames = T.ToFrames(fps=SIGNS_FPS, values="sum")
        recorded = T.MedianDenoise()(frames(DVS(noise_rate=4.0, mismatch=0.1).emulate(fine, fps=240)).float())
        emulated = frames(BEST.emulate(gray, fps=SIGNS_FPS)).float()
        plain = as_tensor(gray[1:])
        parts = (("(a) simulated camera, 2x2 median", recorded), ("(b) PIX2NVS", emulated), ("(c) gray", plain))
        for n, (title, values) in enumerate(parts):
            shown = T.Normalize()(values[2:5]).numpy()
            for k in range(3):
                axes = row[3 * n + k]
                image = axes.imshow(shown[k], "gray", vmin=-3, vmax=3)
                label_pixels(axes, title if k == 0 and name == "R" else "", "", name if k + n == 0 else "")
                axes.set(xticks=[], yticks=[])
    figure.colorbar(image, ax=rows, label="standardized value", shrink=0.7)
    return figure, (
        "Data: drawn letters that move, and a simulated camera (DVS). The thesis has signs R and X, and a DAVIS240C."
    )


def figure_4_1(args: argparse.Namespace) -> Drawn:
    """Draw a frame, and the events of the same scene."""
    scene = scene_of(args.root)
    return frame_and_cloud(scene), f"Data: {scene.about} ({scene.camera}). The thesis shows several objects."


def frame_and_cloud(scene: Scene) -> Any:
    """Return a figure of a frame at the middle, and of the events around it in space and time."""
    n = len(scene.times) // 2
    figure = new_figure((1100, 460))
    first, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    show_frame(first, scene.frames[n], "frame")
    some = middle(scene.events, 100_000)
    plot(some, "cloud", space)
    space.set_title(f"{scene.camera}: {len(some):,} events", fontsize=10, loc="left")
    enlarge(space, some, 1.6, 1.1)
    return figure


def figure_4_5(args: argparse.Namespace) -> Drawn:
    """Draw events of a recording of each class."""
    if args.root is None:
        found = [(name, letter_events(name, seed)) for seed, name in enumerate(STATIC)]
        caption = (
            "Data: drawn letters recorded by a simulated camera (DVS), in place of signs of ASL-DVS; 30 ms of each."
        )
    else:
        found = list(a_recording_of_each(args, 24))
        caption = f"Data: a recording of each class of {args.dataset}; 30 ms of each. The thesis has signs of ASL-DVS."
    tiles = [(name, event_image(middle(events, 30_000))[..., ::-1]) for name, events in found]
    return grid(tiles, -(-len(tiles) // -(-len(tiles) // 8))), f"{caption} Red ON, blue OFF, purple both."


def figure_5_1(args: argparse.Namespace) -> Drawn:
    """Draw events in space and time, with the frames at their times."""
    scene = scene_of(args.root)
    chosen = list(zip(scene.times, scene.frames, strict=True))[:4]
    start, stop = chosen[0][0], chosen[-1][0]
    some = scene.events.window(start, stop + 1)
    figure = new_figure((1150, 560))
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    width, height = some.sensor_size
    for time, frame in chosen:
        step = max(1, width // 80)
        y, x = np.mgrid[0 : height + 1 : step, 0 : width + 1 : step]
        gray = frame if frame.ndim == 2 else frame.mean(2)
        faces = np.repeat((gray[::step, ::step] / 255.0)[..., None], 3, 2)[: y.shape[0] - 1, : x.shape[1] - 1]
        flat = np.full(x.shape, (time - start) / 1e3)
        axes.plot_surface(flat, x, y, facecolors=faces, shade=False, rstride=1, cstride=1, alpha=0.55, zorder=1)
    plot(some, "cloud", axes)
    axes.set_title(f"{scene.camera}: {len(some):,} events", fontsize=10, loc="left")
    enlarge(axes, some, 2.6, 1.35)
    axes.view_init(18, -62)
    return (
        figure,
        f"Data: {scene.about} ({scene.camera}), four frames and the events between. The thesis has an archery video.",
    )


def figure_5_3(args: argparse.Namespace) -> Drawn:
    """Draw events of samples in space and time: simple ones above, complex ones below."""
    if args.root is None:
        kinds = ((False, (128, 128), "A"), (True, (240, 180), "B"))
        found = [
            (f"{mark}-{n}: {name}", gesture_events(name, size, cluttered=cluttered))
            for cluttered, size, mark in kinds
            for n, name in enumerate(GESTURES, 1)
        ]
        caption = (
            "Data: drawn gestures, A on a still ground with 128x128 pixels, B on a moving one with 240x180, in place of"
            " DVS128 Gesture and UCF101-DVS."
        )
    else:
        found = list(a_recording_of_each(args, 8))
        caption = f"Data: a recording of each of the first classes of {args.dataset}."
    figure = new_figure((1500, 760))
    for n, (name, events) in enumerate(found):
        axes = figure.add_subplot(2, 4, n + 1, projection="3d")
        plot(middle(events, 500_000), "cloud", axes)
        axes.set_title(name, fontsize=10, loc="left")
        enlarge(axes, events, 1.6, 0.76)
        handles, names = axes.get_legend_handles_labels()
        axes.get_legend().remove()
    figure.legend(handles, names, loc="outside upper right", ncols=2, fontsize=9, frameon=False)
    return figure, caption


def typical(events: Events, times: list[int]) -> int:
    """Return the number of the frame before which a median number of events lies, so that it isn't one after a cut.

    ValueError for fewer than two frames.
    """
    if len(times) < 2:
        raise ValueError(f"the figure needs at least 2 frames, not {len(times)}")
    counts = np.diff(np.searchsorted(events.t, times))
    return 1 + int(np.argsort(counts, kind="stable")[len(counts) // 2])


def a_recording_of_each(args: argparse.Namespace, most: int) -> Iterator[tuple[str, Events]]:
    """Yield the name and the first recording of each class that has one. ValueError if there are none."""
    dataset = DATASETS[args.dataset](args.root, "all")
    labels = np.asarray(dataset.targets)
    for label in np.unique(labels)[:most].tolist():
        yield dataset.classes[label], as_events(dataset[int(np.argmax(labels == label))][0])


def first_frames(root: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and the first frame of a video of each class. FileNotFoundError if there are no videos."""
    first: dict[str, Path] = {}
    for video in videos_in(root, root):
        first.setdefault(video.path.parent.name, video.path)
    for name, path in first.items():
        yield name, next(iter(frames_of(path))).pixels


def as_tensor(frames: Sequence[np.ndarray]) -> torch.Tensor:
    """Return frames as float32 [T, H, W]."""
    return torch.from_numpy(np.stack(frames).astype(np.float32))


def show_frame(axes: Any, frame: np.ndarray, title: str) -> None:
    """Draw a frame, gray or RGB."""
    axes.imshow(frame, "gray", vmin=0, vmax=255)
    label_pixels(axes, title)


def show_events(axes: Any, events: Events, title: str) -> None:
    """Draw all events, whatever their times."""
    axes.imshow(event_image(events)[..., ::-1], interpolation="nearest")
    label_pixels(axes, title)


def enlarge(axes: Any, events: Events, length: float, zoom: float) -> None:
    """Set the length of the time axis in widths of the sensor, and the size of a cloud in its axes."""
    width, height = events.sensor_size
    axes.set_box_aspect((length, 1, height / width), zoom=zoom)
    # the square of the axes would cut off a larger cloud, and hide labels of its neighbors
    axes.patch.set_visible(False)
    for drawn in axes.collections:
        drawn.set_clip_on(False)
    axes.legend(loc="upper left", fontsize=8, framealpha=0.8)


def label_pixels(axes: Any, title: str, x: str = "x (px)", y: str = "y (px)") -> None:
    """Write a title and the names of the axes."""
    axes.set_title(title, fontsize=10, loc="left")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)


def grid(tiles: Sequence[tuple[str, np.ndarray]], columns: int) -> Any:
    """Return a figure of small images with their names, row by row."""
    rows = -(-len(tiles) // columns)
    figure = new_figure((150 * columns, 165 * rows + 40))
    every = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, image) in zip(every, tiles, strict=False):
        axes.imshow(image, "gray", vmin=0, vmax=255, interpolation="nearest")
        axes.set_title(name, fontsize=9)
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_color("0.8")
    for axes in every[len(tiles) :]:
        axes.set_axis_off()
    return figure
