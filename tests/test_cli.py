import subprocess
import sys

import numpy as np
import pytest

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
