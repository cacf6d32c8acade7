"""The manifest of a folder of recordings that one process makes, or several, each a shard of the videos."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nvsdata.common.files import Journal, claimed, sweep
from nvsdata.common.locks import OutputInUse, is_locked, locked
from nvsdata.video.manifest import NAME, Manifest

OF_SHARD = "manifest-{}-of-{}.jsonl"


@contextmanager
def manifest_of(
    out: Path, kind: str, made: dict[str, Any], *, shard: tuple[int, int] | None, overwrite: bool
) -> Iterator[Manifest]:
    """The manifest of a folder, or of a shard (i, n) of it; see `Manifest`.

    The manifest of a whole folder takes over what those of its shards say. With `overwrite` it begins anew.
    OutputInUse if another process makes the same recordings.
    """
    if shard is None:
        with claimed(out):
            shards = sorted(out.glob(OF_SHARD.format("*", "*")))
            for path in shards:
                if is_locked(path):
                    raise OutputInUse(f"{out} is being written by the process of {path.name}")
            if overwrite:
                (out / NAME).unlink(missing_ok=True)
            with Manifest(out, kind, made) as manifest:
                for path in shards:
                    _join(manifest, path, keep=not overwrite)
                yield manifest
        return
    if is_locked(out):
        raise OutputInUse(f"{out} is being written by a process that does all of it")
    name = OF_SHARD.format(*shard)
    with locked(out / name):
        sweep(out)
        if overwrite:
            (out / name).unlink(missing_ok=True)
        with Manifest(out, kind, made, name=name) as manifest:
            # what was done before the folder was made in shards
            if (out / NAME).exists() and not overwrite:
                manifest.videos = Manifest(out, kind, made).videos | manifest.videos
            yield manifest


def _join(manifest: Manifest, path: Path, *, keep: bool) -> None:
    """Take over the lines of a shard's manifest, if it was made with the same settings, and remove it."""
    shard = Journal(path, {})
    if keep and shard.head.get("settings_sha256") != manifest.head["settings_sha256"]:
        raise ValueError(f"{path} is of recordings made with other settings: choose another folder")
    for line in shard.lines if keep else ():
        manifest.add(line)
    path.unlink()
