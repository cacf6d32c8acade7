"""Precomputed samples for other libraries that stream data, written by these libraries."""

from __future__ import annotations

import os
import shutil
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from nvsdata.common.locks import locked
from nvsdata.common.progress import bar
from nvsdata.datasets.cache.encoding import encode_sample
from nvsdata.datasets.indexing import check_choice

SHARD = 256 << 20  # bytes of a file


def hand_over(samples: Any, engine: str, out: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write samples as a folder for another library; see `Precomputed.hand_over`."""
    check_choice("engine", engine, tuple(ENGINES))
    try:
        module = import_module(engine)
    except ImportError:
        raise ImportError(f"{engine} isn't installed: pip install 'nvsdata[{engine}]'") from None
    target = Path(out).expanduser()
    if os.path.lexists(target) and not overwrite:
        raise FileExistsError(f"{target} already exists: --overwrite (in Python overwrite=True) replaces it")
    part = target.with_name(f".{target.name}.part")
    # the lock is next to the folder, because one within it would be replaced together with it
    with locked(target.with_name(f"{target.name}.part")):
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        ENGINES[engine](module, samples, part)
        if target.is_dir() and not target.is_symlink():
            shutil.rmtree(target)
        os.replace(part, target)


def _to_webdataset(webdataset: Any, samples: Any, folder: Path) -> None:
    numbers = bar(range(len(samples)), "writing", unit="sample")
    with webdataset.ShardWriter(str(folder / "%06d.tar"), maxcount=len(samples), maxsize=SHARD, verbose=0) as writer:
        for number in numbers:
            content, label = _encoded(samples, number).values()
            writer.write({"__key__": f"{number:09d}", "nvs": content, "cls": str(label)})


def _to_litdata(litdata: Any, samples: Any, folder: Path) -> None:
    work, numbers = partial(_encoded, samples), list(range(len(samples)))
    litdata.optimize(fn=work, inputs=numbers, output_dir=str(folder), chunk_bytes=SHARD, num_workers=1)


def _encoded(samples: Any, number: int) -> dict[str, Any]:
    """Return the bytes and the label of a sample."""
    stored = samples.stored(number)
    return {"sample": encode_sample(stored), "label": samples.targets[number]}


ENGINES = {"webdataset": _to_webdataset, "litdata": _to_litdata}
