"""The `nvsdata gallery` command: a page with images and statistics of a dataset."""

from __future__ import annotations

import argparse
import random
import sys
from pathlib import Path

from nvsdata.commands.options import at_least_1, dataset, path, usage
from nvsdata.common.errors import shown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path, metavar="ROOT", help="the dataset's folder, or a packed store")
    add(
        "out",
        nargs="?",
        type=path,
        metavar="OUT.html",
        help="page to write (default: ROOT's name with .html, in the current folder)",
    )
    add(
        "--dataset",
        type=dataset,
        metavar="NAME",
        help="name of the dataset, as in `nvsdata datasets` (default: folders with a class each)",
    )
    add("--split", default="all", help="show one split only")
    add("--read", type=at_least_1, metavar="N", default=20, help="number of random recordings of each class to read")
    add("--images", type=at_least_1, metavar="N", default=6, help="number of recordings of each class to show")
    add("--overwrite", action="store_true", help="replace OUT.html if it exists")


def run(args: argparse.Namespace) -> int:
    """Write the page; return 1 if a recording can't be read."""
    from nvsdata.common.files import creating, put
    from nvsdata.common.progress import bar
    from nvsdata.datasets import EventFolder
    from nvsdata.datasets.facts import Sample
    from nvsdata.datasets.indexing import check_choice
    from nvsdata.plots.gallery import ClassSummary, gallery

    kind = args.dataset or EventFolder
    out = args.out or Path(f"{args.root.resolve().name}.html")
    with usage():
        check_choice("--split", args.split, kind.splits)
        if out.suffix.lower() != ".html":
            raise ValueError(f"OUT.html must end in .html, not {out.suffix!r}")
    with creating(out, overwrite=args.overwrite):
        data = kind.complete(args.root) if args.split == "all" else kind(args.root, args.split)
        if not all(isinstance(sample, Sample) for sample in data.samples):
            raise ValueError(
                f"samples of {kind.__name__} are pairs of recordings: use `nvsdata view` for single recordings"
            )
        by_class: list[list[int]] = [[] for _ in data.classes]
        for index, sample in enumerate(data.samples):
            by_class[sample.label].append(index)
        summaries = [ClassSummary(name, len(found)) for name, found in zip(data.classes, by_class, strict=True)]
        rng = random.Random(0)
        chosen = [rng.sample(found, min(args.read, len(found))) for found in by_class]
        faults = []
        with bar(None, "reading", total=sum(map(len, chosen)), leave=False) as progress:
            for summary, indices in zip(summaries, chosen, strict=True):
                for index in indices:
                    name = data.samples[index].name
                    try:
                        events = data.recording(index).read()
                    except (OSError, ValueError) as error:
                        faults.append(str(error))
                    else:
                        summary.add(events)
                        if len(summary.images) < args.images:
                            summary.show(name, events)
                    progress.update()
        put(out, gallery(args.root.resolve().name, summaries, faults).encode(), through_link=True)
    for fault in faults:
        print(shown(fault), file=sys.stderr)
    print(f"{sum(len(summary.events) for summary in summaries):,} of {len(data):,} recordings read: {shown(out)}")
    return 1 if faults else 0
