"""Damage to the files that nvsdata keeps and reads back, for `fuzz.py`: each kind prepares a folder and a round on it.

A round restores the sound files, damages one of those that nvsdata wrote, uses it, and says what went wrong: a result
that isn't the one without the file, another exception than those that are documented, or a file touched outside.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import struct
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import storefiles
import trees
from damage import KINDS, file_of
from fuzz import at_random, valid
from lookalikes import aedat4_bytes
from side_damage import OLD, array_changed, choice, json_changed, put_back, replaced
from structures import NUMBERS, changed, hdf5

import nvsdata
from nvsdata import EventFolder, FormatError
from nvsdata import transforms as T
from nvsdata.batch.manifest import sha256
from nvsdata.common.files import Journal, crc32, sealed
from nvsdata.common.locks import OutputInUse, is_locked, lock_path, locked
from nvsdata.datasets import source
from nvsdata.datasets.cache.encoding import ALIGNED, encode_sample
from nvsdata.datasets.store import index as store_index
from nvsdata.datasets.store import record, second, writing
from nvsdata.datasets.store.opening import open_store
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.verification import problems
from nvsdata.formats import contents, index_cache, reading
from nvsdata.kernels.recording.davis_stream import encode
from nvsdata.recording.davis.file import MARK, header
from nvsdata.recording.davis.stream import DavisDecoder

Rng = np.random.Generator
SECRET = b"a file that nothing may read or change\n" * 9
INDEXED = ("evt2", "evt3", "atis")


# indexes next to files


@contextmanager
def small_heads() -> Iterator[None]:
    """So that indexes are kept of files of more than a kB."""
    before = contents.HEAD
    contents.HEAD = reading.HEAD = 1_000
    try:
        yield
    finally:
        contents.HEAD = reading.HEAD = before


def indexed(kind: str) -> Callable[[Rng, Path], str]:
    """A round on the index of a file of a kind."""

    @small_heads()
    def round_of(rng: Rng, home: Path) -> str:
        if kind == "aedat4":
            suffix, block = ".aedat4", None
            raw = aedat4_bytes(trees.some(int(rng.integers(0, 99)), 200, (128, 128)), int(rng.integers(0, 2)))
        else:
            head, body = file_of(kind, int(rng.integers(2, 600)), rng)
            suffix, block, raw = KINDS[kind][0], int(rng.choice((16, 64))), head + bytes(body)
        folder = home / "indexed"
        put_back(folder, {f"a{suffix}": raw})
        path = folder / f"a{suffix}"
        index = index_cache.path_of(str(path))

        def opened() -> nvsdata.Recording:
            recording = nvsdata.open(path, sensor_size=(128, 128))
            if block is not None:
                recording.block = block  # type: ignore[attr-defined]
            return recording

        try:
            whole = opened().read()
        except FormatError:
            return ""
        opened().read(0, 10)
        if not index.exists():
            return "no index was kept" if len(raw) > 1_100 and kind != "aedat4" else ""
        if not replaced(index, rng, home):
            index.write_bytes(_index_changed(index.read_bytes(), rng))
        os.utime(path, ns=(OLD, OLD))
        recording = opened()
        for _ in range(6):
            edges = rng.choice(whole.t, 2) if len(whole) else np.array([0, 10])
            a, b = np.sort(edges + rng.integers(-2, 60, 2)).tolist()
            if recording.read(a, b) != whole.window(a, b):
                return f"the window [{a}, {b}) differs: {recording.read(a, b)}, {whole.window(a, b)}"
        span = (int(whole.t[0]), int(whole.t[-1])) if len(whole) else (0, 0)
        if opened().span != span:
            return f"span {opened().span}, not {span}"
        falls = recording.certainly_rises and np.any(np.diff(recording.decode().t) < 0)  # type: ignore[attr-defined]
        return "the whole differs, or falls" if falls or opened().read() != whole else ""

    return round_of


def _index_changed(raw: bytes, rng: Rng) -> bytes:
    if rng.random() < 0.3:
        return at_random(bytearray(raw), rng)
    with np.load(io.BytesIO(raw)) as kept:
        arrays = {name: kept[name] for name in kept.files}
    about, crc = arrays.pop("about"), arrays.pop("crc")
    for _ in range(int(rng.integers(1, 3))):
        name = choice(rng, list(arrays))
        if rng.random() < 0.1:
            arrays[choice(rng, (*arrays, "more"))] = arrays.pop(name)
        elif name != "ordered":
            # that a file is in order can't be compared without reading it
            arrays[name] = array_changed(arrays[name], rng)
    if rng.random() < 0.8:
        crc = np.array(index_cache._checksum(arrays))
    if rng.random() < 0.1:
        about = array_changed(about, rng)
    out = io.BytesIO()
    (np.savez if rng.random() < 0.9 else np.savez_compressed)(out, about=about, crc=crc, **arrays)
    return out.getvalue()


# a dataset's folder, its windows, cached samples


def _with_crc(content: Any) -> bytes:
    text = json.dumps(content)
    return (json.dumps([source.VERSION, crc32(text.encode())]) + "\n" + text).encode()


def _json_file_changed(path: Path, rng: Rng) -> None:
    raw = path.read_bytes()
    if rng.random() < 0.3:
        path.write_bytes(at_random(bytearray(raw), rng))
    else:
        content = json.loads(raw.partition(b"\n")[2])
        for _ in range(int(rng.integers(1, 3))):
            content = json_changed(content, rng)
        path.write_bytes(_with_crc(content))


RECORDINGS = {f"{c}/{i}.bin": trees.atis(trees.some(10 * k + i, 80)) for k, c in enumerate("ab") for i in range(1 + k)}


def listing(rng: Rng, home: Path) -> str:
    """A round on the index of a dataset's folder."""
    folder = home / "listed"
    put_back(folder, RECORDINGS | {"list.txt": b"x", "0.bin": b""})
    expected = source.Folder(folder).listing()
    index = folder / source.INDEX
    if not index.exists():
        return "no index was kept"
    if not replaced(index, rng, home):
        _json_file_changed(index, rng)
    os.utime(folder, ns=(OLD, OLD))
    found = source.Folder(folder).listing()
    return "" if found == expected else f"{found}"


