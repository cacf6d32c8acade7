"""What commands print, and what they do where no option says otherwise."""

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from math import inf
from pathlib import Path

import numpy as np
import pytest

import nvsdata
from nvsdata import Events, metrics
from nvsdata._version import __version__
from nvsdata.cli import COMMANDS, main
from nvsdata.commands import datasets, options
from nvsdata.commands.compare import compare_files
from nvsdata.commands.emulation_settings import changes_of, emulator_from, read_settings, write_settings
from nvsdata.common.processes import cores
from nvsdata.data.samples import Frame, Piece
from nvsdata.emulation import DVS, PIX2NVS, PRESETS, SENSORS

INFO = """\
{file}
  format     hdf5
  sensor     34x30
  events     {events}
  time       {time}
  rate       {rate}
  polarity   {polarity} ON
  anomalies  {anomalies}
"""


@pytest.mark.parametrize(
    ("t", "p", "output"),
    [
        (
            [5, 15, 15, 2_000_005],
            [1, 1, 1, 0],
            ("4", "5 to 2000005 µs (2.000000 s)", "2 events/s", "75.0%", "1 duplicate events"),
        ),
        ([7, 7], [1, 0], ("2", "7 to 7 µs (0.000000 s)", "all at one time", "50.0%", "none")),
        (
            [*range(999), 1_000],
            [0] * 1_000,
            ("1,000", "0 to 1000 µs (0.001000 s)", "1,000,000 events/s", "0.0%", "none"),
        ),
    ],
)
def test_info_tells_exactly_this(tmp_path, capsys, t, p, output):
    nvsdata.write(
        Events(t, [n // 10 % 3 if len(t) > 9 else 1 for n in range(len(t))], [0] * len(t), p, (34, 30)),
        tmp_path / "a.h5",
    )
    assert main(["info", str(tmp_path / "a.h5")]) == 0
    names = ("events", "time", "rate", "polarity", "anomalies")
    assert capsys.readouterr().out == INFO.format(file=tmp_path / "a.h5", **dict(zip(names, output, strict=True)))


def test_info_of_nothing_tells_no_times(tmp_path, capsys):
    nvsdata.write(Events.empty((34, 30)), tmp_path / "a.h5")
    assert main(["info", str(tmp_path / "a.h5")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:] == ["  format     hdf5", "  sensor     34x30", "  events     0", "  anomalies  none"]


def test_info_decodes_once(tmp_path, monkeypatch):
    nvsdata.write(Events([5, 15, 15], [1, 1, 1], [0, 0, 0], [1, 1, 0], (34, 30)), tmp_path / "a.dat")
    decoded = []
    decode = type(nvsdata.open(tmp_path / "a.dat")).decode
    monkeypatch.setattr(
        type(nvsdata.open(tmp_path / "a.dat")), "decode", lambda self: decoded.append(self.path) or decode(self)
    )
    assert main(["info", str(tmp_path / "a.dat")]) == 0
    assert decoded == [str(tmp_path / "a.dat")]


@pytest.fixture
def two(tmp_path):
    """Recordings of 130 and 80 ms; times count from the beginning of each."""
    for name, t in (("a", [0, 5_000, 80_000, 130_000]), ("b", [1_000_000, 1_040_000, 1_045_000, 1_080_000])):
        nvsdata.write(Events(t, [1, 2, 3, 4], [1, 2, 1, 2], [1, 0, 1, 1], (8, 8)), tmp_path / f"{name}.h5")
    return tmp_path / "a.h5", tmp_path / "b.h5"


def test_compare_tells_distances_and_how_many_frames_they_are_of(two, tmp_path, capsys):
    a, b = map(nvsdata.read, two)
    picture = tmp_path / "c.png"
    words = ["compare", *map(str, two), "--image", str(picture), "--fps", "20", "--offset", "60000"]
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [f"A  {two[0]}  {a}", f"B  {two[1]}  {b}"]
    assert lines[2].split() == "distance A to B B to A closer if frames empty in A empty in B".split()
    found = metrics.compare(a, b, 20, offset=60_000)
    # frames of 50 ms: A has events in the first, second and third, B in the second and third
    for line, name, closer, there, back in zip(
        lines[3:6],
        ("Chamfer", "e-repeatability", "EMD"),
        ("lower", "higher", "lower"),
        (found.chamfer, found.repeatability, found.emd),
        (found.chamfer_back, found.repeatability_back, found.emd),
        strict=True,
    ):
        assert line.split() == [name, f"{there.value:.4f}", f"{back.value:.4f}", closer, "2", "0", "1"]
    assert lines[6:8] == ["", "events  A  B  A / B"]
    assert [line.split()[0] for line in lines[8:10]] == ["OFF", "ON"]
    assert lines[10:] == [f"image: {picture}"]
    assert picture.stat().st_size > 0


def test_compare_says_at_once_that_a_folder_is_not_there(two, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(metrics, "compare", None)
    assert main(["compare", *map(str, two), "--image", str(tmp_path / "no/c.png")]) == 1
    assert f"{tmp_path / 'no'}: No such file or directory" in capsys.readouterr().err


def test_compare_uses_30_frames_per_second_and_no_offset(two, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["compare", *map(str, two)]) == 0
    output = capsys.readouterr().out
    assert output == compare_files(*two, Path("compare.png"), fps=30.0)[0] + "\n"
    assert output == compare_files(*two, Path("compare.png"), fps=30.0, offset=0)[0] + "\n"
    assert output != compare_files(*two, Path("compare.png"), fps=31.0)[0] + "\n"


def test_convert_tells_how_many_events_and_what_is_left_out(tmp_path, capsys):
    n = np.arange(1_234)
    ev = Events(n, n % 8, n % 7, n % 2, (8, 8))
    nvsdata.write(Piece.of_camera(ev, [Frame(1, 2, 3, 4, 0, 0, np.zeros((2, 2), np.uint16))]), tmp_path / "a.h5")
    assert main(["convert", str(tmp_path / "a.h5"), str(tmp_path / "b.txt")]) == 0
    out, err = capsys.readouterr()
    assert out == f"1,234 events in {tmp_path / 'b.txt'}\n"
    assert err.startswith(f"{tmp_path / 'b.txt'} can't contain everything: ")
    assert err.endswith(" are left out\n")
    assert main(["convert", str(tmp_path / "b.txt"), str(tmp_path / "c.h5"), "--sensor-size", "8x8"]) == 0
    assert capsys.readouterr().err == ""
    assert nvsdata.read(tmp_path / "c.h5") == ev


@pytest.mark.parametrize(
    ("names", "wanted", "found"),
    [
        (["N_MNIST/"], "n-mnist", "N_MNIST"),
        (["nmnist/", "N-MNIST/"], "n-mnist", "N-MNIST"),
        (["n-mnist.h5"], "n-mnist", "n-mnist.h5"),
        (["Nmnist.h5/"], "n-mnist", "Nmnist.h5"),
        (["n-mnist", "n-mnist.zip", "n-mnist2/"], "n-mnist", None),
        ([], "n-mnist", None),
        (["n-cars/"], "n-mnist", None),
    ],
)
def test_where_a_dataset_is(tmp_path, names, wanted, found):
    for name in names:
        (tmp_path / name).mkdir() if name.endswith("/") else (tmp_path / name).touch()
    assert datasets.where(wanted, tmp_path) == (found and tmp_path / found)
    assert datasets.where(wanted, tmp_path / "nowhere") is None


def test_the_table_of_datasets_has_their_facts(tmp_path):
    result = datasets.table(datasets.dataset_facts(tmp_path / "nowhere"))
    lines = {line.split()[0]: " ".join(line.split()) for line in result.splitlines()}
    assert lines["name"] == "name sensor recordings classes size license location or source"
    assert lines["n-mnist"] == "n-mnist 34x34 70,000 10 ? CC BY-SA 4.0 nvsdata download n-mnist"
    assert lines["mnist-dvs"].startswith("mnist-dvs 128x128 30,000 10 6.2 GB not stated ")
    assert lines["n-cars"].startswith("n-cars 120x100 24,029 2 0.5 GB Prophesee's, ")
    assert lines["asl-dvs"].endswith(
        " not stated manual download from https://www.dropbox.com/sh/ibq0jsicatn7l6r/AACNrNELV56rs1YInMWUs9CAa"
    )
    assert "folder" not in lines


def test_the_facts_written_beforehand_are_those_of_the_datasets():
    """python -m nvsdata.commands.datasets writes them."""
    assert json.loads(datasets.FACTS.read_text("utf-8")) == json.loads(json.dumps(datasets.registered()))


def test_the_table_imports_neither_torch_nor_numpy():
    code = (
        "import sys\nfrom nvsdata.cli import main\nmain(['datasets'])\n"
        "sys.exit(any(name in sys.modules for name in ('torch', 'numpy', 'nvsdata.kernels._native')))"
    )
    assert subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=False).returncode == 0


@pytest.mark.parametrize(
    ("kind", "taken", "refused"),
    [
        (
            options.sensor_size,
            {"240x180": (240, 180), "1x1": (1, 1)},
            ["0x5", "5x0", "5", "x5", "5x", "-5x5", "5x5x5", "5X5"],
        ),
        (options.at_least_1, {"1": 1, "20": 20}, ["0", "-1", "1.5", "", "one"]),
        (options.positive, {"1": 1.0, "1e-9": 1e-9, "2.5": 2.5}, ["0", "-1", "inf", "nan", "one", ""]),
        (options.path, {"~": Path.home(), "a/b": Path("a/b")}, []),
    ],
)
def test_words_become_values(kind, taken, refused):
    for word, value in taken.items():
        assert kind(word) == value
    for word in refused:
        with pytest.raises(argparse.ArgumentTypeError, match="must be"):
            kind(word)


# what is done where no option says otherwise; None and False are for options that are off
DEFAULTS = {
    "demo": ([], {"out": Path("nvsdata-demo"), "epochs": 40, "seed": 0}),
    "view": (["a"], {"speed": 1.0, "fps": 30.0}),
    "gallery": (["a"], {"split": "all", "read": 20, "images": 6}),
    "datasets": ([], {"root": Path()}),
    "cache": (["info"], {}),
    "pack": (["a", "--dataset", "folder", "--out", "b"], {"split": "all", "jobs": 1}),
    "precompute": (
        ["a", "--dataset", "folder", "--transform", "c", "--out", "b"],
        {"split": "all", "jobs": 1},
    ),
    "join": (["a", "--out", "b"], {}),
    "push": (["a", "s3://a"], {}),
    "fetch": (["s3://a", "--out", "b"], {}),
    "convert": (["a", "b"], {}),
    "convert-videos": (
        ["a"],
        {"jobs": max(1, cores() // 2), "format": "hdf5", "fit": "pad", "start": 0.0, "stop": inf, "set": []},
    ),
    "compare": (["a", "b"], {"fps": 30.0, "offset": 0, "image": Path("compare.png")}),
    "tune": (
        ["--real", "a", "--video", "b"],
        {"trials": 100, "offset": 0, "jobs": 1, "seed": 0, "out": Path("tuning"), "unseen": 0.25, "set": []},
    ),
    "record": ([], {"bias": [], "format": "hdf5", "display": 0, "scaling": "aspect"}),
    "bench": ([], {"tasks": ["all"], "only": "", "device": "cpu"}),
    "verify": (["a"], {"jobs": 1}),
    "info": (["a"], {}),
    "download": (["folder"], {}),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_done_without_options(command):
    words, expected = DEFAULTS[command]
    parser = argparse.ArgumentParser()
    import_module(f"nvsdata.commands.{COMMANDS[command].module}").add_arguments(parser)
    args = vars(parser.parse_args(words))
    given = {action.dest for action in parser._actions if action.required}
    rest = {
        name: value for name, value in args.items() if name not in given and value is not None and value is not False
    }
    assert rest == expected


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ([], {}),
        (
            ["--set", "threshold=0.25", "--set", "t_log=7", "--set", "new=false", "--set", "exp=True"],
            {"threshold": 0.25, "t_log": 7, "new": False, "exp": True},
        ),
        (["--set=mode=CE", "--set=seed=5", "--set=max_events=3"], {"mode": "CE", "seed": 5, "max_events": 3}),
    ],
)
@pytest.mark.parametrize("preset", [None, "section-3.4.1"])
def test_settings_that_are_given_replace_the_presets(words, changes, preset):
    parser = argparse.ArgumentParser()
    import_module("nvsdata.commands.convert_videos").add_arguments(parser)
    args = parser.parse_args(["a", *words, *(["--preset", preset] if preset else [])])
    base = PRESETS[preset] if preset else PIX2NVS()
    assert changes_of(args, base) == changes
    settings = emulator_from(args)
    assert {name: getattr(settings, name) for name in changes} == changes
    assert {k: v for k, v in vars(settings).items() if k not in changes} == {
        k: v for k, v in vars(base).items() if k not in changes
    }


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--preset ideal", DVS()),
        ("--preset dvs128", SENSORS["dvs128"]),
        ("--preset davis346 --set leak=0.5 --set seed=3", replace(SENSORS["davis346"], leak=0.5, seed=3)),
        ("--preset ideal --set upsample=4 --set dark=2", DVS(upsample=4, dark=2)),
        ("--preset ideal --set upsample=flow", DVS(upsample="flow")),
        ("", PIX2NVS()),
    ],
)
def test_the_emulator_is_chosen_by_its_preset(words, expected):
    parser = argparse.ArgumentParser()
    import_module("nvsdata.commands.convert_videos").add_arguments(parser)
    assert emulator_from(parser.parse_args(["a", *words.split()])) == expected


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--set alpha=2", "alpha"),
        ("--preset ideal --set alpha=0.5", "--set alpha: DVS has no such setting; --settings-help lists them"),
        ("--set leak=2", "--set leak: PIX2NVS has no such setting"),
        ("--set new=maybe", "--set new: must be true or false, not 'maybe'"),
        ("--set max_events=2.5", "--set max_events: must be a whole number, not '2.5'"),
        ("--set begin=1", "--set begin: PIX2NVS has no such setting"),
        ("--preset ideal --set upsample=sideways", "upsample must be a number or one of"),
    ],
)
def test_settings_that_contradict_each_other_are_wrong_usage(words, said):
    parser = argparse.ArgumentParser()
    import_module("nvsdata.commands.convert_videos").add_arguments(parser)
    with pytest.raises(options.UsageError, match=said):
        emulator_from(parser.parse_args(["a", *words.split()]))


