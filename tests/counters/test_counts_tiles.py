"""Tiles and pixels that PIX2NVS touches: as many as changed, not as many as there are.

Run as a script by the fixture `counts`, without compiled kernels, so that arrays can count what is read and written.
"""

import json
from collections import Counter

import numpy as np
import pytest
from counting_work import uncompiled, watched

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


def steps(settings, frames, of=("plane", "reference")):
    """What each frame after the first takes: active tiles, and how often pixels `of` some arrays were read, written."""
    from nvsdata.emulation.emulator import Emulator
    from nvsdata.emulation.pix2nvs import PIX2NVS
    from nvsdata.kernels.emulate.tiles import Pixels
    from nvsdata.video.frames import Frame

    tally = Counter()
    seen = [watched(frame, "frame", tally) if "frame" in of else frame for frame in frames]
    shown = [Frame(1000 * k, frame) for k, frame in enumerate(seen)]
    emulator = Emulator(PIX2NVS(**settings), shown[0])
    named = zip(Pixels._fields, emulator._pixels, strict=True)
    emulator._pixels = Pixels(*(watched(array, name, tally) if name in of else array for name, array in named))
    taken = []
    for frame in shown[1:]:
        tally.clear()
        fired = emulator.step(frame).keys.size
        active = np.argwhere(emulator._tiles.active).tolist()
        counts = {f"{name} {what}": count for (name, what), count in tally.items()}
        taken.append(counts | {"active": active, "fired": fired})
    return taken


def gray(rows=ROWS, columns=COLUMNS):
    """A picture without contrast, which every setting may leave alone."""
    return np.full((rows * TILE[0], columns * TILE[1]), 100, np.uint8)


def then(frame, rows, columns, more):
    """The frame with other brightness at some places."""
    frame = frame.copy()
    frame[rows, columns] += np.uint8(more)
    return frame


def work():
    """All counts, by scenario and kind of settings."""
    still = gray()
    pixel = then(still, TILE[0] + 3, TILE[1] + 30, 100)
    band = then(still, slice(0, TILE[0]), slice(None), 100)
    one = [still] * 3 + [pixel] + [still] * 3
    found = {"one": {kind: steps(settings, one) for kind, settings in KINDS.items()}}
    found["band"] = {kind: steps(KINDS[kind], [still] * 2 + [band]) for kind in BANDS}
    found["bytes"] = {"plain": steps({}, one, ["frame", "plane", "level", "reference", "difference"])}
    small = gray(1, 2)
    faint = then(small, slice(None), slice(0, 64), 6)
    for name, pause in (("long", 60), ("short", 3)):
        found[name] = {"faint": steps({}, [small] * 2 + [faint] * (pause + 2) + [then(faint, 3, 3, 60)])}
    found["rest"] = {"alike": steps({}, [small] * 60 + [then(small, 3, 3, 60)])}
    return found


@pytest.fixture(scope="module")
def counts():
    return uncompiled(__file__)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_visited_for_a_still_frame(counts, kind):
    # the first one is seen as a whole: nothing is known of it before
    first, second = counts["one"][kind][:2]
    assert len(first["active"]) == ROWS * COLUMNS
    assert second == {"active": [], "fired": 0}


def test_bytes_of_a_still_frame_are_compared_once_and_that_is_all(counts):
    assert counts["bytes"]["plain"][1] == {"frame read": 2 * ROWS * COLUMNS * PIXELS, "active": [], "fired": 0}


def test_bytes_of_a_frame_are_compared_once_except_in_the_row_of_tiles_that_changed(counts):
    # a row is compared as a whole until a change is found, then again tile by tile; a tile that changed not any more
    compared = ROWS * COLUMNS * PIXELS + COLUMNS * TILE[1] - 4 * TILE[1]
    looked_up = PIXELS
    assert counts["bytes"]["plain"][2]["frame read"] == 2 * compared + looked_up


@pytest.mark.parametrize("kind", ALONE)
def test_one_changed_pixel_costs_its_tile(counts, kind):
    changed = counts["one"][kind][2]
    assert changed["fired"]
    assert changed["active"] == [[1, 1]]
    assert changed["plane written"] == PIXELS
    # one look at whether anything moved meanwhile, and the step
    assert changed["reference written"] <= 2 * PIXELS


def test_differences_are_taken_in_active_tiles_only(counts):
    step = counts["bytes"]["plain"][2]
    assert step["difference written"] == PIXELS


@pytest.mark.parametrize("kind", AROUND)
def test_one_changed_pixel_costs_its_tile_and_those_around_it(counts, kind):
    around = [[row, column] for row in (0, 1, 2) for column in (0, 1, 2)]
    for step in counts["one"][kind][2:]:
        assert all(tile in around for tile in step["active"])
        assert step.get("reference written", 0) <= 2 * len(step["active"]) * PIXELS
    changed = counts["one"][kind][2]
    assert [1, 1] in changed["active"]
    assert changed["plane written"] == PIXELS


@pytest.mark.parametrize("kind", ["plain", "last frame", "only fired", "pairs", "fours"])
def test_a_tile_rests_again_once_it_cannot_fire(counts, kind):
    assert [step["fired"] > 0 for step in counts["one"][kind][2:]].count(True) <= 3
    assert not counts["one"][kind][-1]["active"]


@pytest.mark.parametrize("kind", BANDS)
def test_a_changed_band_costs_as_many_tiles_as_it_touches(counts, kind):
    step = counts["band"][kind][-1]
    rows = {row for row, _ in step["active"]}
    assert rows == {0} if kind in ALONE else {0} <= rows <= {0, 1}
    assert step["reference written"] <= 2 * len(step["active"]) * PIXELS
    assert step["plane written"] == COLUMNS * PIXELS


def test_catching_up_takes_no_more_steps_than_were_omitted(counts):
    paused, back = counts["short"]["faint"][-2:]
    assert not paused["active"]
    # four omitted steps and the new one
    assert back["reference written"] == 5 * PIXELS


def test_catching_up_stops_when_nothing_moves(counts):
    paused, back = counts["long"]["faint"][-2:]
    assert not paused["active"]
    assert 10 * PIXELS < back["reference written"] <= MOST_HALVINGS * PIXELS
    # a tile whose reference is there already: one look, and the step
    assert counts["rest"]["alike"][-1]["reference written"] == 2 * PIXELS


if __name__ == "__main__":
    np.seterr(all="ignore")
    print(json.dumps(work()))
