"""The logarithm of (3.1) in float32, eight pixels at a time."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

_U, _U32, _F = np.uint64, np.uint32, np.float32
_ROOT_HALF, _ONE = 0x3F3504F3, 0x3F800000  # bits of the square root of a half, and of 1
_TO_ONE, _FRACTION = _U32(_ONE - _ROOT_HALF), _U32((1 << 23) - 1)
# ln 2 in two parts, the first so short that its products with exponents are exact
_LN2, _LN2_REST = _F(0.693359375), _F(-2.12194440e-4)
# ln(1 + f) = f - f^2 / 2 + f^3 (c3 + c4 f + ...), fitted to 7e-9 where 1 + f lies between the roots of 1/2 and 2
_C3, _C4, _C5, _C6, _C7, _C8, _C9 = (
    _F(c) for c in (0.33334166, -0.25001699, 0.19954875, -0.16564426, 0.14977995, -0.14379008, 0.08672184)
)


@njit
def logarithm(thousandths, t_log, slope, scratch, out):
    """`out` = ln q where q > t_log, else slope q, of brightness q in thousandths, (3.1); off by at most 4e-7.

    The result is the same on every machine. `scratch` uint32 [2, at least N].
    """
    n = _U(out.size)
    exponent, bits = scratch[0], scratch[1]
    part = bits.view(np.float32)
    limit = _F(1000) * t_log  # compared in thousandths, which are whole numbers: (3.1) jumps at t_log
    # one loop per step, so that each is vectorized
    for i in range(n):
        part[i] = _F(thousandths[i]) * _F(0.001)
    for i in range(n):
        # q = part 2^(exponent - 127), part between the roots
        moved = _U32(bits[i] + _TO_ONE)
        exponent[i] = moved >> _U32(23)
        bits[i] = _U32((moved & _FRACTION) + _U32(_ROOT_HALF))
    for i in range(n):
        f = part[i] - _F(1)
        e = _F(np.int32(exponent[i])) - _F(127)
        tail = ((((((_C9 * f + _C8) * f + _C7) * f + _C6) * f + _C5) * f + _C4) * f + _C3) * f * (f * f)
        value = f + (tail + e * _LN2_REST - _F(0.5) * (f * f)) + e * _LN2
        q = _F(thousandths[i])
        out[i] = value if q > limit else q * _F(0.001) * slope
