"""Tiles and pixels that PIX2NVS touches: as many as changed, not as many as there are."""

import numpy as np
import pytest

from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.kernels import _native
from nvsdata.video.frames import VideoFrame

counted = pytest.mark.skipif(not _native.checks_bounds, reason="only the build that checks indices counts them")

ROWS, COLUMNS, TILE = 4, 4, (8, 64)
PIXELS = TILE[0] * TILE[1]
KINDS = {
    "plain": {},
    "last frame": {"exp": False},
    "only fired": {"new": False},
    "mismatch": {"mismatch": 0.1},
    "doubles": {"threshold": 0.04},
    "fours": {"inhibition": 4},
    "pairs": {"inhibition": 2},
    "threes": {"inhibition": 3},
    "contrast": {"mode": "CE", "threshold": 5.0},
    "logarithm of contrast": {"mode": "LICE", "t_log": 1},
    "average": {"difference": "average"},
    "minimum": {"difference": "minimum"},
}
ALONE = list(KINDS)[:7]  # pixels, or blocks within a tile, don't look at other tiles
AROUND = list(KINDS)[7:]
BANDS = ["plain", "threes", "contrast", "minimum"]
MOST_HALVINGS = 30  # of a difference until the reference, of 24 bits, no longer moves
MARKS = 16  # looks at a tile's marks in a frame
FEW = 24  # touches of a pixel of an active tile in a frame
EVENTS = 4  # touches of an event
CAUGHT_UP = 3.2  # touches of a pixel in an omitted step


def gray(rows=ROWS, columns=COLUMNS):
    """A picture without contrast, which every setting may leave alone."""
    return np.full((rows * TILE[0], columns * TILE[1]), 100, np.uint8)


def then(frame, rows, columns, more):
    """The frame with other brightness at some places."""
    frame = frame.copy()
    frame[rows, columns] += np.uint8(more)
    return frame


STILL = gray()
PIXEL = then(STILL, TILE[0] + 3, TILE[1] + 30, 100)
BAND = then(STILL, slice(0, TILE[0]), slice(None), 100)
ONE = [STILL] * 3 + [PIXEL] + [STILL] * 3


def steps(settings, frames):
    """Of each frame after the first: active tiles, how many fired, and touched elements besides frames and marks."""
    emulator = PIX2NVSState(PIX2NVS(**settings), VideoFrame(0, frames[0]))
    aside = frames[0].size + MARKS * emulator._tiles.dirty.size
    taken = []
    for k, frame in enumerate(frames[1:], 1):
        _ = _native.checks_bounds and _native.touched()
        fired = emulator.step(VideoFrame(1000 * k, frame)).keys.size
        touched = _native.touched() - aside if _native.checks_bounds else 0
        taken.append((np.argwhere(emulator._tiles.active).tolist(), fired, touched))
    return taken


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_visited_for_a_still_frame(kind):
    # the first one is seen as a whole: nothing is known of it before
    first, (active, fired, touched) = steps(KINDS[kind], ONE)[:2]
    assert len(first[0]) == ROWS * COLUMNS
    assert (active, fired) == ([], 0)
    # the bytes are compared once, and that is all
    assert touched <= 0


@pytest.mark.parametrize("kind", ALONE)
def test_one_changed_pixel_costs_its_tile(kind):
    active, fired, touched = steps(KINDS[kind], ONE)[2]
    assert fired
    assert active == [[1, 1]]
    # its row of tiles is compared again, tile by tile
    assert touched <= FEW * PIXELS


@pytest.mark.parametrize("kind", AROUND)
def test_one_changed_pixel_costs_its_tile_and_those_around_it(kind):
    around = [[row, column] for row in (0, 1, 2) for column in (0, 1, 2)]
    taken = steps(KINDS[kind], ONE)[2:]
    for active, _, touched in taken:
        assert all(tile in around for tile in active)
        assert touched <= len(active) * FEW * PIXELS
    assert [1, 1] in taken[0][0]


@pytest.mark.parametrize("kind", ["plain", "last frame", "only fired", "pairs", "fours"])
def test_a_tile_rests_again_once_it_cannot_fire(kind):
    taken = steps(KINDS[kind], ONE)[2:]
    assert [fired > 0 for _, fired, _ in taken].count(True) <= 3
    assert not taken[-1][0]


@pytest.mark.parametrize("kind", BANDS)
def test_a_changed_band_costs_as_many_tiles_as_it_touches(kind):
    active, fired, touched = steps(KINDS[kind], [STILL] * 2 + [BAND])[-1]
    rows = {row for row, _ in active}
    assert rows == {0} if kind in ALONE else {0} <= rows <= {0, 1}
    assert touched <= len(active) * FEW * PIXELS + EVENTS * fired


def paused(pause):
    """The last two frames of a tile that pauses between two changes, the first of them slight."""
    small = gray(1, 2)
    faint = then(small, slice(None), slice(0, 64), 6)
    return steps({}, [small] * 2 + [faint] * (pause + 2) + [then(faint, 3, 3, 60)])[-2:]


@counted
def test_catching_up_takes_no_more_steps_than_were_omitted():
    usual = paused(0)[1][2]
    before, (_, _, touched) = paused(3)
    assert not before[0]
    assert 2 * CAUGHT_UP * PIXELS < touched - usual <= 3 * CAUGHT_UP * PIXELS


@counted
def test_catching_up_stops_when_nothing_moves():
    usual = paused(0)[1][2]
    before, (_, _, touched) = paused(60)
    assert not before[0]
    assert 10 * CAUGHT_UP * PIXELS < touched - usual <= MOST_HALVINGS * CAUGHT_UP * PIXELS
    # a tile whose reference is there already: one look, and the step
    small = gray(1, 2)
    rested = steps({}, [small] * 60 + [then(small, 3, 3, 60)])[-1]
    assert rested[2] <= usual + CAUGHT_UP * PIXELS
