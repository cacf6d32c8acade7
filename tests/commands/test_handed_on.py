"""Calls by commands into the rest of nvsdata, and their output for its results."""

import errno
import os
import re
import sys
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import nvsdata
from nvsdata import Events, cli
from nvsdata.batch.run import FolderReport
from nvsdata.cli import main
from nvsdata.commands.view import save_view
from nvsdata.common.processes import cores
from nvsdata.data.samples import Frame, Piece
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.tuning.space import SPACE
from nvsdata.plots.films import Film
from nvsdata.video.view import VideoView


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--verify", "--out", "a"], "--verify is for --monitor, not for one recording"),
        (["--resume"], "--resume is for --monitor, not for one recording"),
        (["--monitor", "a", "--out", "b", "--overwrite"], "not for --monitor: --resume continues a batch"),
        (["--monitor", "a", "--out", "b", "--seconds", "2"], "--seconds is for --calibrate and one recording"),
        (["--monitor", "a", "--calibrate"], "--monitor and --calibrate don't go together"),
        (["--calibrate", "--json"], "--json is for --status and --list and --monitor and one recording"),
        (["--calibrate", "--model", "a"], "--model is for one recording, not for --calibrate"),
        (["--status", "a", "--screen-region", "1", "2", "3", "4"], "--screen-region is for --calibrate and --monitor"),
        (["--list", "--live"], "--live is for --monitor and one recording, not for --list"),
        (["--monitor"], "argument --monitor: expected one argument"),
        (["--status", "--json"], "argument --status: expected one argument"),
        (["--monitor", "a"], "--out is missing"),
        ([], "--out is missing"),
        (["--out", "a", "--bias", "x"], "x"),
        (["--out", "a", "--note", "caf\udce9"], "--note must be text in this terminal's encoding"),
        (["--out", "a", "--simulate", "x=1"], "x"),
    ],
)
def test_recordings_that_make_no_sense_are_wrong_usage(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["record", *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


COMMON = "--help --quiet --verbose --json"
CAMERA = "--device --settings --bias --region --frames --simulate"
SCREEN = "--display --screen-region --scaling"
OTHERS = "--monitor --calibrate --status --list --doctor"
BATCH = "--resume --verify --calibration --on-alarm --until-full --strict --accept-quiet --format --limit"


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (
            "",
            f"{CAMERA} --out --seconds --live --model --note --overwrite {OTHERS}",
        ),
        ("--monitor", f"--monitor {CAMERA} {SCREEN} {BATCH} --out --live --note"),
        ("--monitor in --out b", f"--monitor {CAMERA} {SCREEN} {BATCH} --out --live --note"),
        ("--calibrate", f"--calibrate {CAMERA} {SCREEN} --out --seconds --overwrite"),
        ("--status", "--status"),
        ("--list", "--list --simulate"),
        ("--doctor", "--doctor --out --live --monitor --calibrate --simulate"),
    ],
)
def test_the_help_of_each_mode_has_the_options_that_apply(words, options, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["record", *words.split(), "--help"])
    assert ended.value.code == 0
    shown = re.findall(r"^  (?:-\w, )?(--[\w-]+)", capsys.readouterr().out, re.MULTILINE)
    common = COMMON.split() if words != "--calibrate" else COMMON.split()[:-1]
    assert sorted(shown) == sorted([*common, *options.split()])
    if not words:
        assert len(shown) <= 24


@pytest.fixture
def session(monkeypatch):
    """What the recording session is asked for."""
    from nvsdata.recording import session
    from nvsdata.rig import session as rig

    asked = []
    for module, name in (
        (session, "run_recording"),
        (rig, "run_calibration"),
        (rig, "run_batch"),
        (rig, "run_verification"),
    ):
        monkeypatch.setattr(module, name, lambda *args, name=name, **more: asked.append((name, args, more)) or 5)
    return asked


@pytest.mark.parametrize("words", [["--out", "a.h5"], ["--live"], ["--live", "--overwrite", "--seconds", "2"]])
def test_one_recording_is_asked_for(words, session):
    assert main(["record", *words]) == 5
    ((name, (out, seconds, chosen), how),) = session
    assert (name, chosen.serial, chosen.simulate, chosen.note) == ("run_recording", None, None, None)
    assert out == (Path("a.h5") if "--out" in words else None)
    assert seconds == (2 if "--seconds" in words else None)
    assert how == {"live": "--live" in words, "overwrite": "--overwrite" in words} | {
        "decider": None,
        "as_json": False,
    }


