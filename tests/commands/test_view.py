import re

import cv2
import numpy as np
import pytest
import trees
from PIL import Image

import nvsdata
from nvsdata import Events
from nvsdata.cli import main

MS = np.arange(300)
EVENTS = Events(10**12 + MS * 1_000, MS % 30, MS % 20, MS % 2, (34, 30))


@pytest.fixture
def file(tmp_path, monkeypatch):
    nvsdata.write(EVENTS, tmp_path / "a.h5")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "a.h5"


def test_a_page_is_written_beside_nothing_else(file, tmp_path, capsys):
    assert main(["view", str(file)]) == 0
    assert "300 events in a.h5.html" in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "a.h5.html"]
    assert "300 events, 299.0 ms, 34x30 pixels" in (tmp_path / "a.h5.html").read_text("utf-8")


def test_the_size_of_a_page_is_stated_and_a_large_one_says_how_to_make_it_smaller(file, tmp_path, capsys, monkeypatch):
    assert main(["view", str(file)]) == 0
    size = (tmp_path / "a.h5.html").stat().st_size
    out, err = capsys.readouterr()
    assert out == f"300 events in a.h5.html, {size / 1e6:.1f} MB\n"
    assert err == ""
    for limit, large in ((size, False), (size - 1, True)):
        monkeypatch.setattr("nvsdata.commands.view.LARGE", limit)
        assert main(["view", str(file), "--overwrite"]) == 0
        assert ("--start and --stop select a part" in capsys.readouterr().err) == large


def test_pictures_and_films(file, tmp_path):
    assert main(["view", str(file), "a.png", "--duration", "5000"]) == 0
    assert cv2.imread(str(tmp_path / "a.png")).ndim == 3
    assert main(["view", str(file), "a.gif", "--events", "30", "--zoom", "1", "--fps", "10"]) == 0
    with Image.open(tmp_path / "a.gif") as gif:
        assert (gif.size, gif.n_frames) == ((34, 30), 10)
    # a tenth of the speed, a tenth of the time: as long as the whole
    window = ["--start", "0", "--stop", "30000"]
    assert main(["view", str(file), "a.mp4", "--speed", "0.1", *window]) == 0
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 9
    assert video.get(cv2.CAP_PROP_FRAME_WIDTH) == 34 * (480 // 34)


def test_what_is_there_stays(file, tmp_path, capsys):
    (tmp_path / "a.png").write_text("mine")
    assert main(["view", str(file), "a.png"]) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert (tmp_path / "a.png").read_text() == "mine"
    assert main(["view", str(file), "a.png", "--overwrite"]) == 0
    assert cv2.imread(str(tmp_path / "a.png")) is not None


def test_wrong_paths_and_files(file, tmp_path, capsys):
    assert main(["view", "nowhere.h5"]) == 1
    assert "nowhere.h5" in capsys.readouterr().err
    (tmp_path / "bad.bin").write_bytes(b"abc")
    assert main(["view", "bad.bin"]) == 1
    assert "byte 0: truncated" in capsys.readouterr().err
    assert main(["view", str(file), "nowhere/a.png"]) == 1
    for wrong in ("a.avi", "a"):
        with pytest.raises(SystemExit) as ended:
            main(["view", str(file), wrong])
        assert ended.value.code == 2
        assert "OUT must end in one of .html, .png, .gif, .mp4" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "bad.bin"]


@pytest.fixture
def classes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("cat", "dog & co")):
        for i in range(4 - number):
            path = tmp_path / "pets" / name / f"{i}.bin"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(trees.atis(trees.some(i, 10 * (i + 1))))
    return tmp_path / "pets"


def rows(page):
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", page)[1:]]
    return {row[0]: (row[1:4], row[7].count("<img")) for row in cells}


def test_a_gallery_has_a_row_for_each_class(classes, capsys):
    assert main(["gallery", "pets", "--images", "2"]) == 0
    assert "7 of 7 recordings read: pets.html" in capsys.readouterr().out
    page = (classes.parent / "pets.html").read_text("utf-8")
    assert rows(page) == {
        "cat": (["4", "4", "25"], 2),
        "dog &amp; co": (["3", "3", "20"], 2),
        "<b>all</b>": (["7", "7", "20"], 0),
    }
    assert main(["gallery", "pets", "b.html", "--read", "1"]) == 0
    assert rows((classes.parent / "b.html").read_text("utf-8"))["<b>all</b>"][0][:2] == ["7", "2"]


