"""What a full disk does to every writer: an error, and nothing in place; never a file that lacks something."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from clips import moving_square, write_video
from disks import PAGE, file_limit, small_disk

import nvsdata
from nvsdata import Events
from nvsdata.cli import main
from nvsdata.common.files import Journal, atomic

SUFFIXES = (".h5", ".txt", ".aedat1", ".aedat", ".aedat3", ".npy", ".bin", ".dat")
CHUNKED = "chunks.h5"


@pytest.fixture(scope="module")
def events():
    rng = np.random.default_rng(0)
    n = 3_000
    return Events(
        np.sort(rng.integers(0, 10**6, n)), rng.integers(0, 120, n), rng.integers(0, 120, n), rng.integers(0, 2, n)
    )


def tried(events, path):
    """Whether writing went well; in either case nothing but a whole file is there."""
    refused = None
    try:
        nvsdata.write(events, path)
    except OSError as error:
        refused = error.filename
    assert refused in (None, str(path))
    assert path.exists() == (refused is None)
    assert not list(path.parent.glob(".*"))
    if path.exists():
        found = nvsdata.read(path, sensor_size=events.sensor_size)
        assert np.array_equal(found.t, events.t)
        assert np.array_equal(found.p, events.p)
        path.unlink()
        return True
    return False


def small_chunks(monkeypatch):
    from nvsdata.formats.hdf5 import writer as hdf5_writer

    monkeypatch.setattr(hdf5_writer, "CHUNK", 512)
    monkeypatch.setattr(hdf5_writer, "CONTIGUOUS", 2)


@pytest.fixture(params=[*(f"a{suffix}" for suffix in SUFFIXES), CHUNKED])
def name_and_size(request, tmp_path, events, monkeypatch):
    """A file of each format, and how large it is if nothing is in the way."""
    if request.param == CHUNKED:
        small_chunks(monkeypatch)
    path = tmp_path / request.param
    nvsdata.write(events, path)
    size = path.stat().st_size
    path.unlink()
    return request.param, size


def test_files_may_not_grow_any_more(tmp_path, events, name_and_size):
    name, size = name_and_size
    outcomes = []
    for limit in [*range(0, size, PAGE // 2), size - 1, size, size + PAGE]:
        with file_limit(limit):
            outcomes.append(tried(events, tmp_path / name))
    # from nothing to enough: it fails, then it works
    assert outcomes == sorted(outcomes)
    assert not outcomes[0]
    assert outcomes[-2:] == [True, True]


def test_a_disk_that_is_full(tmp_path, events, name_and_size):
    name, size = name_and_size
    with small_disk(tmp_path / "disk") as resize:
        outcomes = []
        for room in range(PAGE, size + 16 * PAGE, PAGE):
            resize(room)
            outcomes.append(tried(events, tmp_path / "disk" / name))
    assert outcomes == sorted(outcomes)
    assert outcomes[-1]


def test_an_older_file_stays_as_it_was(tmp_path, events):
    nvsdata.write(events[:100], tmp_path / "a.h5")
    with file_limit(PAGE), pytest.raises(OSError, match="large"):
        nvsdata.write(events, tmp_path / "a.h5")
    assert nvsdata.read(tmp_path / "a.h5") == events[:100]


def test_plain_files_and_journals(tmp_path):
    with Journal(tmp_path / "j.jsonl", {"a": 1}) as journal:
        journal.add({"b": 1})
    with file_limit(40):
        with pytest.raises(OSError, match="large"), atomic(tmp_path / "a") as temporary:
            temporary.write_text("x" * 100)

        def fills_up():
            with Journal(tmp_path / "j.jsonl", {"a": 1}) as journal:
                for number in range(10):
                    journal.add({"c": number})

        with pytest.raises(OSError, match="large"):
            fills_up()
    assert not (tmp_path / "a").exists()
    # the line that was torn is left out, those before it are there
    with Journal(tmp_path / "j.jsonl", {}) as journal:
        assert journal.head == {"a": 1}
        assert journal.lines == [{"b": 1}, {"c": 0}, {"c": 1}][: len(journal.lines)]
        assert len(journal.lines) >= 2


def test_the_process_ends_as_it_should(tmp_path, events):
    """HDF5's library used to end it in a segmentation fault."""
    nvsdata.write(events, tmp_path / "a.aedat")
    code = (
        "import resource, sys; from nvsdata.cli import main;"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({2 * PAGE}, {2 * PAGE}));"
        f"sys.exit(main(['convert', {str(tmp_path / 'a.aedat')!r}, {str(tmp_path / 'b.h5')!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.strip().count("\n") == 0
    assert "too large" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.aedat"]


