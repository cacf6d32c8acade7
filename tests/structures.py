"""Damage that knows how HDF5, MATLAB, NumPy and text files are built: what random bytes never make."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from lookalikes import lead_elsewhere
from numpy.lib import format as npy

Rng = np.random.Generator

NUMBERS = (0, 1, -1, 2, 127, 128, 255, 256, 32_766, 32_767, 65_535, 2**31 - 1, 2**31, 2**32 - 1, 2**32)
NUMBERS += (2**61, 2**62 - 1, 2**62, -(2**62), 2**63 - 1, 2**63, 2**64 - 1, 10**30)
MOST = 10_000  # values of a dataset that is damaged
WORDS = ("nvsdata-events", "nvsdata-store", "", "1", "nan", "-1", "1e300")


def hdf5(raw: bytes, rng: Rng, home: Path) -> bytes:
    """Links, virtual and external datasets, other storage, attributes, sizes and times of an HDF5 file.

    In `home` lie `other.h5` and `pipe`, which nothing may open.
    """
    file = io.BytesIO(raw)
    # what the library refuses to make is left as it is
    with suppress(OSError, KeyError, TypeError, ValueError, RuntimeError), h5py.File(file, "r+") as opened:
        if rng.random() < 0.5:
            # most would be refused for the times that they state
            for name in ("start", "end"):
                opened.attrs.pop(name, None)
        kinds = [_choice(rng, (*(_numbers,) * 6, _stored_anew, _attribute)) for _ in range(int(rng.integers(0, 3)))]
        # at the end: nothing here may read what lies elsewhere
        for damage in (*kinds, *([_choice(rng, (_link, _elsewhere))] if not kinds or rng.random() < 0.1 else ())):
            damage(opened, _choice(rng, _datasets(opened)), rng, home)
    return file.getvalue()


def _datasets(file: h5py.File) -> list[str]:
    """Those that aren't claimed to be huge already."""
    found: list[str] = []
    file.visititems(lambda name, item: found.append(name) if getattr(item, "size", MOST) < MOST else None)
    return found


def _link(file: h5py.File, name: str, rng: Rng, home: Path) -> None:
    """Another kind of link: to itself, to nothing, to another dataset, to a group above, to another file."""
    others = [*_datasets(file), name, "nothing", "events", "/", "."]
    whole = rng.random() < 0.2 and "/" in name
    name = name.rsplit("/", 1)[0] if whole else name
    moved = rng.random() < 0.3
    if moved:
        file.move(name, "moved")
    else:
        del file[name]
    target = "/moved" if moved else _choice(rng, others)
    if rng.random() < 0.3:
        file[name] = h5py.ExternalLink(_choice(rng, (home / "other.h5", home / "pipe", "/nothing", "")), target)
    elif target in file and rng.random() < 0.3:
        file[name] = file[target]
    else:
        file[name] = h5py.SoftLink(target)


def _elsewhere(file: h5py.File, name: str, rng: Rng, home: Path) -> None:
    """Values in another file, in this one by a detour, or nowhere; as many as there were, or far more."""
    shape, kind = file[name].shape, file[name].dtype
    shape = _choice(rng, (shape, shape, (10**9,), (2**40,)))
    del file[name]
    how = _choice(rng, ("external link", "virtual", "stored externally"))
    lead_elsewhere(file, name, how, _choice(rng, (home / "other.h5", home / "pipe", "/etc/passwd", ".")), shape, kind)


