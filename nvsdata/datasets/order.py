"""Random orders whose elements are computed one by one, without a permutation in memory."""

from __future__ import annotations

import math

import numpy as np

ROUNDS = 8
FEW = 1_024  # largest number of elements that are sorted
# odd numbers with well-mixed bits, of SplitMix64 (Steele et al. 2014)
STEP, FIRST, SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


def shuffled(positions: np.ndarray, size: int, seed: int, epoch: int) -> np.ndarray:
    """Return the indices at some positions of a random order of 0 to `size` - 1.

    For more than 1,024 elements, the order is a Feistel network (Black and Rogaway 2002): a number below a x b has two
    digits, and in each round, a hash of one digit is added to the other. Numbers from `size` on are permuted again
    until they are below `size`. Such orders of few elements aren't uniform, so these are sorted by their hashes.

    Args:
        positions: int64 [N], each from 0 to `size` - 1.
        size: Number of elements.
        seed: Seed of the order.
        epoch: Number of the epoch; each has its own order.

    Returns:
        Indices, int64 [N].

    Example:
        >>> import numpy as np
        >>> from nvsdata.datasets.order import shuffled
        >>> sorted(shuffled(np.arange(5), 5, seed=0, epoch=0).tolist())
        [0, 1, 2, 3, 4]
    """
    keys = _keys(seed, epoch)
    if size <= FEW:
        hashes = _mixed(_mixed(np.arange(size, dtype=np.uint64) + keys[0]) + keys[1])
        chosen: np.ndarray = np.argsort(hashes, kind="stable")[positions]
        return chosen
    high = np.uint64(math.isqrt(size - 1) + 1)
    low = np.uint64(-(-size // int(high)))
    found = np.array(positions, np.uint64)
    left = np.arange(found.size)
    while left.size:
        found[left] = _permuted(found[left], high, low, keys)
        left = left[found[left] >= size]
    return found.astype(np.int64)


def random_below(bounds: np.ndarray, seed: int, epoch: int) -> np.ndarray:
    """Return a random number from 0 to below each bound, int64 [N], independent of `shuffled` with the same seed.

    Args:
        bounds: int64 [N], each at least 1.
        seed: Seed of the numbers.
        epoch: Number of the epoch; each has its own numbers.
    """
    keys = _keys(seed, epoch)
    hashes = _mixed(_mixed(np.arange(bounds.size, dtype=np.uint64) + keys[2]) + keys[3])
    return (hashes % bounds.astype(np.uint64)).astype(np.int64)


def _keys(seed: int, epoch: int) -> np.ndarray:
    return _mixed(np.uint64((int(seed) * FIRST + int(epoch) * SECOND) % 2**64) + np.arange(ROUNDS, dtype=np.uint64))


def _permuted(numbers: np.ndarray, high: np.uint64, low: np.uint64, keys: np.ndarray) -> np.ndarray:
    """Return a permutation of the numbers below `high` x `low`."""
    first, second = np.divmod(numbers, low)
    for number, key in enumerate(keys):
        if number % 2:
            second = (second + _mixed(first + key) % low) % low
        else:
            first = (first + _mixed(second + key) % high) % high
    permuted: np.ndarray = first * low + second
    return permuted


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """Return well-mixed 64-bit numbers (SplitMix64)."""
    mixed = numbers + np.uint64(STEP)
    for shift, factor in ((30, FIRST), (27, SECOND)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    return mixed ^ (mixed >> np.uint64(31))
