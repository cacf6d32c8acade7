"""What random transforms draw: over the whole range, evenly, and nothing but that changes.

A transform that isn't marked deterministic and isn't in `random_cases.py` fails the second test.
"""

import math

import numpy as np
import pytest
import torch
from graphs import scattered
from random_cases import CASES, COUNT, ERRORS, FEW, GRAPH, MANY, chance, mirrored_graph

from nvsdata import Events, GraphBatch
from nvsdata import transforms as T


def alike(result, expected, pixels=0):
    """Equal in every field and type, positions and pseudo-coordinates to rounding, events to `pixels`."""
    assert type(result) is type(expected)
    if isinstance(result, list):
        assert len(result) == len(expected)
        return all(alike(*pair) for pair in zip(result, expected, strict=True))
    if isinstance(result, Events):
        assert (result.sensor_size, result.start, result.end) == (expected.sensor_size, expected.start, expected.end)
        for mine, other, most in zip(result.columns, expected.columns, (0, pixels, pixels, 0), strict=True):
            assert mine.dtype == other.dtype
            assert mine.shape == other.shape
            assert abs(mine.astype(np.int64) - other).max(initial=0) <= most
    elif isinstance(result, torch.Tensor):
        torch.testing.assert_close(result, expected, rtol=0, atol=1e-6)
    else:
        torch.testing.assert_close(result.pos, expected.pos, rtol=0, atol=2e-4)
        torch.testing.assert_close(result.edge_attr, expected.edge_attr, rtol=0, atol=1e-4)
        for name in ("x", "t", "edge_index"):
            assert torch.equal(getattr(result, name), getattr(expected, name))
        for name in ("y", "sensor_size", "reach", "pseudo"):
            assert getattr(result, name) == getattr(expected, name)
    return True


@pytest.mark.parametrize("case", CASES, ids=lambda case: repr(case.transform))
def test_it_draws_what_it_says_and_changes_nothing_else(case):
    found = []
    for n in range(COUNT):
        result = case.transform(case.sample)
        found.append(case.read(result))
        if n < 50:
            # positions that were estimated may round to the next pixel
            assert alike(result, case.follows(*found[-1]), pixels=int(isinstance(case.transform, T.RandomAffine)))
    columns = list(zip(*found, strict=True))
    for column, check in zip(columns, case.drawn, strict=True):
        check(column)
    if case.independent and len(columns) > 1:
        between = np.corrcoef(np.array(columns, float)) - np.eye(len(columns))
        assert abs(between).max() < ERRORS / math.sqrt(COUNT)


def kinds():
    return {thing for name in T.__all__ if isinstance(thing := getattr(T, name), type)}


def test_every_random_transform_has_a_case():
    # those that are made of others say it of them
    of_others = {T.Compose, T.Each, T.NodeFeatures, T.WithBoxes}
    random = {kind for kind in kinds() - of_others if getattr(kind, "deterministic", False) is not True}
    assert random == {type(case.transform) for case in CASES}


def test_none_is_mirrored_with_probability_0_and_all_with_1():
    for _ in range(200):
        assert T.RandomFlip(1, p=0)(GRAPH) is GRAPH
        assert alike(T.RandomFlip(1, p=1)(GRAPH), mirrored_graph(1))


def test_each_event_is_dropped_by_itself():
    """Neither runs of events nor parts of the recording go together, and none is spared."""
    kept = np.stack([np.isin(MANY.t, T.DropEvents(0.6)(MANY).t) for _ in range(60)])
    share = kept.mean(1, keepdims=True)
    off = (kept - share) / np.sqrt(share * (1 - share))
    for lag in (1, 2, 34):
        assert abs((off[:, lag:] * off[:, :-lag]).mean()) < ERRORS / math.sqrt(60 * (20_000 - lag))
    assert abs(off[:, :10_000].mean()) < ERRORS / math.sqrt(60 * 10_000)
    assert not kept.all(0).any()
    assert abs(kept.mean(0).mean() - 0.7) < ERRORS * 0.6 / math.sqrt(12 * 60)


def test_a_crop_of_several_scales_takes_each_and_every_place():
    columns, lines = torch.arange(14.0).expand(9, 14), torch.arange(9.0)[:, None].expand(9, 14)
    crop = T.RandomCrop(8, (0.5, 1.0))
    places = {4: [], 8: []}
    for _ in range(COUNT):
        x, y = crop(torch.stack((columns, lines)))
        # a resized ramp keeps its mean, and rises by side / 8 a pixel
        side = round(float(x[0, 4] - x[0, 3]) * 8)
        places[side].append((float(x.mean()) - (side - 1) / 2, float(y.mean()) - (side - 1) / 2))
        assert x.shape == (8, 8)
    chance(0.5)([1] * len(places[4]) + [0] * len(places[8]))
    for side, found in places.items():
        corners = np.rint(found)
        np.testing.assert_allclose(found, corners, atol=1e-4)
        assert {tuple(corner) for corner in corners} == {(x, y) for x in range(15 - side) for y in range(10 - side)}


def test_few_events_are_repeated_evenly():
    ev = FEW[:5]
    drawn = np.stack([T.Points(20)(ev)[:, 2].numpy() for _ in range(COUNT)])
    assert (np.diff(drawn, axis=1) >= 0).all()
    counts = np.array([np.isclose(drawn, n / 4).sum() for n in range(5)])
    assert counts.sum() == 20 * COUNT
    assert abs(counts / counts.sum() - 0.2).max() < ERRORS * 0.4 / math.sqrt(20 * COUNT)


SEQUENCE = [scattered(n, seed=n, y=n) for n in (30, 40, 50)]


@pytest.mark.parametrize("collect", [list, tuple, lambda graphs: GraphBatch.from_graphs(graphs, volumes=3)])
@pytest.mark.parametrize(
    "transform",
    [T.RandomScale(0.5, 1.5), T.RandomRotate(40), T.RandomTranslate(3), T.RandomFlip(0), T.RandomFlip(1)],
    ids=repr,
)
def test_a_sequence_moves_as_one(transform, collect):
    """Each graph of a sequence is where it would be by itself with the same random numbers."""
    moved_somewhere = set()
    for seed in range(12):
        torch.manual_seed(seed)
        moved = transform(collect(SEQUENCE))
        graphs = moved.to_graphs() if isinstance(moved, GraphBatch) else moved
        assert len(graphs) == 3
        for graph, before in zip(graphs, SEQUENCE, strict=True):
            torch.manual_seed(seed)
            assert alike(graph, transform(before))
            moved_somewhere.add(not torch.equal(graph.pos, before.pos))
    assert True in moved_somewhere