def test_calibrations_and_folders_are_asked_for(session):
    assert main(["record", "--calibrate", "--simulate", "--display", "2", "--region", "1", "2", "3", "4"]) == 5
    assert main(["record", "--calibrate", "--out", "b", "--screen-region", "1", "2", "3", "4", "--overwrite"]) == 5
    assert main(["record", "--monitor", "in", "--out", "b", "--resume", "--limit", "3", "--scaling", "integer"]) == 5
    first, second, third = session
    assert [name for name, *_ in session] == ["run_calibration", "run_calibration", "run_batch"]
    assert first[1][0] == Path("calibration")
    assert first[1][2].settings.region == (1, 2, 3, 4)
    assert first[1][2].simulate is not None
    assert first[1][3] == {"display": 2, "region": None, "scaling": "aspect"}
    assert (first[2], second[2]) == ({"overwrite": False}, {"overwrite": True})
    assert (second[1][0], second[1][2].simulate, second[1][3]["region"]) == (Path("b"), None, (1, 2, 3, 4))
    source, out, chosen, screen, options = third[1]
    assert (source, out, chosen.serial, chosen.note) == (Path("in"), Path("b"), None, None)
    assert screen["scaling"] == "integer"
    assert asdict(options) == {"format": "hdf5", "limit": 3, "resume": True} | {
        "calibration": None,
        "strict": False,
        "accept_quiet": False,
        "on_alarm": None,
        "until_full": False,
        "live": False,
    }
    assert third[2] == {"as_json": False}


def test_a_reader_that_leaves_ends_a_command_with_1(monkeypatch, tmp_path):
    def gone(args):
        raise BrokenPipeError

    monkeypatch.setattr("nvsdata.commands.datasets.run", gone)
    with (tmp_path / "out").open("w") as out, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", out)
        assert main(["datasets"]) == 1
        out.write("lost")
    # what is still written goes nowhere
    assert (tmp_path / "out").read_text() == ""


def test_a_page_has_the_frames_up_to_its_last_event(tmp_path, monkeypatch):
    frames = [Frame(t, t, t, t, 0, 0, np.zeros((2, 2), np.uint16)) for t in (4, 5, 9, 10)]
    events = Events([5, 9], [0, 1], [0, 1], [1, 0], (4, 4))
    nvsdata.write(Piece.of_camera(events, frames), tmp_path / "a.h5")
    drawn = []

    def page(events, name, frames, window, origin):
        drawn.append((name, [frame.exposure_start for frame in frames], window, origin))
        return "<p>"

    monkeypatch.setattr("nvsdata.plots.page.player_page", page)
    save_view(tmp_path / "b.HTML", "a", nvsdata.open(tmp_path / "a.h5"), events, Film(), 7, 3)
    nvsdata.write(events, tmp_path / "c.h5")
    save_view(tmp_path / "d.html", "c", nvsdata.open(tmp_path / "c.h5"), events, Film(), None, None)
    assert drawn == [("a", [5, 9], 7, 3), ("c", [], None, None)]
    assert (tmp_path / "b.HTML").read_text() == "<p>"


def test_view_takes_what_it_is_told(tmp_path, monkeypatch, capsys):
    films = []

    def save(out, *more):
        films.append((out, *more))
        out.write_bytes(bytes(1_260_000))

    monkeypatch.setattr("nvsdata.commands.view.save_view", save)
    nvsdata.write(Events(range(1_200), [0] * 1_200, [0] * 1_200, [0] * 1_200, (4, 4)), tmp_path / "a.h5")
    monkeypatch.chdir(tmp_path)
    assert main(["view", "a.h5"]) == 0
    assert capsys.readouterr().out == "1,200 events in a.h5.html, 1.3 MB\n"
    assert main(["view", "a.h5", "b.PNG", "--duration", "1", "--start", "5", "--stop", "9"]) == 0
    assert capsys.readouterr().out == "4 events in b.PNG, 1.3 MB\n"
    assert [film[4:] for film in films] == [(Film(33_333, None, 1.0, 30.0, None), None, None), (Film(1), 1, 0)]
    assert [film[:2] for film in films] == [(Path("a.h5.html"), "a.h5"), (Path("b.PNG"), "a.h5")]