COMMANDS = {
    "convert": ["convert", "{0}/a.h5", "{1}/b.aedat4"],
    "view": ["view", "{0}/a.h5", "{1}/b.html"],
    "view an image": ["view", "{0}/a.h5", "{1}/b.png"],
    "view a film": ["view", "{0}/a.h5", "{1}/b.mp4"],
    "gallery": ["gallery", "{0}/in", "{1}/b.html"],
    "pack": ["pack", "{0}/in", "--dataset", "folder", "--out", "{1}/b.h5"],
    "precompute": ["precompute", "{0}/in", "--dataset", "folder", "--transform", "VoxelGrid(2)", "--out", "{1}/c.nvs"],
    "convert-videos": ["convert-videos", "{0}/videos", "--out", "{1}/out"],
    "record": ["record", "--simulate", "--seconds", "0.2", "--out", "{1}/b.h5"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_names_the_file_that_has_no_room(tmp_path, events, name, capsys):
    nvsdata.write(events, tmp_path / "a.h5")
    (tmp_path / "in/a").mkdir(parents=True)
    nvsdata.write(events, tmp_path / "in/a/0.h5")
    write_video(tmp_path / "videos/0.avi", moving_square(4))
    with small_disk(tmp_path / "disk") as resize:
        resize(PAGE)
        (tmp_path / "disk/full").write_bytes(b"x" * PAGE)
        assert main([word.format(tmp_path, tmp_path / "disk") for word in COMMANDS[name]]) == 1
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith(f"nvsdata {COMMANDS[name][0]}: ")
        assert "No space left on device" in error or "the disk has 0.0 MB left" in error
        assert str(tmp_path / "disk") in error
        assert not [path for path in (tmp_path / "disk").iterdir() if path.suffix and path.suffix != ".part"]


def test_an_interrupted_batch_says_how_much_is_done_and_how_to_resume(tmp_path, events, capsys):
    for i in range(3):
        (tmp_path / "in/a").mkdir(parents=True, exist_ok=True)
        nvsdata.write(events, tmp_path / f"in/a/{i}.h5")
        write_video(tmp_path / f"videos/{i}.avi", moving_square(8, seed=i))
    with small_disk(tmp_path / "disk") as resize:
        packing = ["pack", str(tmp_path / "in"), "--dataset", "folder", "--out", str(tmp_path / "disk/b.h5")]
        converting = ["convert-videos", str(tmp_path / "videos"), "--out", str(tmp_path / "disk/out")]
        for command, word, pages in ((packing, "records are in", 12), (converting, "videos are done", 12)):
            (tmp_path / "disk/b.h5").unlink(missing_ok=True)
            resize(pages * PAGE)
            assert main(command) == 1
            output = capsys.readouterr().err.splitlines()
            (line,) = [line for line in output if word in line]
            assert line.endswith("the same command resumes")
            resize(200 * PAGE)
            assert main(command) == 0
            capsys.readouterr()


def test_a_folder_of_videos_goes_on_where_the_disk_was_full(tmp_path):
    from nvsdata.emulation.convert import convert_videos

    for i in range(4):
        write_video(tmp_path / f"videos/run/{i}.avi", moving_square(seed=i))
    out = tmp_path / "disk" / "out"
    with small_disk(tmp_path / "disk") as resize:
        resize(6 * PAGE)
        with pytest.raises(OSError, match="No space left"):
            convert_videos(tmp_path / "videos", out)
        kept = sorted(out.rglob("*.h5"))
        assert len(kept) < 4
        resize(1 << 20)
        report = convert_videos(tmp_path / "videos", out)
        assert report.done + report.kept == 4
        for path in sorted(out.rglob("*.h5")):
            assert len(nvsdata.read(path)) > 0
        assert not list(out.rglob(".*"))


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("view a.h5 disk/v.html", "disk/v.html: "),
        ("view a.h5 disk/v.png", "disk/v.png: "),
        ("view a.h5 disk/v.gif", "disk/v.gif: "),
        ("gallery data disk/g.html", "disk/g.html: "),
        ("compare a.h5 data/b/b.h5 --image disk/c.png", "disk/c.png: "),
        ("convert a.h5 disk/c.aedat", "disk/c.aedat: "),
        ("pack data --dataset folder --out disk/p.h5", "disk/p.h5: "),
        ("convert-videos videos --out disk/cv", "disk/cv/manifest.jsonl: "),
        ("record --simulate --seconds 0.1 --out disk/r.h5", "disk/r.h5"),
    ],
)
def test_commands_name_the_file_that_a_full_disk_did_not_take(tmp_path, events, words, named, monkeypatch, capsys):
    from nvsdata.cli import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "data/b").mkdir(parents=True)
    nvsdata.write(events, "a.h5")
    nvsdata.write(events, "data/b/b.h5")
    write_video(tmp_path / "videos/run/a.avi", moving_square())
    with small_disk(tmp_path / "disk"):
        (tmp_path / "disk/fill").write_bytes(bytes(16 * PAGE))
        assert main(words.split()) == 1
        last = capsys.readouterr().err.splitlines()[-1]
        assert last.startswith(f"nvsdata {words.split()[0]}: ")
        assert "No space left on device" in last or "the disk has 0.0 MB left" in last
        assert named in last


def test_an_error_that_names_no_file_gets_the_paths_that_were_given(tmp_path, monkeypatch, capsys):
    from nvsdata.cli import main
    from nvsdata.commands import compare

    def broken(args):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(compare, "run", broken)
    assert main(["compare", "a.h5", "b.h5"]) == 1
    assert capsys.readouterr().err.startswith("nvsdata compare: Input/output error (one of: a.h5, b.h5, ")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")
def test_results_that_find_no_room_are_an_error(tmp_path, events):
    nvsdata.write(events, tmp_path / "a.h5")
    for command in (["info", tmp_path / "a.h5"], ["datasets"]):
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [sys.executable, "-m", "nvsdata", *command], stdout=full, stderr=subprocess.PIPE, text=True
            )
        assert (done.returncode, done.stderr) == (
            1,
            f"nvsdata {command[0]}: standard output: No space left on device\n",
        )
