"""Draw a figure of the thesis with nvsdata, on data that exist.

    python recipes/thesis_figure.py 3.4 --out 3.4.png
    python recipes/thesis_figure.py 3.4 --root video.mp4 --out 3.4.png
    python recipes/thesis_figure.py 4.5 --root N-MNIST --dataset n-mnist
    python recipes/thesis_figure.py 5.4 --run runs/rgcnn runs/gcnn

Without options, a figure shows scenes that nvsdata draws itself: nothing is downloaded. --root names other data. For
3.2 to 3.4, 4.1 and 5.1 that is a recording of a camera with frames (such as AEDAT 4 of a DAVIS), a video, or a file
.npz with `frames` [F, H, W], `frame_times` in µs, and the events' `t`, `x`, `y`, `p`. For 3.5 it is a folder with a
subfolder of videos for each class. For 4.5 and 5.3 it is the folder or store of --dataset. --run names folders of
train_objects.py or train_actions.py: 4.2 draws that network, 5.4 a curve for each. The caption below the image, which
is also printed, states the data and the difference from the thesis. ON is red and OFF is blue.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import thesis_figures_events as events
import thesis_figures_networks as networks

from nvsdata.commands.options import path_or_url
from nvsdata.datasets import DATASETS
from nvsdata.plots import save_png
from nvsdata.plots.axes import escaped, new_figure, rendered
from nvsdata.training import run

FIGURES: dict[str, Callable[[argparse.Namespace], tuple[Any, str]]] = {
    "3.2": events.figure_3_2,
    "3.3": events.figure_3_3,
    "3.4": events.figure_3_4,
    "3.5": events.figure_3_5,
    "3.6": events.figure_3_6,
    "4.1": events.figure_4_1,
    "4.2": networks.figure_4_2,
    "4.5": events.figure_4_5,
    "4.6": networks.figure_4_6,
    "5.1": events.figure_5_1,
    "5.2": networks.figure_5_2,
    "5.3": events.figure_5_3,
    "5.4": networks.figure_5_4,
}
# figures that take --root and --run; the others have one source of data
ROOTED = ("3.2", "3.3", "3.4", "3.5", "4.1", "4.5", "5.1", "5.3")
WITH_RUNS = ("4.2", "5.4")


def main() -> None:
    args = arguments()
    figure, caption = FIGURES[args.number](args)
    text = f"Figure {args.number}, remade by nvsdata. {caption}"
    out = args.out or Path(f"{args.number}.png")
    save_png(with_caption(rendered(figure), text), out)
    print(f"{text}\n{out}")


def with_caption(image: np.ndarray, text: str) -> np.ndarray:
    """Return an image with a text below it, in lines of its width."""
    # letters are 6.3 pixels wide on average
    lines = textwrap.wrap(escaped(text), image.shape[1] // 7)
    figure = new_figure((image.shape[1], 16 * len(lines) + 14))
    figure.text(0.01, 0.5, "\n".join(lines), fontsize=8.5, va="center", color="0.25")
    return np.concatenate((image, rendered(figure)))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("number", metavar="N", help=f"number of the figure: {', '.join(FIGURES)}")
    add("--out", type=Path, help="PNG file (default N.png)")
    add("--root", type=path_or_url, help=f"data for the figures {', '.join(ROOTED)} (default: drawn scenes)")
    add("--dataset", choices=sorted(DATASETS), default="folder", help="kind of --root for 4.5 and 5.3 (default folder)")
    add(
        "--run",
        type=Path,
        nargs="+",
        default=[],
        help=f"folders of runs, for {' and '.join(WITH_RUNS)} (default: none)",
    )
    args = parser.parse_args()
    if args.number not in FIGURES:
        raise ValueError(f"no figure {args.number}: choose one of {', '.join(FIGURES)}")
    for option, given, numbers in (("--root", args.root, ROOTED), ("--run", args.run, WITH_RUNS)):
        if given and args.number not in numbers:
            raise ValueError(f"figure {args.number} takes no {option}; figures {', '.join(numbers)} do")
    return args


if __name__ == "__main__":
    run(main, "run the command again")