def windows(rng: Rng, home: Path) -> str:
    """A round on the index of windows."""
    folder = home / "windows"
    put_back(folder, RECORDINGS)
    how = choice(rng, ({"duration": 9_000}, {"events": 17}, {"events": 20, "step": 7}))
    data = EventFolder(folder, sensor_size=(34, 34))
    expected = nvsdata.windows(data, **how).samples
    (index,) = folder.glob(source.INDEX.replace("-index.json", "-windows-*.json"))
    if not replaced(index, rng, home):
        _json_file_changed(index, rng)
    found = nvsdata.windows(data, **how)
    return "" if found.samples == expected else f"{how}: {len(found.samples)} windows, not {len(expected)}"


def cached(rng: Rng, home: Path) -> str:
    """A round on the cache of samples."""
    folder, place = home / "cached", home / "cache"
    if not folder.exists():
        put_back(folder, RECORDINGS)
    shutil.rmtree(place, ignore_errors=True)
    window = T.Window(0, 100_000)
    ways = window, T.Compose([window, T.VoxelGrid(3)]), T.Compose([window, T.RadiusGraph(radius=9)])
    transform = choice(rng, ways)
    data = nvsdata.cache(EventFolder(folder, transform=transform, sensor_size=(34, 34)), place)
    expected = data[0]
    (file,) = place.rglob("*.pt")
    sound = file.read_bytes()
    if not replaced(file, rng, home):
        file.write_bytes(at_random(bytearray(sound), rng) if rng.random() < 0.4 else _sample_changed(sound, rng))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = data[0]
    trusted = file.is_file() and file.stat().st_size < 1 << 20 and _has_checksum(file.read_bytes())
    if isinstance(found[0], nvsdata.Events):
        valid(found[0])
    nodes = found[0].edge_index if isinstance(found[0], nvsdata.Graph) else np.zeros(0)
    # kernels take features by these numbers
    if len(nodes.reshape(-1)) and not 0 <= int(nodes.min()) <= int(nodes.max()) < found[0].num_nodes:
        return f"{found[0]} has edges between nodes that it doesn't have"
    if trusted:
        return ""
    return "" if encode_sample(found[0]) == encode_sample(expected[0]) else f"{found}, not {expected}"


def _has_checksum(raw: bytes) -> bool:
    return raw.startswith(sealed(raw[len(sealed(b"")) :]))


