import numpy as np

from nvsdata.kernels.emulate.crossings import NEVER, Array, Sensor, advance
from nvsdata.kernels.emulate.frames import TILE

LEAK = 1e-6


def test_a_tile_wakes_when_memory_of_its_own_pixels_has_leaked_far_enough():
    level = np.repeat([[0.0, 0.1, 0.05]], TILE[1], axis=1).repeat(TILE[0] + 1, axis=0)
    level[TILE[0], 70] = 0.15
    none, dark = np.empty(0), np.zeros(level.shape, np.uint8)
    sensor = Sensor(none, 0, np.array([0.2, 0.2]), none, LEAK, 0.0)
    dirty, since = np.zeros((2, 3), bool), np.zeros((2, 3), np.int64)
    array = Array(np.zeros_like(level), np.zeros_like(level), none, none, dirty, since + NEVER, since)
    assert advance(dark + 1, dark, 0, level, sensor, array, 0, 1, np.empty(9, np.uint64))[1] == 0
    highest = np.array([[0.0, 0.1, 0.05], [0.0, 0.15, 0.05]])
    np.testing.assert_allclose(array.wake, (0.2 - highest) / LEAK, atol=2)
