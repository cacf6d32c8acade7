"""Manifests of a folder of recordings: one for all videos, or one for each shard of the videos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nvsdata.batch.manifest import NAME, Manifest, files_of
from nvsdata.common.files import Journal, claimed, sweep
from nvsdata.common.locks import OutputInUse, is_locked, locked

OF_SHARD = "manifest-{}-of-{}.jsonl"
ANY = OF_SHARD.format("*", "*")


@contextmanager
def open_manifest(
    out: Path,
    kind: str,
    made: dict[str, Any],
    videos: Sequence[str],
    *,
    shard: tuple[int, int] | None,
    overwrite: bool,
) -> Iterator[Manifest]:
    """Open the manifest of a folder, or of a shard of it, for a run.

    A run for the entire folder moves the lines of its shards' manifests to the manifest of the folder.

    Args:
        out: Folder of recordings.
        kind: Kind of the folder; see `Manifest`.
        made: Settings that all recordings share.
        videos: Names of the run's videos.
        shard: Shard (i, n), or None for the entire folder.
        overwrite: Whether to start a new manifest; its attribute `replaced` has the recordings of the old manifest.

    Raises:
        OutputInUse: Another process makes the same recordings.
        ValueError: A shard has other settings.
    """
    if shard is None:
        with claimed(out):
            for lock in out.glob(f".{ANY}.lock"):
                if is_locked(out / lock.name[1:].removesuffix(".lock")):
                    raise OutputInUse(f"{out} is being written by the process of {lock.name}")
            shards = [Journal(path, {}) for path in sorted(out.glob(ANY))]
            lines = [line for one in (*shards, Journal(out / NAME, {})) for line in one.lines]
            before = files_of(lines, out) if overwrite else {}
            if overwrite:
                for path in (out / NAME, *(one.path for one in shards)):
                    path.unlink(missing_ok=True)
                shards = []
            manifest = Manifest(out, kind, made, videos)
            _check(shards, manifest)
            with manifest:
                manifest.replaced = before
                for one in shards:
                    for line in one.lines:
                        manifest.add(line)
                    one.path.unlink()
                yield manifest
        return
    if overwrite:
        reason = "other processes may have made the recordings"
        raise ValueError(f"overwrite can't be combined with shards, because {reason}: use another folder")
    name = OF_SHARD.format(*shard)
    with locked(out / name):
        if is_locked(out):
            raise OutputInUse(f"{out} is being written by a process without shards")
        _check_count(out, shard)
        sweep(out)
        manifest = Manifest(out, kind, made, videos, name=name)
        # the manifests of other shards, and that of the folder from before it was divided
        others = [Journal(path, {}) for path in (*sorted(out.glob(ANY)), out / NAME) if path.exists()]
        _check(others, manifest)
        with manifest:
            done = next((one for one in others if one.path.name == NAME), None)
            if done is not None:
                manifest.videos = {line["video"]: line for line in done.lines} | manifest.videos
            yield manifest


def _check_count(out: Path, shard: tuple[int, int]) -> None:
    """Raise OutputInUse or ValueError if the folder was divided into another number of shards, which would overlap."""
    own = OF_SHARD.format("*", shard[1])
    locks = (out / lock.name[1:].removesuffix(".lock") for lock in out.glob(f".{ANY}.lock"))
    for path in sorted({*out.glob(ANY), *locks}):
        if path.match(own):
            continue
        part = "{}/{}".format(*path.stem.removeprefix("manifest-").split("-of-"))
        given = "{}/{}".format(*shard)
        if is_locked(path):
            raise OutputInUse(f"{out} is being written by shard {part}, which overlaps with {given}: use the same N")
        if path.exists():
            joined = "use the same N, or run once without shards, which joins them and continues"
            raise ValueError(f"{out} has the recordings of shard {part}, which overlaps with {given}: {joined}")


def _check(others: list[Journal], manifest: Manifest) -> None:
    """Raise ValueError if one of the `others` has other settings than `manifest`."""
    for one in others:
        if one.head.get("settings_sha256") not in (None, manifest.head["settings_sha256"]):
            raise ValueError(f"{one.path} has recordings made with other settings: choose another folder")
