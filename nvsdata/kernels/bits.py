"""Sets of numbers, as bits of words: they come out in order without being sorted."""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from nvsdata.kernels.compiling import njit

SHIFT, _LOW = np.uint64(6), np.uint64(63)  # of a word of 64 numbers, and of 64 words


@intrinsic
def trailing_zeros(typing, word):
    """Place of the lowest bit of a word that isn't 0."""

    def code(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), code


@njit
def bit_sets(count, end):
    """Empty sets of numbers below `end`, uint64 [count, words], and the words that any of them uses, uint64."""
    words = (end >> 6) + 1
    return np.zeros((count, words), np.uint64), np.zeros((words >> 6) + 1, np.uint64)


@njit
def mark(number, marked, used):
    """Put a number, uint64, into a set."""
    one = np.uint64(1)
    word = number >> SHIFT
    marked[word] |= one << (number & _LOW)
    used[word >> SHIFT] |= one << (word & _LOW)


@njit
def ascending(marked, used, out):
    """List the numbers of a set in `out`, ascending, and return what of it is filled. O(numbers + end / 4096)."""
    one = np.uint64(1)
    n = np.uint64(0)
    for group in range(np.uint64(used.size)):
        words = used[group]
        while words:
            word = (group << SHIFT) | trailing_zeros(words)
            words &= words - one
            bits = marked[word]
            while bits:
                out[n] = (word << SHIFT) | trailing_zeros(bits)
                bits &= bits - one
                n += one
    return out[:n]