def test_a_gallery_says_what_it_could_not_read(classes, capsys):
    (classes / "cat" / "0.bin").write_bytes(trees.atis(trees.some(5)) + b"xy")
    assert main(["gallery", "pets"]) == 1
    out, err = capsys.readouterr()
    assert "6 of 7 recordings read" in out
    assert "cat/0.bin" in err
    page = (classes.parent / "pets.html").read_text("utf-8")
    assert "Not read: 1" in page
    assert rows(page)["cat"][0][:2] == ["4", "3"]


def test_galleries_that_are_not_to_be_had(classes, capsys):
    assert main(["gallery", "nowhere"]) == 1
    assert "nowhere" in capsys.readouterr().err
    for wrong, reason in ((["pets", "a.png"], "must end in .html"), (["pets", "--split", "half"], "--split")):
        with pytest.raises(SystemExit):
            main(["gallery", *wrong])
        assert reason in capsys.readouterr().err
    assert [path.name for path in classes.parent.iterdir()] == ["pets"]


def test_a_notebook_shows_a_dataset(classes):
    text = nvsdata.EventFolder("pets", "all")._repr_html_()
    assert text.startswith("<pre>EventFolder: 7 recordings, 2 classes")
    assert re.findall(r'title="(.*?)"', text) == ["cat", "dog &amp; co"]
    (classes / "cat" / "0.bin").write_bytes(b"abc")
    assert re.findall(r'title="(.*?)"', nvsdata.EventFolder("pets", "all")._repr_html_()) == ["dog &amp; co"]


def test_a_gallery_of_pairs_is_none(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    trees.put(tmp_path / "aslan", trees.aslandvs(view2=True))
    assert main(["gallery", "aslan", "--dataset", "aslan-dvs"]) == 1
    assert (
        "samples of ASLANDVS are pairs of recordings: use `nvsdata view` for single recordings"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "aslan.html").exists()


def test_a_gallery_draws_from_all_and_shows_six(classes, capsys):
    for i in range(4, 30):
        (classes / "cat" / f"{i}.bin").write_bytes(trees.atis(trees.some(i, 10)))
    assert main(["gallery", "pets"]) == 0
    # 20 of 30 cats, and 3 dogs
    assert "23 of 33 recordings read" in capsys.readouterr().out
    page = (classes.parent / "pets.html").read_text("utf-8")
    assert (rows(page)["cat"][0][:2], rows(page)["cat"][1]) == (["30", "20"], 6)
    shown = set(re.findall(r"cat/(\d+)\.bin", page))
    assert len(shown) == 6
    assert shown != {str(i) for i in range(6)}
    assert main(["gallery", "pets", "again.HTML"]) == 0
    assert set(re.findall(r"cat/(\d+)\.bin", (classes.parent / "again.HTML").read_text("utf-8"))) == shown


def test_a_window_without_the_recording_writes_nothing_and_says_why(file, tmp_path, capsys):
    for window in (["--stop", "0"], ["--start", "299001"], ["--start", str(10**12)]):
        assert main(["view", str(file), *window]) == 1
        err = capsys.readouterr().err
        assert f"{file}: the window [" in err
        assert "the recording's events are at 0 to 299000 µs; --start and --stop count from the first event" in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.filterwarnings("error")
def test_a_window_counts_from_the_first_event(file, tmp_path, capsys):
    assert main(["view", str(file), "a.png", "--start", "10000", "--stop", "30000"]) == 0
    assert "20 events in a.png" in capsys.readouterr().out
    # between two events there may be none
    assert main(["view", str(file), "b.png", "--start", "10001", "--stop", "11000"]) == 0
    assert "0 events in b.png" in capsys.readouterr().out
    assert main(["view", str(file), "c.png", "--start", "299000", "--stop", "299001"]) == 0
    assert "1 events in c.png" in capsys.readouterr().out
    # so do the times of the player
    for name, start, offset in (("a.html", ["--start", "9500"], 9_500), ("b.html", ["--stop", "20000"], 0)):
        assert main(["view", str(file), name, *start]) == 0
        assert re.findall(r'"offset": ?(\d+)', (tmp_path / name).read_text("utf-8")) == [str(offset)]


def test_a_window_that_ends_after_the_recording_is_warned_of(file, capsys):
    with pytest.warns(UserWarning, match="a.h5: --stop 299002 is after the last event; the recording's events are at"):
        assert main(["view", str(file), "a.png", "--start", "290000", "--stop", "299002"]) == 0
    assert "10 events in a.png" in capsys.readouterr().out


def test_a_recording_of_unknown_span_is_asked_for_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.bin").write_bytes(trees.atis(trees.some(1, first=1_000_000)))
    assert main(["view", "a.bin", "--stop", "0"]) == 1
    assert "a.bin: the window [, 0) has no events" in capsys.readouterr().err