@pytest.mark.parametrize("settings", [DVS(on=0.21, upsample="flow", seed=4), PIX2NVS(threshold=0.3, mode="CE")])
def test_settings_come_back_from_their_file(settings, tmp_path):
    write_settings(settings, tmp_path / "best.json")
    assert read_settings(tmp_path / "best.json") == settings
    parser = argparse.ArgumentParser()
    import_module("nvsdata.commands.convert_videos").add_arguments(parser)
    assert emulator_from(parser.parse_args(["a", "--settings", str(tmp_path / "best.json")])) == settings


def test_help_tells_defaults_once(capsys):
    parser = argparse.ArgumentParser(formatter_class=options.Help)
    add = parser.add_argument
    add("place", default=5, help="a")
    add("--number", default=0, help="b")
    add("--own", default=7, help="c (default: seven)")
    add("--off", action="store_true", help="d")
    add("--list", action="append", default=[], help="e")
    add("--none", help="f")
    add("--left", default=argparse.SUPPRESS, help="g")
    add("--secret", default=3)
    words = " ".join(parser.format_help().split())
    for output in (
        "place a options:", "NUMBER b (default 0) --own", "OWN c (default: seven) --off", "d --list", "e --none",
        "f --left", "g --secret", "--secret SECRET",
    ):  # fmt: skip
        assert output in words
    assert words.count("default") == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_help_begins_with_a_sentence(command, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    output = " ".join(capsys.readouterr().out.split())
    sentence = COMMANDS[command].help
    if command != "tune":
        assert f" {sentence[0].upper()}{sentence[1:]}. " in output
    with pytest.raises(SystemExit):
        main(["--help"])
    assert sentence in " ".join(capsys.readouterr().out.split())


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"nvsdata {__version__}\n"
    for words in ([], ["--sensor-size"]):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2