def _sample_changed(raw: bytes, rng: Rng) -> bytes:
    """Other content, with a right checksum."""
    content = bytes(raw[len(sealed(b"")) :])
    line, rest = content.split(b"\n", 1)
    numbers = bytearray(rest[-(len(line) + 1) % ALIGNED :])
    stated = json.loads(line)
    for _ in range(int(rng.integers(0, 3))):
        stated = json_changed(stated, rng)
    if rng.random() < 0.5:
        numbers = at_random(numbers, rng)
    try:
        line = json.dumps(stated).encode() + b"\n"
    except (TypeError, ValueError, UnicodeError):
        return raw
    content = line + bytes(-len(line) % ALIGNED) + bytes(numbers)
    return sealed(content) + content


# packed stores


SECOND = [Path(__file__).with_name("datasets") / "store" / name for name in ("second.h5", "second-compressed.h5")]


def store(rng: Rng, home: Path) -> str:
    """A round on a packed store: the same events, or a FormatError."""
    folder = home / "stored"
    if not folder.exists():
        put_back(folder / "in", RECORDINGS | {"list.txt": b"x"})
        most = record.MOST_EVENTS
        for blocks, events in (("one", most), ("many", 13)):
            record.MOST_EVENTS = events
            for compress in (False, True):
                data = EventFolder(folder / "in", sensor_size=(34, 34))
                nvsdata.pack(data, folder / f"{blocks}-{compress}", compress=compress)
        record.MOST_EVENTS = most
    sound = folder / f"{choice(rng, ('one', 'many'))}-{bool(rng.integers(0, 2))}"
    path = home / "store.nvs"
    path.unlink(missing_ok=True)
    path.write_bytes(sound.read_bytes())
    checked = rng.random() < 0.7
    _damage(path, rng, checked=checked)
    return _same_or_refused(path, None if checked else Store(sound), rng)


def _damage(path: Path, rng: Rng, *, checked: bool) -> None:
    """Random damage to a store or, if `checked`, other content with right checksums."""
    if not checked:
        path.write_bytes(at_random(bytearray(path.read_bytes()), rng))
        return
    for _ in range(int(rng.integers(1, 3))):
        # what can't be written, or is no store any more, stays as it is
        with suppress(ValueError, TypeError, OverflowError, IndexError, KeyError, struct.error):
            _store_changed(path, rng)


def _same_or_refused(path: Path, sound: Store | None, rng: Rng) -> str:
    """Return the fault of a store's answers, compared with those of a sound one if there is one."""
    try:
        found = open_store(path)
        listing = found.listing()
    except FormatError:
        return ""
    for name in found.names[:4]:
        try:
            recording = found.open(name, None)
            whole = recording.read()
        except FormatError:
            continue
        valid(whole)
        _ = recording.format, found.size(name), found.stamp(name), found.content(name)
        if not found.fault(name) and recording.span != (whole.t[0], whole.t[-1]):
            return f"span {recording.span} of {name}, not {whole.t[[0, -1]]}"
        if not all(-(2**62) < time < 2**62 for time in (*recording.span, recording.start, recording.end)):
            return f"{name} is from {recording.start} to {recording.end}"
        for _ in range(4):
            edges = rng.choice(whole.t, 2) if len(whole) and rng.random() < 0.7 else rng.integers(-10, 300_000, 2)
            a, b = np.sort(edges + rng.integers(-2, 60, 2)).tolist()
            if recording.read(a, b) != whole.window(a, b):
                return f"the window [{a}, {b}) of {name} differs"
        if sound is not None and whole != sound.open(name, None).read():
            return f"{name} differs"
    for name in [name for name in listing.get(".", []) if name in found._files][:3]:
        content = found.data(name)
        if sound is not None and content != sound.data(name):
            return f"{name} differs: {content!r}"
    return ""


