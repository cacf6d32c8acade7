"""Records of Prophesee's .dat files against a slow decoder."""

from itertools import pairwise

import numpy as np
import pytest

from nvsdata.kernels.decode.clock import FELL, LAST, NEXT, UNKNOWN, clock_at, nearest_time
from nvsdata.kernels.decode.dat import dat_decode

FAR = 32_767  # beyond any place


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("size", [(FAR, FAR), (304, 240), (1, 1)])
def test_dat_records_decode_as_a_slow_decoder_does(version, size):
    rng = np.random.default_rng(2)
    for n in (0, 1, 2, 3, 8, 20) * 5:
        last = int(rng.choice((0, 90_000, 2**32 - 30, 2**31 + 5, 3 * 2**32 - 9)))
        t = last + np.cumsum(rng.choice((0, 1, 9, 40, -4), n, p=(0.2, 0.4, 0.2, 0.1, 0.1)))
        t = np.sort(t) if rng.random() < 0.7 else t
        x, y, p = rng.integers(0, min(size[0], 304), n), rng.integers(0, min(size[1], 240), n), rng.integers(0, 2, n)
        if n and rng.random() < 0.4:
            at = rng.integers(n)
            x[at], y[at] = ((min(size[0], 400), 0), (0, min(size[1], 300)), (304, 239))[rng.integers(3)]
        if version == 1:
            y = y & 0xFF
            address = p << 17 | y << 9 | x
        else:
            p[rng.random(n) < 0.03] = rng.choice((2, 8, 15))
            address = p << 28 | y << 14 | x
        raw = np.stack([t % 2**32, address], 1).astype("<u4").view(np.uint8).ravel()
        # a first word in the first wrap needs no time before it
        known = last > 2**31 or n == 0 or t[0] < last
        state, columns = (
            clock_at(last if known else UNKNOWN, 50),
            [np.zeros(n + 2, c) for c in (np.int64, np.int16, np.int16, np.uint8)],
        )
        found = dat_decode(raw, 4, version, *size, state, 1, *columns)
        bad = (p > 1) | (x >= size[0]) | (y >= size[1])
        assert found == (n, int(bad.argmax()) if bad.any() else -1)
        when = []
        for word in (t % 2**32).tolist():
            when.append(int(nearest_time(word, when[-1] if when else last, 32)))
        assert [column[1 : n + 1].tolist() for column in columns] == [when, x.tolist(), y.tolist(), p.tolist()]
        falls = any(b < a for a, b in pairwise([last, *when]))
        assert state[[LAST, NEXT, FELL]].tolist() == [when[-1] if when else last, 50 + n, falls]
        assert [column[-1] for column in columns] == [0] * 4
