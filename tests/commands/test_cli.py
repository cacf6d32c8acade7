import argparse
import io
import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest
import trees
from processes_of_others import dead_owner
from storefiles import block_places

import nvsdata
from nvsdata import Events
from nvsdata.cli import CODES, COMMANDS, _parser, main
from nvsdata.commands.emulation_settings import ALL, HELP, PRESET_HELP
from nvsdata.commands.options import Help
from nvsdata.common.locks import locked
from nvsdata.emulation import DVS
from nvsdata.training import demo as demo_training

# what there is without them needs no words
NO_DEFAULT = ("status", "out", "bias", "simulate", "monitor", "scheduler", "sensor_size")


@pytest.fixture
def file(tmp_path):
    nvsdata.write(Events([0, 10, 10, 1_000_000], [1, 2, 2, 3], [1, 2, 2, 3], [1, 1, 1, 0], (34, 30)), tmp_path / "a.h5")
    return tmp_path / "a.h5"


def test_info_says_what_is_in_a_file(file, capsys):
    assert main(["info", str(file)]) == 0
    out = capsys.readouterr().out
    for expected in ("hdf5", "34x30", "events     4", "1.000000 s", "4 events/s", "75.0% ON", "1 duplicate events"):
        assert expected in out
    assert "guessed" not in out


def test_info_says_that_a_sensor_size_is_guessed_and_how_to_state_it(tmp_path, capsys):
    nvsdata.write(Events([0, 10], [1, 2], [1, 2], [1, 0], (34, 30)), tmp_path / "a.bin")
    assert main(["info", str(tmp_path / "a.bin")]) == 0
    out = capsys.readouterr().out
    assert "sensor     3x3, guessed from the events" in out
    assert "--sensor-size WxH" in out
    assert main(["info", "--json", str(tmp_path / "a.bin")]) == 0
    assert json.loads(capsys.readouterr().out)["size_is_guessed"]


def test_convert_says_that_it_writes_a_guessed_sensor_size(tmp_path, capsys):
    nvsdata.write(Events([0, 10], [1, 2], [1, 2], [1, 0], (34, 30)), tmp_path / "a.bin")
    assert main(["convert", str(tmp_path / "a.bin"), str(tmp_path / "a.h5")]) == 0
    assert "the sensor size 3x3 is guessed from the events: --sensor-size states it" in capsys.readouterr().err
    for words in (["-q"], ["--sensor-size", "34x30"]):
        assert main(["convert", str(tmp_path / "a.bin"), str(tmp_path / "a.h5"), "--overwrite", *words]) == 0
        assert not capsys.readouterr().err


def test_info_goes_on_after_a_bad_file(file, tmp_path, capsys):
    (tmp_path / "bad.bin").write_bytes(b"abc")
    assert main(["info", str(tmp_path / "bad.bin"), str(tmp_path / "none.bin"), str(tmp_path), str(file)]) == 1
    out, err = capsys.readouterr()
    assert "byte 0: truncated" in err
    assert "none.bin" in err
    assert "is a folder" in err
    assert "34x30" in out


def test_info_goes_on_after_a_file_that_needs_a_missing_package(file, tmp_path, capsys, monkeypatch):
    pytest.importorskip("lz4")
    nvsdata.write(nvsdata.example().window(0, 1_000), tmp_path / "a.aedat4")
    for name in ("lz4", "lz4.frame"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["info", str(tmp_path / "a.aedat4"), str(file)]) == 1
    out, err = capsys.readouterr()
    assert "a.aedat4: AEDAT 4 needs" in err
    assert "34x30" in out


def test_info_of_an_empty_recording(tmp_path, capsys):
    nvsdata.write(Events.empty((5, 5)), tmp_path / "a.h5")
    assert main(["info", str(tmp_path / "a.h5")]) == 0
    assert "events     0" in capsys.readouterr().out


