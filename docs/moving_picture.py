"""The README's moving picture: events, their graph, and what a network says, drawn from real runs.

    python docs/moving_picture.py

It makes the data of `nvsdata demo`, trains its network, and writes `docs/moving-light.gif` and `docs/moving-dark.gif`.
Recordings of the test set are shown one after the other, in slow motion.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import torch
from PIL import Image

import nvsdata
from nvsdata import transforms as T
from nvsdata.plots.drawing import OFF, ON
from nvsdata.training import demo

HERE = Path(__file__).parent
ZOOM, GAP, BARS = 8, 16, 200  # pixels
STEP, SHOWN = 4_000, 5_000  # µs between images, and of events on each
GRAPH = T.Compose([T.NonUniformSample(2), T.RadiusGraph()])
EDGES_SHOWN = 3  # of each node, so that single edges can be seen
# ground, text, edges, bars, bar of the class
LOOKS = {
    "light": ((255, 255, 255), (60, 60, 60), (205, 205, 205), (200, 200, 200), (80, 150, 60)),
    "dark": ((23, 17, 13), (200, 200, 200), (85, 80, 75), (90, 85, 80), (100, 190, 90)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, default=Path("nvsdata-demo"), help="folder of the demo (default: there)")
    args = parser.parse_args()
    demo.train(args.runs, epochs=40, seed=0)
    trained = nvsdata.models.load(args.runs / "model.safetensors")
    for name, look in LOOKS.items():
        images = [
            image
            for shape in trained.classes
            for image in film(trained, args.runs / "shapes/test" / shape / "000.h5", shape, look)
        ]
        first, *others = [Image.fromarray(image[..., ::-1]).quantize(32) for image in images]
        path = HERE / f"moving-{name}.gif"
        first.save(path, save_all=True, append_images=others, duration=120, loop=0, optimize=True)
        print(f"{path}: {len(images)} images, {path.stat().st_size / 1e3:,.0f} kB")


def film(trained, path, shape, look):
    """Yield the images of a recording."""
    recording = nvsdata.open(path)
    events = recording.read()
    for stop in range(events.start + demo.WINDOW, events.start + 80_000, STEP):
        torch.manual_seed(0)
        graph = GRAPH(events.window(stop - demo.WINDOW, stop))
        with torch.no_grad():
            scores = trained.model(nvsdata.collate([(graph, 0)])[0]).softmax(1)[0].tolist()
        panels = [
            panel("events of 5 ms", draw_events(events.window(stop - SHOWN, stop), look), look),
            panel("graph of 30 ms", draw_graph(graph, look), look),
            panel("class", draw_scores(trained.classes, scores, shape, look), look),
        ]
        gap = np.full((panels[0].shape[0], GAP, 3), look[0], np.uint8)
        yield np.hstack([gap, panels[0], gap, panels[1], gap, panels[2], gap])


def panel(title, image, look):
    """Return an image below its title."""
    head = np.full((34, image.shape[1], 3), look[0], np.uint8)
    write(head, title, (0, 22), look[1])
    foot = np.full((GAP, image.shape[1], 3), look[0], np.uint8)
    return np.vstack([head, image, foot])


def write(image, text, place, color):
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)


def draw_events(events, look):
    """Draw ON events red, OFF events blue, and a frame around the sensor."""
    image = np.full((demo.SIZE, demo.SIZE, 3), look[0], np.uint8)
    image[events.y, events.x] = np.where(events.p[:, None] == 1, ON, OFF)
    image = np.repeat(np.repeat(image, ZOOM, 0), ZOOM, 1)
    return framed(image, look)


def draw_graph(graph, look):
    """Draw the nodes at their pixels, and the first edges of each."""
    image = np.full((demo.SIZE * ZOOM, demo.SIZE * ZOOM, 3), look[0], np.uint8)
    at = ((graph.pos.numpy()[:, :2] + 0.5) * ZOOM).astype(int)
    seen = {}
    for source, target in graph.edge_index.t().tolist():
        seen[target] = seen.get(target, 0) + 1
        if seen[target] <= EDGES_SHOWN:
            cv2.line(image, at[source].tolist(), at[target].tolist(), look[2], 1, cv2.LINE_AA)
    for place, polarity in zip(at.tolist(), graph.x[:, 0].tolist(), strict=True):
        cv2.circle(image, place, 2, ON if polarity > 0 else OFF, -1, cv2.LINE_AA)
    return framed(image, look)


def draw_scores(classes, scores, shape, look):
    """Draw the probability of each class."""
    side = demo.SIZE * ZOOM
    image = np.full((side, BARS, 3), look[0], np.uint8)
    for row, (name, score) in enumerate(zip(classes, scores, strict=True)):
        top = row * side // len(classes)
        write(image, f"{name} {100 * score:.0f}%", (0, top + 18), look[1])
        color = look[4] if name == shape else look[3]
        cv2.rectangle(image, (0, top + 26), (max(2, round(score * (BARS - 2))), top + 40), color, -1)
    return image


def framed(image, look):
    cv2.rectangle(image, (0, 0), (image.shape[1] - 1, image.shape[0] - 1), look[3], 1)
    return image


if __name__ == "__main__":
    main()