def _store_changed(path: Path, rng: Rng) -> None:
    """One of a store's parts changed, with right checksums."""
    found = storefiles.index_of(path)
    number, kind = int(rng.integers(0, len(found["name"]))), int(rng.integers(0, 6))
    if kind == 0:
        name = choice(rng, store_index.SECTIONS)
        if name == "facts":
            storefiles.reindex(path, json_changed(storefiles.facts_of(found), rng))
        elif name == "file_data":
            storefiles.reindex(path, file_data=at_random(bytearray(found[name]), rng))
        else:
            is_text = name in store_index.TEXTS
            changes = json_changed(found[name], rng) if is_text else array_changed(found[name].astype(np.uint64), rng)
            storefiles.reindex(path, **{name: changes})
    elif kind == 1:
        raw = path.read_bytes()
        place, length, _ = store_index.index_place(raw[: store_index.BEGIN], len(raw))
        storefiles.put_index(path, at_random(bytearray(raw[place : place + length]), rng))
    elif kind == 2:
        raw = path.read_bytes()
        place, length, check = store_index.index_place(raw[: store_index.BEGIN], len(raw))
        numbers = [place, length, check]
        numbers[int(rng.integers(0, 3))] = int(
            choice(rng, (0, 8, 63, 64, place + 8, length + 8, len(raw), 2**63, 2**64 - 1))
        )
        own = struct.pack("<QQI", *numbers[:2], numbers[2] % 2**32).ljust(store_index.BEGIN - 16, b"\0")
        head = raw[:8] + struct.pack("<II", store_index.VERSION, storefiles.check_of(own)) + own
        path.write_bytes(head + raw[store_index.BEGIN :])
    elif kind == 3:
        _, head, _ = storefiles.head_at(path, number)
        name = choice(rng, storefiles.FIELDS[1:])
        new = (
            rng.bytes(16)
            if name == "format"
            else int(choice(rng, (*NUMBERS, head[name] - 1, head[name] + 1, head[name] - 9)))
        )
        storefiles.put_head(path, number, **{name: new})
    elif kind == 4:

        def other(table: np.ndarray) -> None:
            name = choice(rng, table.dtype.names)
            table[name] = changed(table[name], rng)

        storefiles.put_head(path, number, other)
    else:
        _, _, table = storefiles.head_at(path, number)

        def some(raw: bytearray) -> bytearray:
            if rng.random() < 0.5:
                at = int(rng.integers(0, len(raw)))
                raw[at] = int(choice(rng, (0, 1, raw[at] ^ 1, 0x7F, 0x80, 0xFF)))
                return raw
            return bytearray(at_random(raw[:], rng)[: len(raw)].ljust(len(raw), b"\0"))

        storefiles.put_block(path, number, int(rng.integers(0, len(table))), some)


def joined_store(rng: Rng, home: Path) -> str:
    """A round on joined shards: the same events or a FormatError, and `join` writes what can be opened, or nothing."""
    folder, sound = home / "joined", home / "sound-shards"
    if not sound.exists():
        put_back(home / "to-join", RECORDINGS | {"list.txt": b"x"})
        sound.mkdir()
        nvsdata.join(storefiles.packed(home / "to-join", sound / "a.nvs", 2), sound / "a.nvs")
    put_back(folder, {path.name: path.read_bytes() for path in sound.iterdir()})
    shards = sorted(folder.glob("a-*"))
    changed, checked = choice(rng, (folder / "a.nvs", *shards)), rng.random() < 0.7
    if changed not in shards or not replaced(changed, rng, home):
        _damage(changed, rng, checked=checked)
    found = _same_or_refused(folder / "a.nvs", None if checked else Store(sound / "a.nvs"), rng)
    try:
        nvsdata.join(shards, folder / "b.nvs")
    except (OSError, ValueError):
        return found
    Store(folder / "b.nvs")  # what is joined can be opened
    return found or _same_or_refused(folder / "b.nvs", None, rng)


def second_store(rng: Rng, home: Path) -> str:
    """A round on a packed store of the second layout."""
    path, sound = home / "store.h5", choice(rng, SECOND)
    raw, kind = sound.read_bytes(), rng.integers(0, 4)
    if kind == 0:
        raw = at_random(bytearray(raw), rng)
    elif kind == 1:
        raw = hdf5(raw, rng, home)
    else:
        raw = _second_changed(raw, rng)
    path.unlink(missing_ok=True)
    path.write_bytes(raw)
    return _same_or_refused(path, open_store(sound) if kind < 2 else None, rng)


def _second_changed(raw: bytes, rng: Rng) -> bytes:
    """Arrays of the index changed, with a right checksum."""
    file = io.BytesIO(raw)
    with h5py.File(file, "r+") as opened:
        for _ in range(int(rng.integers(1, 3))):
            name = f"index/{choice(rng, second.INDEX)}"
            array = array_changed(opened[name][()], rng)
            attributes = dict(opened[name].attrs)
            del opened[name]
            opened.create_dataset(name, data=array).attrs.update(attributes)
        arrays = {name: opened[f"index/{name}"][()] for name in second.INDEX}
        opened.attrs["checksum"] = second.checksum(arrays)
    return file.getvalue()


