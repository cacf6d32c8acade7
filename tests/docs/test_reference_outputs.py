"""The published hashes of representations; `python tests/docs/test_reference_outputs.py` prints the table."""

import hashlib
import re
from pathlib import Path

import pytest

import nvsdata
from nvsdata import transforms as T

PAGE = Path(__file__).parents[2] / "docs/reference-outputs.md"
WHOLE = {
    "T.EventImage()": T.EventImage(),
    "T.ToFrames(bins=6)": T.ToFrames(bins=6),
    "T.ToFrames(duration=10_000)": T.ToFrames(duration=10_000),
    'T.VoxelGrid(5, interpolation="nearest")': T.VoxelGrid(5, interpolation="nearest"),
    "T.StackedHistogram(bins=3)": T.StackedHistogram(bins=3),
    'T.ToFrames(fps=100.0, values="sum")': T.ToFrames(fps=100.0, values="sum"),
    "T.RadiusGraph(3.0), edge_index": lambda events: T.RadiusGraph(3.0)(events).edge_index,
    "T.KNNGraph(4), edge_index": lambda events: T.KNNGraph(4)(events).edge_index,
    "T.BackgroundActivity(5_000), t": lambda events: T.BackgroundActivity(5_000)(events).torch()["t"],
}


def row(name):
    """A row of the table."""
    made = WHOLE[name](nvsdata.example().window(200_000, 230_000))
    whole = made.long()
    assert (whole == made).all()
    digest = hashlib.sha256(whole.contiguous().numpy().tobytes()).hexdigest()[:16]
    return f"| `{name}` | {list(made.shape)} | `{digest}` |"


@pytest.mark.parametrize("name", WHOLE)
def test_outputs_are_those_published(name):
    assert row(name) in PAGE.read_text("utf-8").splitlines()


def test_the_page_has_nothing_else():
    assert len(re.findall(r"^\| `", PAGE.read_text("utf-8"), re.MULTILINE)) == len(WHOLE)


if __name__ == "__main__":
    print("\n".join(map(row, WHOLE)))