def test_words_are_those_of_the_process_unless_given(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["nvsdata", "datasets", "--root", str(tmp_path)])
    assert main() == 0
    assert "n-mnist" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main([])


def test_a_program_without_streams_runs(tmp_path, monkeypatch):
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    assert main(["datasets", "--root", str(tmp_path)]) == 0
    assert (sys.stdout.name, sys.stderr.name) == (os.devnull, os.devnull)
    sys.stdout.close()
    sys.stderr.close()


def test_videos_that_were_converted_are_counted(tmp_path, monkeypatch, capsys):
    from nvsdata.emulation import convert

    asked = []

    def convert_videos(source, out, settings, **options):
        asked.append((source, out, settings, options))
        return FolderReport(done=1_200, kept=3_400, events=5_600_000, kept_events=100, failed=failed)

    monkeypatch.setattr(convert, "convert_videos", convert_videos)
    monkeypatch.setattr(sys, "setswitchinterval", asked.append)
    failed = {}
    assert main(["convert-videos", "in"]) == 0
    output = "1,200 converted, 3,400 already existed, {} failed; 5,600,000 events converted, "
    output += "4,600 recordings with 5,600,100 events in {}\n"
    assert capsys.readouterr() == (output.format(0, convert.default_out(Path("in"))), "")
    failed = {"a.avi": "cut off", "b.avi": "empty"}
    words = ["--out", "out", "--size", "40x30", "--fps", "25", "--limit", "7", "--jobs", "2", "--scheduler", "here"]
    words += ["--overwrite", "--check", "--preview", "--start", "1.5", "--stop", "4", "--fit", "crop"]
    words += ["--crop", "1", "2", "30", "20"]
    assert main(["convert-videos", "in", *words]) == 1
    assert capsys.readouterr() == (
        output.format(2, "out"),
        f"a.avi: cut off\nb.avi: empty\npreviews are in {Path('out/.previews')}\n",
    )
    plain = {"format": "hdf5", "size": None, "fps": None, "limit": None, "shard": None, "scheduler": None}
    plain |= {"jobs": max(1, cores() // 2), "overwrite": False, "check": False, "preview": False, "view": VideoView()}
    chosen = {"size": (40, 30), "fps": 25.0, "limit": 7, "jobs": 2, "scheduler": "here"}
    chosen |= {"overwrite": True, "check": True, "preview": True, "view": VideoView(1.5, 4.0, (1, 2, 30, 20), "crop")}
    assert asked[1] == (Path("in"), None, PIX2NVS(), plain)
    assert asked[3] == (Path("in"), Path("out"), PIX2NVS(), plain | chosen)
    # less than a frame's time
    assert 0 < asked[0] < 1 / 1_000


PLAIN = {"jobs": 1, "scheduler": None, "compress": False, "overwrite": False, "shard": None}


def test_what_was_packed_is_counted(tmp_path, monkeypatch, capsys):
    from nvsdata.datasets.store import writer

    asked, skipped = [], {}

    def pack(found, out, **options):
        asked.append((type(found).__name__, found.split_name, out, options))
        return SimpleNamespace(packed=1_200, events=5_600_000, skipped=skipped)

    monkeypatch.setattr(writer, "pack", pack)
    for split in ("train", "test"):
        (tmp_path / "d" / split / "a").mkdir(parents=True)
        nvsdata.write(Events([1], [1], [1], [1], (4, 4)), tmp_path / "d" / split / "a" / "0.h5")
    words = ["pack", str(tmp_path / "d"), "--dataset", "folder", "--out", "b.h5"]
    assert main(words) == 0
    assert capsys.readouterr() == ("1,200 recordings, 5,600,000 events in b.h5; 0 left out\n", "")
    skipped["a\nb"] = "cut off"
    assert (
        main(
            [
                *words,
                "--split",
                "train",
                "--jobs",
                "3",
                "--compress",
                "--overwrite",
                "--shard",
                "2/3",
                "--scheduler",
                "here",
            ]
        )
        == 1
    )
    output = capsys.readouterr()
    assert output == ("1,200 recordings, 5,600,000 events in b-2-of-3.h5; 1 left out\n", "left out a\\nb: cut off\n")
    assert asked[0] == ("EventFolder", "all", Path("b.h5"), PLAIN)
    assert asked[1] == (
        "EventFolder",
        "train",
        Path("b.h5"),
        {"jobs": 3, "scheduler": "here", "compress": True, "overwrite": True, "shard": (2, 3)},
    )
    with pytest.raises(SystemExit, match="2"):
        main([*words, "--split", "half"])


@pytest.mark.parametrize("count", [0, 1, 2])
def test_faults_are_counted(monkeypatch, capsys, count):
    found = [(f"{n}\n.bin", "cut off") for n in range(count)]
    asked = []

    def problems(root, kind, counts, **options):
        asked.append(options)
        counts.update(opened=7)
        return found

    monkeypatch.setattr("nvsdata.datasets.verification.problems", problems)
    assert main(["verify", "in", "--jobs", "3", "--scheduler", "here", "--shard", "2/3"]) == min(count, 1)
    assert asked == [{"jobs": 3, "scheduler": "here", "shard": (2, 3)}]
    lines = [f"{n}\\n.bin: cut off" for n in range(count)]
    assert capsys.readouterr().out.splitlines() == [
        *lines,
        f"7 recordings opened: {f'{count} faults' if count else 'no faults'}",
    ]


def test_a_download_tells_its_folders(monkeypatch, capsys):
    asked = []

    def download(info, root, *, keep):
        asked.append((info.name, root))
        return [root / "a", root / "b"]

    monkeypatch.setattr("nvsdata.datasets.archives.download.download", download)
    assert main(["download", "n-mnist"]) == 0
    assert main(["download", "n-mnist", "--root", "x"]) == 0
    assert asked == [("n-mnist", Path("n-mnist")), ("n-mnist", Path("x"))]
    assert capsys.readouterr().out.splitlines() == ["n-mnist/a", "n-mnist/b", "x/a", "x/b"]


def test_the_demo_is_asked_for(monkeypatch):
    asked = []
    monkeypatch.setattr("nvsdata.training.demo.train", lambda *args: asked.append(args))
    assert main(["demo", "--epochs", "3"]) == 0
    assert asked == [(Path("nvsdata-demo"), 3, 0)]


def test_tune_needs_something_to_search_for(capsys, monkeypatch, tmp_path):
    from nvsdata.commands import tune

    asked = []
    gray = SimpleNamespace(colored=False, split=lambda share: asked.append(share) or (gray, gray))
    monkeypatch.setattr(tune, "TuningPair", lambda *args, **more: asked.append((args[1:], more)) or gray)
    monkeypatch.setattr(tune.formats, "open", lambda path: path)
    monkeypatch.setattr(tune, "search", lambda pair, **more: asked.append(more) or SimpleNamespace(scores=[np.nan] * 2))
    words = ["tune", "--real", "a.h5", "--video", "b.avi", "--out", str(tmp_path / "out")]
    values = {
        "mode": "LICE", "hue": False, "difference": "average", "t_log": 20.0, "inhibition": 2, "max_events": 3,
        "threshold": 0.4, "new": False, "exp": True, "alpha": 0.25, "noise_rate": 2.0,
    }  # fmt: skip
    assert list(values) == list(SPACE)
    every = [
        f"--set={name}={str(value).lower() if isinstance(value, bool) else value}" for name, value in values.items()
    ]
    with pytest.raises(SystemExit, match="2"):
        main([*words, *every])
    assert "--set gives every setting: there is nothing to search" in capsys.readouterr().err
    assert asked == []
    held = list(values)[1:]
    more = [
        "--trials",
        "7",
        "--seconds",
        "2",
        "--fps",
        "25",
        "--offset",
        "-3",
        "--unseen",
        "0.5",
        "--jobs",
        "2",
        "--seed",
        "9",
    ]
    assert main([*words, *every[1:], *more]) == 1
    assert "no settings gave events in frames with real events" in capsys.readouterr().err
    assert not any((tmp_path / "out").iterdir())
    compared = {"fps": 25.0, "seconds": 2.0, "offset": -3, "one_way": False}
    assert asked[0] == ((Path("b.avi"),), compared)
    assert asked[1] == 0.5
    found = asked[2]
    assert list(found["space"]) == [name for name in SPACE if name not in held]
    assert (found["trials"], found["seed"], found["jobs"]) == (7, 9, 2)
    assert found["note"] == {"real": ["a.h5"], "video": ["b.avi"], **compared, "unseen": 0.5}
    assert found["start"] is None
    # the seed of the imperfections stays the preset's
    assert found["base"].seed == PIX2NVS().seed
    assert {name: getattr(found["base"], name) for name in held} == {name: values[name] for name in held}


@pytest.mark.parametrize(
    ("source", "repairs", "lost", "stays"),
    [
        ("b.h5.davis", {}, [], False),
        ("b.h5.davis", {"bytes": 1_200}, [], True),
        ("b.h5.davis", {}, ["frames", "triggers"], True),
        ("a.h5.davis", {}, [], True),
    ],
)
def test_a_journal_goes_once_its_recording_is_whole(tmp_path, monkeypatch, capsys, source, repairs, lost, stays):
    asked = []
    monkeypatch.setattr(
        "nvsdata.formats.open",
        lambda path, **how: asked.append(how) or SimpleNamespace(repairs=repairs, size_is_guessed=False),
    )
    monkeypatch.setattr("nvsdata.formats.left_out", lambda *given: lost)
    monkeypatch.setattr("nvsdata.formats.write", lambda *given, **how: 1_200)
    (tmp_path / source).touch()
    monkeypatch.chdir(tmp_path)
    assert main(["convert", source, "b.h5", "--sensor-size", "4x3", *(["--repair"] if repairs else [])]) == 0
    assert (tmp_path / source).exists() == stays
    assert asked == [{"sensor_size": (4, 3), "strict": not repairs}]
    output = ["b.h5 can't contain everything: frames and triggers are left out\n"] if lost else []
    output += [f"{source}: 1200 bytes\n"] if repairs else []
    assert capsys.readouterr() == ("1,200 events in b.h5\n", "".join(output))


@pytest.mark.parametrize("closed", [(), (0,), (2,), (0, 1, 2)])
def test_nothing_else_gets_the_numbers_of_closed_streams(monkeypatch, closed):
    asked, opened = [], []

    def fstat(number):
        asked.append(number)
        if number in closed:
            raise OSError(errno.EBADF, "closed")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fstat", fstat)
        patched.setattr(os, "open", lambda *given: opened.append(given))
        cli._open_standard_streams()
    assert asked == [0, 1, 2]
    assert opened == [(os.devnull, os.O_RDWR)] * len(closed)


def test_a_verification_is_asked_for(session):
    assert main(["record", "--monitor", "in", "--out", "b", "--verify", "--limit", "2", "--json"]) == 5
    assert session == [("run_verification", (Path("in"), Path("b"), 2), {"as_json": True})]


def test_what_a_batch_is_judged_by_is_handed_on(monkeypatch):
    given = []
    monkeypatch.setattr("nvsdata.rig.session.run_batch", lambda *args, **how: given.append(args) or 3)
    words = ["--calibration", "c", "--strict", "--accept-quiet", "--on-alarm", "mail me"]
    words += ["--note", "dark", "--live", "--until-full"]
    assert main(["record", "--monitor", "in", "--out", "b", *words]) == 3
    how = {"calibration": Path("c"), "strict": True, "accept_quiet": True, "on_alarm": "mail me"}
    how |= {"live": True, "until_full": True}
    *_, chosen, _, options = given[0]
    assert asdict(options).items() >= how.items()
    assert chosen.note == "dark"


@pytest.mark.parametrize(("words", "frames"), [([], False), (["--frames"], True)])
def test_frames_are_recorded_if_asked_for(words, frames, session):
    assert main(["record", "--out", "a.h5", *words]) == 5
    ((_, (*_, chosen), _),) = session
    assert chosen.settings.frames is frames


def test_a_shard_overwrites_nothing(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["convert-videos", "in", "--shard", "1/2", "--overwrite"])
    assert "--overwrite doesn't go with --shard" in capsys.readouterr().err
