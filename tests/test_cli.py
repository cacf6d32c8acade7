import subprocess
import sys

import h5py
import numpy as np
import pytest
import trees

import nvsdata
from nvsdata import Events
from nvsdata.cli import main


@pytest.fixture
def file(tmp_path):
    nvsdata.write(Events([0, 10, 10, 1_000_000], [1, 2, 2, 3], [1, 2, 2, 3], [1, 1, 1, 0], (34, 30)), tmp_path / "a.h5")
    return tmp_path / "a.h5"


def test_info_says_what_is_in_a_file(file, capsys):
    assert main(["info", str(file)]) == 0
    out = capsys.readouterr().out
    for expected in ("hdf5", "34x30", "events     4", "1.000000 s", "4 events/s", "75.0% ON", "1 duplicate events"):
        assert expected in out


def test_info_goes_on_after_a_bad_file(file, tmp_path, capsys):
    (tmp_path / "bad.bin").write_bytes(b"abc")
    assert main(["info", str(tmp_path / "bad.bin"), str(tmp_path / "none.bin"), str(tmp_path), str(file)]) == 1
    out, err = capsys.readouterr()
    assert "byte 0: truncated" in err
    assert "none.bin" in err
    assert "is a directory" in err
    assert "34x30" in out


def test_info_of_an_empty_recording(tmp_path, capsys):
    nvsdata.write(Events.empty((5, 5)), tmp_path / "a.h5")
    assert main(["info", str(tmp_path / "a.h5")]) == 0
    assert "events     0" in capsys.readouterr().out


def test_help_imports_neither_torch_nor_numba():
    code = (
        "import sys\nfrom nvsdata.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "sys.exit(any(name in sys.modules for name in ('torch', 'numba', 'numpy')))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert "demo" in result.stdout


def test_an_unknown_command_is_a_usage_error(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["nonsense"])
    assert "invalid choice" in capsys.readouterr().err


def test_demo_makes_data_pictures_and_a_better_than_chance_model(tmp_path, monkeypatch, capsys):
    from nvsdata import demo

    monkeypatch.setattr(demo, "COUNTS", {"train": 6, "test": 2})
    out = tmp_path / "demo"
    assert main(["demo", "--out", str(out), "--seconds", "3"]) == 0
    printed = capsys.readouterr().out
    assert "accuracy on 10 recordings not trained on" in printed
    for name in ("samples.png", "learning.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert len(nvsdata.EventFolder(out / "shapes", "train")) == 30
    before = {p: p.stat().st_mtime_ns for p in out.glob("shapes/**/*.h5")}
    demo.make_dataset(out / "shapes", 0)
    assert before == {p: p.stat().st_mtime_ns for p in out.glob("shapes/**/*.h5")}


def test_ideal_events_are_threshold_crossings():
    from nvsdata.demo import ideal_events

    # one pixel whose log intensity rises by 1 over 10 frames, then falls by 0.5
    level = np.concatenate([np.linspace(0, 1, 11), np.linspace(1, 0.5, 6)[1:]])
    events = ideal_events(np.exp(level)[:, None, None], 100, 0.2)
    # up at 0.2, 0.4, 0.6, 0.8 (1.0 is met at the turn), and down 0.2 from there on
    ups = events.t[events.p == 1]
    assert np.allclose(ups[:4], [200, 400, 600, 800], atol=1)
    assert events.sensor_size == (1, 1)
    assert (np.diff(events.t) >= 0).all()
    net = events.p.astype(int) * 2 - 1
    assert abs(0.2 * net.sum() - 0.5) < 0.2


@pytest.fixture
def digits(tmp_path):
    return trees.put(tmp_path / "n-mnist", trees.nmnist())


def test_datasets_says_what_is_here_and_how_to_get_the_rest(digits, capsys):
    assert main(["datasets", "--root", str(digits.parent)]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert len(lines) == 13
    assert lines["n-mnist"].endswith(f"here: {digits}")
    assert "128x128" in lines["cifar10-dvs"]
    assert lines["cifar10-dvs"].endswith("nvsdata download cifar10-dvs")
    assert "by hand from https://" in lines["asl-dvs"]


def test_pack_then_verify_and_load(digits, tmp_path, capsys):
    (digits / "Train/3/00002.bin").write_bytes(b"abc")
    out = tmp_path / "n.h5"
    assert main(["pack", str(digits), "--dataset", "n-mnist", "--out", str(out)]) == 0
    captured = capsys.readouterr()
    assert "49 recordings" in captured.out
    assert "left out Train/3/00002.bin" in captured.err
    assert main(["verify", str(out)]) == 0
    assert len(nvsdata.NMNIST(out)) == 29
    with h5py.File(out, "r+") as file:
        file["events/p"][0] ^= 1
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
    assert "all sound" in capsys.readouterr().out


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
        (["pack", "nowhere", "--dataset", "n-mnist", "--out", "a.h5"], "no folder"),
        (["pack", ".", "--dataset", "mnist", "--out", "a.h5"], "no dataset 'mnist'"),
        (["download", "asl-dvs", "--root", "asl"], "with a browser from https://"),
        (["download", "yupenn-dvs"], "can't be downloaded"),
        (["verify", "nowhere"], "nowhere: there is nothing to verify"),
        (["convert", "nowhere", "a.h5"], "nowhere"),
    ],
)
def test_what_cannot_be_done_is_said(command, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(command) == 1
    assert message in capsys.readouterr().err
