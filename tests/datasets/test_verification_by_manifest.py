"""Folders that `convert-videos` made, compared with their manifests."""

from __future__ import annotations

import json
import os
from collections import Counter

import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata.cli import main
from nvsdata.datasets.verification import problems
from nvsdata.emulation.convert import convert_videos


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("converted")
    for name in ("run/a", "run/b", "walk/a", "walk/b"):
        write_video(folder / f"in/{name}.avi", moving_square(8, (64, 48), len(name)))
    convert_videos(folder / "in", folder / "out")
    return {path.relative_to(folder / "out"): path.read_bytes() for path in (folder / "out").rglob("*.*")}


@pytest.fixture
def out(converted, tmp_path):
    for name, content in converted.items():
        (tmp_path / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "out" / name).write_bytes(content)
    return tmp_path / "out"


def manifest(out, change):
    """Change the lines of the manifest."""
    path = out / "manifest.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    path.write_text("".join(json.dumps(line) + "\n" for line in change(lines)))


def test_a_sound_folder_says_how_many_recordings_were_opened_and_compared(out, capsys):
    assert main(["verify", str(out)]) == 0
    assert capsys.readouterr().out == "4 recordings opened, 4 compared with their manifest: no faults\n"
    assert main(["verify", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"faults": 0, "splits": {}, "opened": 4, "compared": 4, "guessed": 0}


def test_one_flipped_byte(out, capsys):
    raw = bytearray((out / "run/b.h5").read_bytes())
    raw[-1] ^= 1
    (out / "run/b.h5").write_bytes(raw)
    assert main(["verify", str(out)]) == 1
    assert "run/b.h5: was changed: its sha256 differs from its manifest's\n" in (text := capsys.readouterr().out)
    assert text.endswith(" faults\n")


def test_a_deleted_and_a_shorter_recording_and_one_that_is_not_known(out):
    (out / "run/a.h5").unlink()
    raw = (out / "walk/b.h5").read_bytes()
    (out / "walk/b.h5").write_bytes(raw[:-1])
    nvsdata.write(nvsdata.example(), out / "walk/mine.h5")
    counts = Counter()
    found = dict(problems(out, counts=counts))
    assert found["run/a.h5"] == "is missing"
    assert found["walk/mine.h5"] == "is in no manifest of its folder"
    assert "walk/b.h5" in found
    assert (f"has {len(raw) - 1:,} bytes, not the {len(raw):,} of its manifest") in [
        fault for name, fault in problems(out) if name == "walk/b.h5"
    ]
    assert counts == {"opened": 4, "compared": 4}


def test_a_run_that_ended_early_and_videos_that_failed(out):
    def change(lines):
        head, first, second, *_ = lines
        failed = {"video": first["video"], "file": first["file"], "status": "failed", "reason": "no frames"}
        return [head, failed, second]

    manifest(out, change)
    (out / "walk/a.h5").unlink()
    (out / "walk/b.h5").unlink()
    assert dict(problems(out)) == {
        "run/a.avi": "failed: no frames",
        "run/a.h5": "is in no manifest of its folder",
        "walk/a.avi": "has no recording: the run ended before it was reached",
        "walk/b.avi": "has no recording: the run ended before it was reached",
    }


def test_shards_and_folders_below_have_their_own_manifests(out, tmp_path):
    above = out.rename(tmp_path / "above" / "out") if (tmp_path / "above").mkdir() is None else out
    convert_videos_in_shards(above, tmp_path)
    (tmp_path / "above/shards/run/0.h5").unlink()
    assert list(problems(tmp_path / "above")) == [("shards/run/0.h5", "is missing")]


def convert_videos_in_shards(above, tmp_path):
    for name in ("0", "1"):
        write_video(tmp_path / f"more/run/{name}.avi", moving_square(8, (64, 48)))
    for shard in ((1, 2), (2, 2)):
        convert_videos(tmp_path / "more", above.with_name("shards"), shard=shard)


def test_a_manifest_names_nothing_outside_its_folder_and_may_be_nonsense(out, tmp_path):
    (tmp_path / "secret.h5").write_bytes((out / "run/a.h5").read_bytes())
    manifest(out, lambda lines: [lines[0], lines[1] | {"file": "../secret.h5"}, *lines[2:]])
    found = list(problems(out))
    assert ("run/a.avi", "its manifest names a recording outside the folder: '../secret.h5'") in found
    # another program's file
    (out / "manifest.jsonl").write_text('{"files": []}\n')
    assert list(problems(out)) == []


def test_lists_and_notes_are_no_recordings_and_folders_within_have_their_own_manifest(out, tmp_path):
    (out / "notes.txt").write_text("hello\n")
    (out / "labels.csv").write_text("name,label\na,1\n")
    assert list(problems(out)) == []
    # the folder that was made first lies within another one
    outer = tmp_path / "outer"
    convert_videos_in_shards(outer / "x", tmp_path)
    out.rename(outer / "shards/train")
    counts = Counter()
    assert list(problems(outer / "shards", counts=counts)) == []
    assert counts == {"opened": 6, "compared": 6}


def test_a_class_folder_on_another_disk(out, tmp_path):
    (out / "walk").rename(tmp_path / "elsewhere")
    (out / "walk").symlink_to(tmp_path / "elsewhere")
    assert list(problems(out)) == []


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: [lines[0] | {"videos": 5}, *lines[1:]],
        lambda lines: [lines[0], lines[1] | {"recording": "12"}, *lines[2:]],
        lambda lines: [lines[0], lines[1] | {"file": "walk/a\0.h5"}, *lines[2:]],
        lambda lines: [lines[0], lines[1] | {"file": "walk"}, *lines[2:]],
        lambda lines: [lines[0], {"status": "converted"}, *lines[2:]],
        lambda lines: [lines[0], lines[1] | {"file": 7}, *lines[2:]],
    ],
)
def test_a_malformed_manifest_is_a_fault_and_the_recordings_are_opened(out, change):
    manifest(out, change)
    counts = Counter()
    assert list(problems(out, counts=counts))
    assert counts["opened"] == 4


def test_a_pipe_or_a_link_in_the_place_of_a_manifest_is_a_fault(out, tmp_path):
    (out / "manifest.jsonl").rename(tmp_path / "moved.jsonl")
    (out / "manifest.jsonl").symlink_to(tmp_path / "moved.jsonl")
    assert dict(problems(out))["manifest.jsonl"].startswith("can't be read: is a link")
    (out / "manifest.jsonl").unlink()
    os.mkfifo(out / "manifest.jsonl")
    assert dict(problems(out))["manifest.jsonl"].startswith("can't be read: isn't a regular file")


def test_without_a_sha256_nothing_is_said_to_be_changed(out):
    manifest(out, lambda lines: [{k: v for k, v in line.items() if k != "recording_sha256"} for line in lines])
    assert set(dict(problems(out)).values()) == {"can't be compared: its manifest has no sha256 of it"}


@pytest.mark.parametrize("field", ["recording", "file", "videos"])
@pytest.mark.parametrize("value", ["x", 7, None, [1], {}, "a\0b", "\ud800", "run", "x" * 300, "run/a.h5/b"])
def test_a_manifest_with_other_values_is_reported(out, field, value):
    def change(lines):
        lines[0 if field == "videos" else 1][field] = value
        return lines

    manifest(out, change)
    found = list(problems(out))
    assert found or field == "videos"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")
def test_a_manifest_that_is_no_file_is_reported(out):
    (out / "manifest.jsonl").unlink()
    os.mkfifo(out / "manifest.jsonl")
    assert [name for name, fault in problems(out) if "can't be read" in fault] == ["manifest.jsonl"]