def _stored_anew(file: h5py.File, name: str, rng: Rng, home: Path) -> None:
    """Other shapes, types and chunks, compressed or not, with some of the values never written."""
    values = file[name][()]
    del file[name]
    values = np.atleast_1d(values).reshape(_choice(rng, ((-1,), (-1,), (1, -1), (-1, 1))))
    kind = values.dtype
    if kind.fields is None:
        kind = np.dtype(_choice(rng, ("u1", "i1", "u2", "i2", ">i4", "u4", "i8", ">u8", "u8", "f4", "f8", "?", "S3")))
    how: dict[str, Any] = {"dtype": kind, "shape": values.shape}
    if rng.random() < 0.6:
        how["chunks"] = tuple(min(side, int(rng.integers(1, 300))) or 1 for side in values.shape)
        how["maxshape"] = tuple(None for _ in values.shape)
        how["compression"] = _choice(rng, (None, "gzip", "lzf"))
        how["scaleoffset"] = _choice(rng, (None, None, 0)) if kind.kind in "iu" else None
        if rng.random() < 0.2:
            how["shape"] = tuple(side * int(_choice(rng, (1, 2, 10**6))) for side in values.shape)
    made = file.create_dataset(name, **how)
    if rng.random() < 0.5:
        values = values[: len(values) // 2]
    made[tuple(map(slice, values.shape))] = values.astype(kind)


def _numbers(file: h5py.File, name: str, rng: Rng, home: Path) -> None:
    """Some values changed, to extremes or to each other's."""
    times = [name for name in _datasets(file) if name.rsplit("/", 1)[-1] in ("t", "ts", "events")]
    name = _choice(rng, times) if times and rng.random() < 0.6 else name
    file[name][...] = changed(file[name][()], rng)


def changed(values: np.ndarray, rng: Rng) -> np.ndarray:
    """An array with some of its values changed: extremes, repeated stretches, stretches in the reverse order."""
    values = np.array(values)
    flat = values.reshape(-1)
    if not flat.size:
        return values
    a, b = sorted(rng.integers(0, flat.size, 2).tolist())
    kind = rng.integers(0, 4)
    if kind == 0:
        flat[a:b] = flat[a:b][::-1]
    elif kind == 1:
        flat[a : a + (b - a) // 2] = flat[a + (b - a + 1) // 2 : b] if b > a else flat[a:a]
    elif flat.dtype.names:
        field = _choice(rng, flat.dtype.names)
        flat[field] = changed(flat[field], rng)
    else:
        at = rng.integers(0, flat.size, int(rng.integers(1, 4)))
        with np.errstate(all="ignore"):
            number = np.array(_choice(rng, NUMBERS), object)
            flat[at] = (
                (int(number) & (2 ** (8 * flat.itemsize) - 1)) if flat.dtype.kind == "u" else _signed(number, flat)
            )
    return values


def _signed(number: Any, like: np.ndarray) -> Any:
    if like.dtype.kind != "i":
        return float(number) if like.dtype.kind == "f" else bool(number)
    half = 2 ** (8 * like.itemsize - 1)
    return (int(number) + half) % (2 * half) - half


def _attribute(file: h5py.File, name: str, rng: Rng, home: Path) -> None:
    """An attribute of ours, or the offset of the times, of another value or type."""
    value = _choice(rng, (*NUMBERS[:-1], 0.5, float("nan"), float("inf"), [1, 2], *WORDS, h5py.Empty("i4"), b"\xff"))
    which = _choice(rng, ("format", "version", "width", "height", "t_offset", "ms_to_idx"))
    if which in ("t_offset", "ms_to_idx"):
        if which in file:
            del file[which]
        file[which] = value
    elif rng.random() < 0.2:
        file.attrs.pop(which, None)
    else:
        file.attrs[which] = value


def matlab_file(raw: bytes, rng: Rng, home: Path) -> bytes:
    """Other values, types and shapes of a MATLAB v5 file's variables, and other variables."""
    columns = {name: c for name, c in scipy.io.loadmat(io.BytesIO(raw)).items() if not name.startswith("__")}
    for _ in range(int(rng.integers(1, 3))):
        name = _choice(rng, list(columns))
        column = changed(columns[name], rng)
        if rng.random() < 0.3:
            with np.errstate(all="ignore"):
                column = column.astype(_choice(rng, ("u1", "i2", "i4", "u4", "i8", "u8", "f4", "f8", "?")))
        columns[_choice(rng, (name, name, name, "other"))] = column.reshape(_choice(rng, ((-1, 1), (1, -1), (-1,))))
    file = io.BytesIO()
    whole = rng.random() < 0.2
    scipy.io.savemat(file, {"TD": columns} if whole else columns, do_compression=bool(rng.integers(0, 2)))
    return file.getvalue()


def npy_file(raw: bytes, rng: Rng, home: Path) -> bytes:
    """Another header of a NumPy array, and other values."""
    array = np.load(io.BytesIO(raw))
    array = changed(array, rng)
    if rng.random() < 0.5:
        columns = np.stack([array[name].astype(np.int64) for name in "xytp"], 1)
        kind = _choice(rng, ("i8", "f8", "u8", ">i8", "i4", "f4"))
        with np.errstate(all="ignore"):
            array = _choice(rng, (columns, columns.T.copy().T))[:, rng.permutation(4)].astype(kind)
    out = io.BytesIO()
    np.save(out, array)
    if rng.random() < 0.5:
        return out.getvalue()
    header = {"shape": array.shape, "fortran_order": bool(rng.integers(0, 2)), "descr": npy.dtype_to_descr(array.dtype)}
    first = _choice(rng, (*NUMBERS, None, "x"))
    header["shape"] = _choice(rng, ((first, *array.shape[1:]), (first,), (4, first), (), (first, first), "x"))
    head = io.BytesIO()
    npy.write_array_header_1_0(head, header)
    return head.getvalue() + array.tobytes()


def text_file(raw: bytes, rng: Rng, home: Path) -> bytes:
    """Numbers, lines and headers of a text file changed."""
    lines = raw.decode().splitlines()
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, len(lines)))
        number = str(_choice(rng, NUMBERS))
        kind = rng.integers(0, 6)
        if kind == 0:
            found = list(re.finditer(r"-?\d+", lines[at]))
            if found:
                a, b = found[int(rng.integers(0, len(found)))].span()
                lines[at] = lines[at][:a] + number + lines[at][b:]
        elif kind == 1:
            lines[at] = _choice(rng, ("# a comment", "", "#" * 40_000, " ", f"{number} {number}", "1 2 3", "x" * 9))
        elif kind == 2:
            lines[0] = f"# nvsdata events: x y t p, sorted, sensor {number}x{_choice(rng, NUMBERS)}"
        elif kind == 3:
            lines[0] = f"{number} {_choice(rng, NUMBERS)}"
        elif kind == 4:
            a, b = sorted(rng.integers(1, len(lines), 2).tolist())
            lines[a:b] = lines[a:b][::-1]
        else:
            lines[at:at] = lines[at : at + 900]
    return ("\r\n" if rng.random() < 0.2 else "\n").join([*lines, ""]).encode()


def _choice(rng: Rng, options: Any) -> Any:
    return options[int(rng.integers(0, len(options)))]


BY_SUFFIX: dict[str, Callable[[bytes, Rng, Path], bytes]] = {
    ".h5": hdf5,
    "v73.mat": hdf5,
    ".mat": matlab_file,
    ".npy": npy_file,
    ".txt": text_file,
}
