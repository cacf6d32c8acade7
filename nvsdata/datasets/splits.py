"""Random splits that depend on names alone, and a digest that identifies a split."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from hashlib import blake2b

Halves = tuple[list[int], list[int]]  # indices of recordings for training, and of the others


def stratified(recordings: Sequence[tuple[str, str]], test: float = 0.2, seed: int = 0) -> Halves:
    """Split recordings randomly into training and testing, with the same fraction of each class.

    The names of a class are ranked by a hash of seed, class and name. The first `test` times their number (rounded)
    are for testing. So the order of `recordings` makes no difference, and adding or removing a recording
    changes the split of at most one other recording, of the same class. Recordings with the same class and name are
    ranked in the given order.

    Args:
        recordings: (class, name) of each recording.
        test: fraction of each class for testing, between 0 and 1.
        seed: seed of the random split.

    Returns:
        Two sorted lists of indices: for training and for testing.

    Raises:
        ValueError: unless 0 < test < 1.

    Example:
        >>> from nvsdata.datasets import stratified
        >>> train, test = stratified([("cat", str(i)) for i in range(10)])
        >>> len(train), len(test)
        (8, 2)
    """
    if not 0 < test < 1:
        raise ValueError(f"test must be between 0 and 1, not {test}")

    def ranked(group: str, members: list[int]) -> list[int]:
        begun = blake2b(f"{seed}\0{group}\0".encode("utf-8", "surrogatepass"), digest_size=8)
        digests = {index: _digest_with(begun, recordings[index][1]) for index in members}
        return sorted(members, key=digests.__getitem__)

    return _first_of_each_class(recordings, test, ranked)


def held_out(recordings: Sequence[tuple[str, str]], fraction: float) -> Halves:
    """Hold out a fraction of the recordings for validation, by a hash of class and name.

    The hash of a recording alone decides whether it is held out, so adding or removing others makes no difference to
    it. The held-out fraction is therefore only approximate: about `fraction` of each class.

    Args:
        recordings: (class, name) of each recording.
        fraction: approximate fraction to hold out, between 0 and 1.

    Returns:
        Two sorted lists of indices: of the remaining recordings, and of the recordings held out.

    Raises:
        ValueError: unless 0 < fraction < 1, or if a class would be left without recordings in either part.

    Example:
        >>> from nvsdata.datasets.splits import held_out
        >>> rest, validation = held_out([("cat", str(i)) for i in range(1000)], 0.1)
        >>> len(rest), len(validation)
        (911, 89)
    """
    _check_fraction(fraction)
    parts: Halves = [], []
    for index, (group, name) in enumerate(recordings):
        begun = blake2b(f"{group}\0".encode("utf-8", "surrogatepass"), digest_size=8)
        parts[int.from_bytes(_digest_with(begun, name), "big") < fraction * 2**64].append(index)
    return _with_all_classes(recordings, fraction, parts)


def held_out_last(recordings: Sequence[tuple[str, str]], fraction: float) -> Halves:
    """Hold out the last recordings of each class, in order of name, for validation.

    Arguments, returned lists and errors are those of `held_out`, but the fraction is exact, up to rounding.

    Example:
        >>> from nvsdata.datasets.splits import held_out_last
        >>> held_out_last([("cat", "3"), ("cat", "1"), ("cat", "2")], 0.3)
        ([1, 2], [0])
    """
    _check_fraction(fraction)

    def ranked(_: str, members: list[int]) -> list[int]:
        return sorted(members, key=lambda index: recordings[index][1], reverse=True)

    return _with_all_classes(recordings, fraction, _first_of_each_class(recordings, fraction, ranked))


def _first_of_each_class(
    recordings: Sequence[tuple[str, str]], fraction: float, ranked: Callable[[str, list[int]], list[int]]
) -> Halves:
    """Hold out the first indices of each class, as `ranked` orders the class: `fraction` of them, rounded."""
    classes: dict[str, list[int]] = {}
    for index, (group, _) in enumerate(recordings):
        classes.setdefault(group, []).append(index)
    held = bytearray(len(recordings))
    for group, members in classes.items():
        for index in ranked(group, members)[: math.floor(len(members) * fraction + 0.5)]:
            held[index] = True
    return [index for index, out in enumerate(held) if not out], [index for index, out in enumerate(held) if out]


def _check_fraction(fraction: float) -> None:
    if not 0 < fraction < 1:
        raise ValueError(f"the fraction for validation must be between 0 and 1, not {fraction}")


def _with_all_classes(recordings: Sequence[tuple[str, str]], fraction: float, parts: Halves) -> Halves:
    """Return the parts. ValueError if one of them has no recordings of a class."""
    for part, use in zip(parts, ("training", "validation"), strict=True):
        if missing := {group for group, _ in recordings} - {recordings[index][0] for index in part}:
            raise ValueError(
                f"a validation fraction of {fraction:g} leaves no recordings of {', '.join(sorted(missing))} for {use}"
            )
    return parts


def _digest_with(begun: blake2b, name: str) -> bytes:
    """Return the digest of the bytes hashed so far with a name appended."""
    complete = begun.copy()
    complete.update(name.encode("utf-8", "surrogatepass"))
    return complete.digest()


def split_hash(samples: Iterable[tuple[str, str, int]]) -> str:
    """Return 16 hex digits that identify the (class, name, label) of samples, independent of their order."""
    # no file name contains a zero byte; bytes that aren't UTF-8 are surrogates in it
    lines = sorted(f"{group}\0{name}\0{label}\0" for group, name, label in samples)
    return blake2b("".join(lines).encode("utf-8", "surrogatepass"), digest_size=8).hexdigest()