def packing(rng: Rng, home: Path) -> str:
    """A round on the progress of a packing run that was killed."""
    folder, out = home / "packing", home / "packed.nvs"
    part = out.with_name(f".{out.name}.part")
    if not folder.exists():
        put_back(folder, RECORDINGS | {"list.txt": b"x"})
    compress = bool(rng.integers(0, 2))
    data = EventFolder(folder, sensor_size=(34, 34))
    out.unlink(missing_ok=True)
    shutil.rmtree(part, ignore_errors=True)
    finish = writing._finish
    writing._finish = _killed
    try:
        with suppress(KeyboardInterrupt), redirect_stderr(io.StringIO()):
            nvsdata.pack(data, out, compress=compress)
    finally:
        writing._finish = finish
    for path in [part / name for name in ("data", "journal.jsonl") if rng.random() < 0.7]:
        if replaced(path, rng, home):
            continue
        raw = path.read_bytes()
        if path.name == "data" or rng.random() < 0.3:
            path.write_bytes(at_random(bytearray(raw), rng))
        else:
            lines = raw.splitlines()
            at = int(rng.integers(0, len(lines)))
            with suppress(ValueError, TypeError):
                lines[at] = json.dumps(json_changed(json.loads(lines[at]), rng)).encode()
            path.write_bytes(b"\n".join(lines) + b"\n" * int(rng.integers(0, 2)))
    odd = any(path.is_symlink() or (path.exists() and not path.is_file()) for path in part.iterdir())
    odd = odd or any(path.exists() and path.stat().st_size > 1 << 28 for path in part.iterdir())
    try:
        with redirect_stderr(io.StringIO()):
            nvsdata.pack(data, out, compress=compress)
    except OSError as error:
        return "" if odd and not out.exists() else f"{error}"
    found = EventFolder(out)
    same = found.samples == data.samples and all(found[i][0] == data[i][0] for i in range(len(data)))
    return "" if same and not part.exists() else "the store differs from its dataset"


def _killed(*_: object) -> None:
    raise KeyboardInterrupt


# manifests, journals, locks


def manifest(rng: Rng, home: Path) -> str:
    """A round on a folder's manifest: `nvsdata verify` reports faults, and raises nothing."""
    folder = home / "made"
    put_back(folder, RECORDINGS)
    lines: list[Any] = [{"nvsdata-videos": 1, "settings_sha256": "0", "videos": [f"{n}.avi" for n in RECORDINGS]}]
    lines += [
        {"video": f"{n}.avi", "file": n, "status": "done", "recording": len(c), "recording_sha256": sha256(folder / n)}
        for n, c in RECORDINGS.items()
    ]
    path = folder / "manifest.jsonl"
    sound_raw = "".join(json.dumps(line) + "\n" for line in lines).encode()
    for _ in range(int(rng.integers(0, 3))):
        at = int(rng.integers(0, len(lines)))
        lines[at] = json_changed(lines[at], rng)
    raw = "".join(json.dumps(line) + "\n" for line in lines).encode()
    path.write_bytes(at_random(bytearray(raw), rng) if rng.random() < 0.3 else raw)
    replaced(path, rng, home)
    broken = choice(rng, list(RECORDINGS))
    sound = (folder / broken).read_bytes()
    (folder / broken).write_bytes(sound[:-5] + b"\1\2\3\4\5")
    faults = [(str(name), str(fault)) for name, fault in problems(folder, counts=Counter())]
    lied = path.is_symlink() or not path.is_file() or path.stat().st_size != len(sound_raw)
    lied = lied or path.read_bytes() != sound_raw
    return "a changed recording isn't reported" if not (faults or lied) else ""


