"""What the assembly of frames returns and refuses; `formats/test_aedat2_samples.py` tests it on files."""

import numpy as np
import pytest

from nvsdata.kernels.decode.aedat_frames import FRAME_FACTS, next_frame

HEIGHT, WIDTH = 2, 3


def arrays():
    shape = HEIGHT, WIDTH
    kept = [np.zeros(shape, kind) for kind in (np.uint16, np.uint16, np.uint8)]
    return [*kept, np.zeros(FRAME_FACTS, np.int64)]


def readings(kind):
    return [x << 12 | y << 22 | kind << 10 | (900 - 300 * kind) for x in range(WIDTH) for y in range(HEIGHT)]


def test_a_frame_ends_with_the_next_one_or_a_call_without_records():
    addresses = np.array(2 * (readings(0) + readings(1)), np.uint32)
    t = np.arange(addresses.size)
    kept = arrays()
    assert next_frame(addresses, t, 0, *kept) == (12, True)
    assert kept[3][:8].tolist() == [0, 5, 6, 11, 0, 0, WIDTH - 1, HEIGHT - 1]
    assert (kept[1] == 300).all()
    assert next_frame(addresses, t, 12, *kept) == (24, False)
    assert next_frame(addresses[:0], t[:0], 0, *kept) == (0, True)
    assert next_frame(addresses[:0], t[:0], 0, *kept) == (0, False)


def test_records_outside_the_sensor_are_left_out():
    addresses = np.array([WIDTH << 12, HEIGHT << 22, 0xFFFFFFFF, 0x3FF << 12], np.uint32)
    kept = arrays()
    assert next_frame(addresses, np.arange(4), 0, *kept) == (4, False)
    assert not any(array.any() for array in kept)


def test_arrays_that_do_not_fit_are_refused():
    addresses, t = np.zeros(2, np.uint32), np.arange(2)
    with pytest.raises(ValueError, match="address and a time"):
        next_frame(addresses, t[:1], 0, *arrays())
    for at in (-1, 3):
        with pytest.raises(ValueError, match="address and a time"):
            next_frame(addresses, t, at, *arrays())
    for number in range(4):
        kept = arrays()
        kept[number] = kept[number][1:].copy()
        with pytest.raises(ValueError, match=r"different sensors|another decoder"):
            next_frame(addresses, t, 0, *kept)
