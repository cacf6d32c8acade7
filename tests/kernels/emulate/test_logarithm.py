import numpy as np
import pytest

from nvsdata.kernels.emulate.frames import logarithm
from nvsdata.kernels.emulate.pix2nvs import TABLE_SIZE

F = np.float32


def of(thousandths, t_log=0, slope=1):
    out = np.empty(thousandths.size, F)
    logarithm(thousandths, t_log, slope, out)
    return out


def test_error_is_as_small_as_it_says_for_every_brightness_of_bytes():
    thousandths = np.arange(1, TABLE_SIZE, dtype=np.int32)
    assert np.abs(of(thousandths) - np.log(thousandths / 1000)).max() < 4e-7


@pytest.mark.parametrize("t_log", [0, 0.5, 20])
def test_below_t_log_it_is_linear(t_log):
    thousandths = np.arange(0, 30_000, 7, dtype=np.int32)
    q = (thousandths / 1000).astype(F)
    expected = np.where(q > t_log, np.log(np.maximum(q, 1e-9)), F(0.3) * q)
    np.testing.assert_allclose(of(thousandths, t_log, 0.3), expected, rtol=1e-6, atol=4e-7)


def test_a_value_does_not_depend_on_its_place():
    thousandths = np.random.default_rng(0).integers(0, TABLE_SIZE, 1_000).astype(np.int32)
    alone = np.concatenate([of(thousandths[i : i + 1]) for i in range(thousandths.size)])
    for begin in range(9):
        assert (of(thousandths[begin:]) == alone[begin:]).all()
    assert (of(thousandths.astype(F)) == alone).all()


@pytest.mark.parametrize("t_log", [1.5, 20, 0.3, 1.1])
def test_t_log_itself_is_on_the_linear_side(t_log):
    at = round(1000 * t_log)
    below, above = of(np.array([at, at + 1], np.int32), t_log)
    assert below == pytest.approx(t_log)
    assert above == pytest.approx(np.log((at + 1) / 1000), abs=4e-7)


def test_the_result_has_the_size_of_what_is_given():
    with pytest.raises(ValueError, match="differ in shape"):
        logarithm(np.zeros(3, np.int32), 0, 1, np.zeros(2, F))
    of(np.zeros(0, np.int32))