def test_help_imports_neither_torch_nor_numpy():
    code = (
        "import sys\nfrom nvsdata.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "sys.exit(any(name in sys.modules for name in ('torch', 'numpy', 'nvsdata.kernels._native')))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert "demo" in result.stdout


def test_an_unknown_command_is_a_usage_error(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["nonsense"])
    assert "invalid choice" in capsys.readouterr().err


def test_who_looks_for_a_command_that_trains_is_sent_to_the_recipes(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["train", "--root", "digits"])
    found = re.search(r"no command 'train': .*python (recipes/\w+\.py)", capsys.readouterr().err)
    assert (Path(nvsdata.__file__).parents[1] / found[1]).exists()


def test_the_demos_network_learns(tmp_path, monkeypatch, capsys):
    """Five shapes, of eight recordings each, two more for validation. Guesses are as good once in 100,000 times."""
    monkeypatch.setattr(demo_training, "COUNTS", {"train": 10, "test": 4})
    assert main(["demo", "--out", str(tmp_path), "--epochs", "12", "--seed", "5"]) == 0
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert lines[0]["loss"] > 1.5
    assert lines[-1]["loss"] < 1.35
    assert lines[-1]["train_accuracy"] >= 0.5
    output = capsys.readouterr().out.splitlines()
    single, votes = (float(line.partition(":")[2].split()[0]) for line in output[-6:-4])
    assert single >= 0.45
    assert votes >= 0.5
    assert votes * 20 == pytest.approx(round(votes * 20))


def test_demo_makes_data_pictures_and_the_same_model_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demo_training, "COUNTS", {"train": 3, "test": 1})
    logs = []
    for name in ("one", "two"):
        out = tmp_path / name
        assert main(["demo", "--out", str(out), "--epochs", "2", "--seed", "3"]) == 0
        output = capsys.readouterr().out.splitlines()
        assert output[0] == f"10 recordings for training, 5 for validation, 5 for testing, in {out / 'shapes'}"
        assert re.fullmatch(r"epoch 2, .*loss \d\.\d+, train accuracy .*, validation accuracy 0.*", output[-8])
        assert output[-7] == "accuracy on 5 test recordings, with 95% intervals"
        assert re.fullmatch(r"  one 30 ms window: +0\.\d{3} \(0\.\d{3} to 0\.\d{3}\)", output[-6])
        assert output[-5].startswith("  vote of 5 such windows: ")
        assert output[-4] == f"plots: {out / 'samples.png'}, {out / 'learning.png'}"
        assert output[-3] == f"network: {out / 'model.safetensors'}"
        command = output[-2].partition(": nvsdata ")[2].split()
        assert main([*command, str(tmp_path / f"{name}.png")]) == 0
        assert (Path(nvsdata.__file__).parents[1] / re.search(r"docs/\S+", output[-1])[0]).exists()
        capsys.readouterr()
        lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
        logs.append([{k: v for k, v in line.items() if k != "seconds"} for line in lines])
    # not by the clock
    assert logs[0] == logs[1]
    assert len(logs[0]) == 2
    for name in ("samples.png", "learning.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert len(nvsdata.EventFolder(out / "shapes", "train")) == 15
    published = nvsdata.models.load(out / "model.safetensors")
    assert published.classes == tuple(demo_training.SHAPES)
    assert repr(published.transform) == repr(demo_training.pipeline(augmented=False))
    assert published.metrics == lines[-1]
    before = {p: p.stat().st_mtime_ns for p in out.glob("shapes/**/*.h5")}
    demo_training.make_dataset(out / "shapes", 3)
    assert before == {p: p.stat().st_mtime_ns for p in out.glob("shapes/**/*.h5")}
    # another seed's are made anew
    demo_training.make_dataset(out / "shapes", 4)
    assert not before.items() & {p: p.stat().st_mtime_ns for p in out.glob("shapes/**/*.h5")}.items()


@pytest.fixture
def digits(tmp_path):
    return trees.put(tmp_path / "n-mnist", trees.nmnist())


def test_datasets_says_what_is_here_and_how_to_get_the_rest(digits, capsys):
    assert main(["datasets", "--root", str(digits.parent)]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert len(lines) == 13
    assert lines["n-mnist"].endswith(f"in {digits}")
    assert "128x128" in lines["cifar10-dvs"]
    assert lines["cifar10-dvs"].endswith("nvsdata download cifar10-dvs")
    assert "manual download from https://" in lines["asl-dvs"]


def test_pack_then_verify_and_load(digits, tmp_path, capsys):
    (digits / "Train/3/00002.bin").write_bytes(b"abc")
    out = tmp_path / "n.h5"
    # something was wrong with the data
    assert main(["pack", str(digits), "--dataset", "n-mnist", "--out", str(out)]) == 1
    captured = capsys.readouterr()
    assert "49 recordings" in captured.out
    assert "left out Train/3/00002.bin" in captured.err
    assert main(["verify", str(out)]) == 1
    said = capsys.readouterr().out
    assert "Train/3/00002.bin: left out when it was packed: " in said
    assert "n-mnist: 50 recordings, 70,000 expected" in said
    assert len(nvsdata.NMNIST(out)) == 29
    raw = bytearray(out.read_bytes())
    raw[block_places(out, 0)[1] - 1] ^= 1
    out.write_bytes(raw)
    assert main(["verify", str(out)]) == 1
    assert "Test/0/00001.bin: its events fail their checksum" in capsys.readouterr().out


def test_verify_names_every_fault(digits, capsys):
    (digits / "Train/0/00001.bin").write_bytes(b"abcdefg")
    (digits / "Train/1/00001.bin").write_bytes(b"")
    unsorted = trees.some(1).columns
    (digits / "Train/2/00001.bin").write_bytes(
        trees.atis(type("E", (), dict(zip("txyp", (c[::-1] for c in unsorted), strict=True))))
    )
    (digits / "Train/3/00001.bin").write_bytes(bytes([200, 5, 0, 0, 9]))
    (digits / "labels.csv").write_text("class,start\n1,2\n")
    assert main(["verify", str(digits), "--dataset", "n-mnist"]) == 1
    out = capsys.readouterr().out
    assert "Train/0/00001.bin: 2 bytes of a torn record, cut off" in out
    assert "Train/1/00001.bin: empty" in out
    assert "Train/2/00001.bin: 59 steps back in time" in out
    assert "Train/3/00001.bin: 1 events outside the sensor" in out
    assert "labels.csv" not in out
    for name in ("0", "1", "2", "3"):
        (digits / f"Train/{name}/00001.bin").unlink()
    assert main(["verify", str(digits)]) == 0
    assert "no faults" in capsys.readouterr().out


def test_convert_between_formats(tmp_path, capsys):
    ev = trees.some(5)
    (tmp_path / "a.bin").write_bytes(trees.atis(ev) + b"xy")
    target = tmp_path / "b.aedat"
    assert main(["convert", str(tmp_path / "a.bin"), str(target)]) == 1
    assert "truncated: 2 bytes" in capsys.readouterr().err
    assert not target.exists()
    assert main(["convert", str(tmp_path / "a.bin"), str(target), "--repair", "--sensor-size", "34x34"]) == 0
    assert nvsdata.read(target, sensor_size=(34, 34)) == ev


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["pack", "nowhere", "--dataset", "n-mnist", "--out", "a.h5"], "not a folder"),
        (["download", "asl-dvs", "--root", "asl"], "with a browser from https://"),
        (["download", "yupenn-dvs"], "can't be downloaded"),
        (["verify", "nowhere"], "nowhere: no such folder or store"),
        (["convert", "nowhere", "a.h5"], "nowhere"),
    ],
)
def test_what_cannot_be_done_is_said(command, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(command) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["pack", ".", "--dataset", "mnist", "--out", "a.h5"], "no dataset 'mnist'"),
        (["pack", ".", "--dataset", "n-mnist", "--out", "a.h5", "--jobs", "0"], "must be at least 1, not 0"),
        (["convert-videos", ".", "--set", "mode=CD"], "--set mode: must be LI or CE or LICE, not 'CD'"),
        (["convert-videos", ".", "--set", "mode"], "must be NAME=VALUE, such as threshold=0.3, not 'mode'"),
        (["convert-videos", ".", "--format", "avi"], "invalid choice: 'avi'"),
        (["convert-videos", ".", "--fps", "0"], "must be positive, not 0"),
        (["record", "--seconds", "nan", "--out", "a.h5"], "must be positive, not nan"),
        (["record"], "--out is missing"),
        (["record", "--resume", "--out", "a.h5"], "--resume is for --monitor, not for one recording"),
        (["demo", "--epochs", "x"], "must be at least 1, not x"),
    ],
)
def test_wrong_usage_ends_with_2(command, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_explained(command, capsys):
    module = import_module(f"nvsdata.commands.{COMMANDS[command].module}")
    parser = argparse.ArgumentParser(formatter_class=Help)
    module.add_arguments(parser)
    for action in parser._actions:
        assert action.help, action.dest
        takes_value = action.nargs != 0 and not isinstance(action, argparse.BooleanOptionalAction)
        if action.option_strings and takes_value and not action.required and action.dest not in NO_DEFAULT:
            shown = parser._get_formatter()._expand_help(action)
            assert "(default" in shown, action.dest
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert CODES in " ".join(capsys.readouterr().out.split())


def test_every_setting_of_the_emulation_is_explained():
    names = [field.name for field in (*fields(nvsdata.PIX2NVS), *fields(DVS))]
    assert list(HELP) == list(dict.fromkeys(names))


@pytest.mark.parametrize("command", ["convert-videos", "tune"])
def test_settings_have_a_help_of_their_own(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([command, "--settings-help"])
    output = " ".join(capsys.readouterr().out.split())
    assert all(f" {name} (" in output for name in HELP)
    assert all(text in output for text in (*HELP.values(), *PRESET_HELP.values()))
    named = " ".join(PRESET_HELP).replace("-1 to -5", "-")
    assert all(name in named or name.startswith("table-3.3-row-") for name in ALL)


@pytest.mark.parametrize("command", ["convert-videos", "tune"])
def test_the_help_has_at_most_24_options(command):
    parser = _parser(command)._subparsers._group_actions[0].choices[command]
    assert sum(bool(action.option_strings) for action in parser._actions) <= 24


def test_a_file_that_is_there_is_replaced_only_if_asked(file, tmp_path, capsys):
    (tmp_path / "b.h5").write_text("precious")
    assert main(["convert", str(file), str(tmp_path / "b.h5")]) == 1
    assert "b.h5 already exists: --overwrite (in Python overwrite=True) replaces it" in capsys.readouterr().err
    assert (tmp_path / "b.h5").read_text() == "precious"
    assert main(["convert", str(file), str(tmp_path / "b.h5"), "--overwrite"]) == 0
    assert nvsdata.read(tmp_path / "b.h5") == nvsdata.read(file)
    (tmp_path / "c.h5").mkdir()
    assert main(["convert", str(file), str(tmp_path / "c.h5"), "--overwrite"]) == 1
    assert "directory" in capsys.readouterr().err


def test_two_at_one_output(file, tmp_path, capsys):
    with locked(tmp_path / "b.h5"):
        assert main(["convert", str(file), str(tmp_path / "b.h5")]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "b.h5 is being written by process" in err
    part = tmp_path / f".b.h5.{dead_owner()}-x.part"
    part.touch()
    assert main(["convert", str(file), str(tmp_path / "b.h5")]) == 0
    assert not part.exists()


def test_a_folder_of_ones_own_is_not_the_demos_to_delete(tmp_path, capsys):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes/thesis.tex").write_text("years of work")
    assert main(["demo", "--out", str(tmp_path)]) == 1
    assert "contains other files than the demo's" in capsys.readouterr().err
    assert (tmp_path / "shapes/thesis.tex").exists()


def test_a_training_in_the_folder_is_not_the_demos_to_replace(tmp_path, capsys):
    (tmp_path / "model.safetensors").write_bytes(b"a week's work")
    assert main(["demo", "--out", str(tmp_path)]) == 1
    assert "contains a training (model.safetensors) that isn't the demo's" in capsys.readouterr().err
    assert (tmp_path / "model.safetensors").read_bytes() == b"a week's work"


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (ImportError("no torch here"), 1)])
def test_what_ends_a_command_while_it_is_imported(monkeypatch, capsys, error, code):
    def fails(name):
        raise error

    monkeypatch.setattr("nvsdata.cli.import_module", fails)
    assert main(["demo"]) == code
    assert capsys.readouterr().err.strip() in ("interrupted", "nvsdata demo: no torch here")


def test_sizes_are_explained(capsys, file):
    with pytest.raises(SystemExit, match="2"):
        main(["convert", str(file), "b.h5", "--sensor-size", "240,180"])
    assert "WIDTHxHEIGHT, such as 240x180, not '240,180'" in capsys.readouterr().err


ODD = os.fsdecode(b"new\nline \xff\xe9 \xce\xbc\x1b[31m")
ODD_SHOWN = r"new\nline \udcff\udce9 μ\x1b[31m"


@pytest.fixture
def terminal(monkeypatch):
    """A function that runs a command at a terminal that knows ASCII only; its exit code and the lines it printed."""

    def run(*words):
        streams = {name: io.TextIOWrapper(io.BytesIO(), encoding="ascii") for name in ("stdout", "stderr")}
        with monkeypatch.context() as patched:
            for name, stream in streams.items():
                patched.setattr(sys, name, stream)
            code = main([str(word) for word in words])
        for stream in streams.values():
            stream.flush()
        return code, *(stream.buffer.getvalue().decode("ascii").splitlines() for stream in streams.values())

    return run


@pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="names of files are Unicode here")
def test_files_of_any_name_can_be_told_of_and_converted(tmp_path, terminal):
    ascii_name = ODD_SHOWN.replace("μ", r"\u03bc")
    ev = trees.some(5)
    source, target = tmp_path / f"{ODD}.h5", tmp_path / f"{ODD}.aedat"
    nvsdata.write(ev, source)
    code, out, err = terminal("info", source, tmp_path / f"{ODD}.txt")
    assert code == 1
    assert out[0] == f"{tmp_path}/{ascii_name}.h5"
    assert len(out) == 8
    assert len(err) == 1
    code, out, err = terminal("convert", source, target)
    assert (code, err) == (0, [])
    assert out == [f"60 events in {tmp_path}/{ascii_name}.aedat"]
    assert nvsdata.read(target, sensor_size=(34, 34)) == ev
    code, out, err = terminal("compare", source, target, "--image", tmp_path / f"{ODD}.png", "--sensor-size", "34x34")
    assert (code, err) == (0, [])
    assert out[0].startswith(f"A  {tmp_path}/{ascii_name}.h5  Events(60 events")
    assert out[-1] == f"image: {tmp_path}/{ascii_name}.png"
    assert (tmp_path / f"{ODD}.png").stat().st_size > 0


@pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="names of files are Unicode here")
def test_verify_gives_a_fault_a_line_whatever_the_name(tmp_path, terminal):
    folder = tmp_path / ODD
    folder.mkdir()
    (folder / f"{ODD}.bin").write_bytes(b"abcdefg")
    (folder / f"{ODD}.h5").write_bytes(b"abcdefg")
    (folder / "whole.bin").write_bytes(trees.atis(trees.some(1)))
    code, out, _ = terminal("verify", tmp_path)
    name = ODD_SHOWN.replace("μ", r"\u03bc")
    assert code == 1
    assert out[0] == f"{name}/{name}.bin: 2 bytes of a torn record, cut off"
    assert out[1].startswith(f"{name}/{name}.h5: {tmp_path}/{name}/{name}.h5: ")
    assert out[2].startswith("2 recordings state no sensor size: ")
    assert out[3:] == ["3 recordings opened: 2 faults"]


@pytest.mark.skipif(os.name != "posix", reason="shells as POSIX has them")
@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_streams_that_are_closed(tmp_path, closed):
    """A file that took the number of stderr would hold what libraries print there."""
    command = f"{sys.executable} -m nvsdata record --simulate --seconds 0.2 --out {tmp_path / 'a.h5'} {closed}"
    assert subprocess.run(["sh", "-c", command]).returncode == 0
    assert len(nvsdata.read(tmp_path / "a.h5")) > 1_000