def journal(rng: Rng, home: Path) -> str:
    """A round on a journal of lines that is read and added to again."""
    path = home / "journal.jsonl"
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    path.unlink(missing_ok=True)
    lines = [{"head": 1}, {"video": "a", "n": [1, 2]}, {"video": "b"}]
    raw = "".join(json.dumps(line) + "\n" for line in lines).encode()
    path.write_bytes(at_random(bytearray(raw), rng))
    replaced(path, rng, home)
    try:
        with Journal(path, {"head": 1}) as opened:
            before = list(opened.lines)
            opened.add({"video": "c"})
        again = Journal(path, {})
    except OSError as error:
        return "" if path.is_symlink() or not path.is_file() or path.stat().st_size > 1 << 30 else f"{error}"
    return "" if again.lines == [*before, {"video": "c"}] or not before else f"{again.lines}, not {before} and c"


def davis(rng: Rng, home: Path) -> str:
    """A round on what `nvsdata record` keeps of a camera's stream."""
    ev = trees.some(int(rng.integers(0, 99)), int(rng.integers(1, 300)), (240, 180), gap=int(rng.choice((30, 9_000))))
    words = np.zeros(8 * len(ev) + 4_000, np.uint16)
    count = encode(*ev.columns, np.array([0, -1, -1]), words[1:])
    words[0] = 1
    head = header(DavisDecoder(240, 180, steady=True), choice(rng, (None, 10**6)), {"camera": "DAVIS240C"})
    if rng.random() < 0.4:
        result = json_changed(json.loads(head[len(MARK) :]), rng)
        head = MARK + json.dumps(result).encode() + b"\n"
    body = words[: count + 1].copy()
    some = rng.integers(0, len(body), int(rng.integers(0, 6)))
    body[some] = rng.integers(0, 1 << 16, some.size) if rng.random() < 0.5 else rng.integers(0, 20, some.size)
    raw = head + body.tobytes()
    path = home / "a.davis"
    path.write_bytes(at_random(bytearray(raw), rng) if rng.random() < 0.4 else raw)
    for strict in (True, False):
        try:
            recording = nvsdata.open(path, strict=strict)
            whole = recording.read()
            valid(whole)
            a, b = sorted(rng.integers(-10, 300_000, 2).tolist())
            if nvsdata.read(path, a, b, strict=strict) != whole.window(a, b):
                return f"strict={strict}: the window [{a}, {b}) differs"
            _ = recording.end, [frame.t for frame in recording.frames()], recording.inertial()
        except FormatError:
            continue
    return ""


def lock(rng: Rng, home: Path) -> str:
    """A round on a lock file that is there already."""
    output = home / "output.h5"
    place = lock_path(output)
    if place.is_dir() and not place.is_symlink():
        place.rmdir()
    place.unlink(missing_ok=True)
    entry = {"owner": f"abcdef-{rng.integers(1, 9)}", "host": "a", "pid": 1, "command": "c", "since": "s"}
    raw = json.dumps(json_changed(entry, rng)).encode()
    place.write_bytes(at_random(bytearray(raw), rng) if rng.random() < 0.5 else raw)
    replaced(place, rng, home)
    try:
        is_locked(output)
        with locked(output):
            if not is_locked(output):
                return "isn't locked while it is"
    except (OutputInUse, FileExistsError):
        pass
    except OSError as error:
        return "" if place.is_symlink() else f"{type(error).__name__}: {error}"
    return ""


_ROUNDS: dict[str, Callable[[Rng, Path], str]] = {f"index of {kind}": indexed(kind) for kind in (*INDEXED, "aedat4")}
_ROUNDS |= {"index of a folder": listing, "index of windows": windows, "cache": cached}
_ROUNDS |= {
    "store": store,
    "store of joined shards": joined_store,
    "store of the second layout": second_store,
    "packing": packing,
}
_ROUNDS |= {"manifest": manifest, "journal": journal, ".davis": davis, "lock": lock}
ROUNDS = {f"side file: {name}": how for name, how in _ROUNDS.items()}


def prepare(home: Path) -> None:
    """What nothing may touch; indexes are kept of small files that were changed just now."""
    (home / "secret").write_bytes(SECRET)
    index_cache.LEAST, index_cache.SETTLED_NS = 0, 0
    source.MANY_FILES = 2


def attempt(number: int, name: str, home: Path) -> str:
    """A round of that kind; what went wrong, if anything."""
    try:
        fault = ROUNDS[name](np.random.default_rng(number), home)
    except Exception as error:
        fault = f"{type(error).__name__}: {error}"
    if (home / "secret").read_bytes() != SECRET:
        (home / "secret").write_bytes(SECRET)
        fault += " and a file outside was changed"
    return fault
