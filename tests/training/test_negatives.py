import numpy as np
import pytest
import torch

from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.training import Negatives
from nvsdata.training.negatives import MovedParts
from nvsdata.training.objects import Objects

WINDOW = T.Compose([T.RandomWindow(1_000), lambda events: events])


def grid(width=8, height=6, x=20, y=10):
    """An event at each pixel of a rectangle, each at its own time."""
    down, across = np.indices((height, width)).reshape(2, -1)
    return Events(np.arange(down.size), across + x, down + y, down.astype(int) % 2, (60, 40))


def moved(events):
    return tuple(zip(*(column.tolist() for column in MovedParts()(events).columns), strict=True))


def test_parts_are_flipped_or_rolled_within_their_rectangle():
    ev = grid()
    place = {(x, y): t for t, x, y, _ in zip(*(column.tolist() for column in ev.columns), strict=True)}
    torch.manual_seed(0)
    kinds = set()
    for _ in range(300):
        found = moved(ev)
        # the times and polarities stay, each pixel has one event again
        assert [(t, p) for t, _, _, p in found] == list(zip(ev.t.tolist(), ev.p.tolist(), strict=True))
        assert {(x, y) for _, x, y, _ in found} == place.keys()
        _, x, y, _ = (np.array(column) for column in zip(*found, strict=True))
        across, down = (x - ev.x) % 8, (y - ev.y) % 6
        if (y == 25 - ev.y).all():
            kinds.add("flip")
            assert (across == 0).all()
            continue
        # all by the same distance, a quarter to three quarters of the rectangle
        assert len(set(across)) == len(set(down)) == 1
        assert 1 <= down[0] <= 4
        assert across[0] in (0, 2, 3, 4, 5)
        kinds.add(("roll", bool(across[0])))
    assert kinds == {"flip", ("roll", False), ("roll", True)}


def test_few_events_have_few_parts():
    assert MovedParts()(grid()[:0]) == grid()[:0]
    one = grid()[5]
    assert MovedParts()(one) == one


def test_a_fraction_of_the_objects_becomes_background():
    ev = grid()
    torch.manual_seed(0)
    negatives = Negatives(WINDOW, background=2, fraction=0.3)
    found = [negatives(ev, target) for target in (0, 1, 2) for _ in range(500)]
    assert [sample == ev for sample, target in found if target != 2] == [True] * sum(t != 2 for _, t in found)
    # backgrounds stay, and others become one with the probability
    assert all(negatives(ev, 2) == (ev, 2) for _ in range(20))
    share = sum(target == 2 for _, target in found[:1000]) / 1000
    assert share == pytest.approx(0.3, abs=0.05)
    assert sum(sample != ev for sample, target in found if target == 2) == sum(
        target == 2 for _, target in found[:1000]
    )
    assert Negatives(WINDOW, 0, 0.0)(ev, 1) == (ev, 1)


def test_negatives_need_a_window_and_a_probability():
    with pytest.raises(ValueError, match="fraction must be between 0 and 1, not 2"):
        Negatives(WINDOW, 0, 2)
    with pytest.raises(ValueError, match="negatives must be between 0 and 1, not -1"):
        Objects("n-cars", negatives=-1)
    with pytest.raises(ValueError, match="RandomWindow"):
        Negatives(T.Compose([T.EventImage()]), 0, 1.0)(grid(), 1)