ORDERS = {  # arguments, and an option with the value that it may have
    "info": (["a.h5", "b.h5"], ["--json"]),
    "view": (["a.h5", "b.png"], ["--fps", "10"]),
    "gallery": (["root", "b.html"], ["--dataset", "n-mnist"]),
    "download": (["n-mnist"], ["--root", "a"]),
    "pack": (["root"], ["--dataset", "n-mnist", "--out", "a.h5"]),
    "precompute": (["root"], ["--dataset", "n-mnist", "--transform", "RadiusGraph()", "--out", "a.nvs"]),
    "join": (["a-1-of-2.nvs", "a-2-of-2.nvs"], ["--out", "a.nvs"]),
    "push": (["a.nvs", "b.nvs", "s3://a/b"], ["--overwrite"]),
    "fetch": (["s3://a/b.nvs"], ["--out", "a"]),
    "convert": (["a.h5", "b.raw"], ["--format", "evt2"]),
    "convert-videos": (["a"], ["--fps", "10"]),
    "compare": (["a.h5", "b.h5"], ["--fps", "10"]),
    "bench": (["decode", "load"], ["--only", "a"]),
    "verify": (["root"], ["--dataset", "n-mnist"]),
    "cache": (["info", "a", "b"], ["--json"]),
}


def test_every_command_with_arguments_has_its_orders():
    commands = {name: _parser(name)._subparsers._group_actions[0].choices[name] for name in COMMANDS}
    takes = [name for name, one in commands.items() if any(not action.option_strings for action in one._actions)]
    assert sorted(takes) == sorted(ORDERS)


@pytest.mark.parametrize("name", ORDERS)
def test_options_stand_before_between_and_after_arguments(name):
    given, option = ORDERS[name]
    found = [
        vars(_parser(name).parse_args([name, *given[:place], *option, *given[place:]]))
        for place in range(len(given) + 1)
    ]
    for one in found:
        del one["parser"]
        assert one == found[0]


def test_a_file_may_begin_with_a_dash(file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file.rename("-a.h5")
    assert main(["info", "--json", "--", "-a.h5"]) == 0
    assert main(["view", "--", "-a.h5", "-b.png"]) == 0
    with pytest.raises(SystemExit):
        main(["view", "a.h5", "--nothing", "x"])
    assert "unrecognized arguments: --nothing x" in capsys.readouterr().err
