"""Names in a store's index, by plain Python."""

import numpy as np
import pytest

from nvsdata.kernels import _native
from nvsdata.kernels.decode.names import find_name, folders_of_names, name_table, sort_names

ALPHABET = [b"a", b"b", b"/", b"-", b"\xff", b"\x01", b"0"]


def arrays(names):
    raw = np.frombuffer(b"".join(name + b"\0" for name in names), np.uint8)
    return raw, np.flatnonzero(raw == 0).astype(np.uint32)


def random_names(seed, count):
    rng = np.random.default_rng(seed)
    made = {b"".join(rng.choice(ALPHABET, rng.integers(0, 12))) for _ in range(count)}
    return list(rng.permutation(np.array(sorted(made), object)))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 50, 2_000])
def test_each_name_is_found_and_no_other(count):
    names = random_names(count, count)
    raw, ends = arrays(names)
    slots = name_table(raw, ends)
    assert [find_name(raw, ends, slots, name) for name in names] == list(range(len(names)))
    others = {name + b"a" for name in names} | {b"none"}
    assert {find_name(raw, ends, slots, name) for name in others - set(names)} <= {-1}


def test_equal_names_are_noticed():
    names = [b"a/0", b"b", b"", b"a/1"]
    assert name_table(*arrays(names)) is not None
    for name in names:
        assert name_table(*arrays([*names, name])) is None


@pytest.mark.parametrize("seed", range(5))
def test_folders_are_what_precedes_the_last_slash(seed):
    names = random_names(seed, 300)
    folders, members = folders_of_names(*arrays(names))
    paths = [name.rpartition(b"/")[0] for name in names]
    order = list(dict.fromkeys(paths))
    assert [order[folder] for folder in folders] == paths
    assert members.tolist() == [paths.index(folder) for folder in order]


@pytest.mark.parametrize("by_file", [False, True])
@pytest.mark.parametrize("prefix", [b"", b"a/b/a_common_beginning_"])
@pytest.mark.parametrize("seed", range(5))
def test_names_are_sorted(seed, by_file, prefix):
    names = [prefix + name for name in random_names(seed, 400)]
    rng = np.random.default_rng(seed)
    some = rng.permutation(len(names))[: len(names) // 2].astype(np.uint32)
    file = lambda name: name.rpartition(b"/")[2]  # noqa: E731
    expected = sorted(some.tolist(), key=lambda n: (file(names[n]), names[n]) if by_file else names[n])
    sort_names(*arrays(names), some, by_file=by_file)
    assert some.tolist() == expected
    sort_names(*arrays(names), some, by_file=by_file)
    assert some.tolist() == expected


def test_what_is_no_table_finds_nothing_or_is_refused():
    raw, ends = arrays([b"a", b"b", b"c"])
    full = np.full(8, 2**32 - 1, np.uint32)
    assert find_name(raw, ends, full, b"a") == -1
    assert find_name(raw, ends[::-1].copy() * 100, np.ones(4, np.uint32), b"a") == -1
    for size in (0, 3, 5, 6):
        with pytest.raises(ValueError, match="power of two"):
            find_name(raw, ends, np.zeros(size, np.uint32), b"a")


@pytest.mark.parametrize("wrong", [[3, 1], [1, 1], [1, 99], [-1, 3]])
def test_names_end_one_after_the_other(wrong):
    raw = np.zeros(6, np.uint8)
    with pytest.raises(ValueError, match="one after the other"):
        _native.folders_of_names(raw, np.array(wrong).astype(np.uint32), np.zeros(2, np.uint32))
