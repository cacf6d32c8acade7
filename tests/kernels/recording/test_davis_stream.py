"""Arguments that the decoder of a camera's stream refuses."""

import numpy as np
import pytest

from nvsdata.kernels.recording import davis_stream as kernel

WIDTH, HEIGHT = 6, 4
SETTING = [WIDTH, HEIGHT, WIDTH, HEIGHT, 0, 0, 0, 2, 1]
EVENT = 0x2001


def arguments(words=(EVENT,)):
    n = len(words)
    return {
        "words": np.array(words, np.uint16),
        "start": 0,
        "state": np.zeros(kernel.STATES, np.int64),
        "error_counts": np.zeros(kernel.ERRORS, np.int64),
        "setting": np.array(SETTING, np.int64),
        "pixels": np.zeros(WIDTH * HEIGHT, np.uint16),
        "t": np.empty(n, np.int64),
        "x": np.empty(n, np.int16),
        "y": np.empty(n, np.int16),
        "p": np.empty(n, np.uint8),
        "specials": np.empty((4, 4), np.int64),
        "samples": np.empty((4, 12), np.int64),
    }


@pytest.mark.parametrize("name", ["state", "error_counts", "setting", "pixels", "t", "x", "y", "p"])
def test_arrays_that_are_too_short(name):
    given = arguments()
    assert kernel.decode(**given)[:2] == (1, 1)
    with pytest.raises(ValueError, match=r"room for an event|another decoder|no decoder has"):
        kernel.decode(**given | {name: given[name][:-1].copy()})


@pytest.mark.parametrize("name", ["specials", "samples"])
def test_tables_of_another_width(name):
    given = arguments()
    with pytest.raises(ValueError, match="another decoder"):
        kernel.decode(**given | {name: given[name][:, 1:].copy()})


@pytest.mark.parametrize("start", [-1, 2, 1 << 62])
def test_a_start_outside(start):
    with pytest.raises(ValueError, match="room for an event"):
        kernel.decode(**arguments() | {"start": start})


@pytest.mark.parametrize("value", [-(1 << 63), -1, 1 << 20, (1 << 63) - 1])
@pytest.mark.parametrize("name", ["state", "setting"])
def test_any_value_of_a_state_or_a_setting_is_harmless(name, value):
    words = [0x0008, 0x000B, 0x4001, 0x5101, 0x5202, 0x5203, 0x5204, 0x5205, 0x000D, 0x000C, 0x4002, 0x000A]
    words += [0x0005, 0x53E0, *[0x5001] * 14, 0x0007, 0x8001, 0x7FFF, EVENT]
    for at in range(arguments()[name].size):
        given = arguments(words)
        given[name][at] = value
        try:
            assert kernel.decode(**given)[0] == len(words)
        except ValueError as error:
            assert "no decoder has" in str(error)  # noqa: PT017


def test_outputs_without_room_end_it_at_once():
    given = arguments([1, 1])
    assert kernel.decode(**given | {"specials": np.empty((0, 4), np.int64)}) == (0, 0, 0, 0, False)
    assert kernel.decode(**given | {"specials": np.empty((1, 4), np.int64)}) == (1, 0, 1, 0, False)


def test_measures_of_other_shapes():
    rows, three = np.zeros((2, 12), np.int64), np.empty((2, 3), np.float32)
    kernel.measure(rows, 0, 340, 35, three, three.copy(), np.empty(2, np.float32))
    with pytest.raises(ValueError, match="different shapes"):
        kernel.measure(rows, 0, 340, 35, three, three.copy(), np.empty(1, np.float32))


def test_a_frame_as_wide_as_can_be_is_decoded_in_parts():
    side = 0xFFFF
    # a region of one row, then a frame of it with a reset column
    words = [0x5100, 0x5200, 0x5200, 0x51FF, 0x52FE, 0x5100, 0x5200, 0x0008, 0x000B]
    given = arguments(words) | {"pixels": np.zeros(side, np.uint16)}
    given["setting"][2:4] = side, 1
    assert kernel.decode(**given)[0] == len(words)
    assert side in given["state"]
    assert kernel.decode(**given | {"words": np.array([0x000D, EVENT], np.uint16)})[:2] == (2, 1)
