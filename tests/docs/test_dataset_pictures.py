"""Pictures of datasets, drawn from what lies on the machine that builds the site."""

import re

import cv2
import dataset_pictures
import facts
import look_alikes
import numpy as np
import pytest

from nvsdata import Events, formats
from nvsdata.datasets import DATASETS


@pytest.fixture(autouse=True)
def nothing_here(monkeypatch, tmp_path):
    monkeypatch.setattr(dataset_pictures, "SAMPLES", tmp_path / "samples")
    monkeypatch.delenv(dataset_pictures.HOME, raising=False)
    dataset_pictures._tiles.cache_clear()


def decoded(content):
    return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)


def test_a_recording_of_each_class_of_a_dataset_that_is_here(tmp_path, monkeypatch):
    assert dataset_pictures.picture("n-mnist") is None
    for digit in range(3):
        ev = Events(np.arange(500) * 100, np.full(500, 10 + digit), np.arange(500) % 34, [digit % 2] * 500, (34, 34))
        path = tmp_path / f"here/N-MNIST/Train/{digit}/00001.bin"
        path.parent.mkdir(parents=True)
        formats.write(ev, path)
    monkeypatch.setenv(dataset_pictures.HOME, str(tmp_path / "here"))
    dataset_pictures._tiles.cache_clear()
    text, content = dataset_pictures.picture("n-mnist")
    assert text == "30 ms of recordings: ON in red, OFF in blue"
    picture = decoded(content).astype(int)
    assert picture.shape[1] > 3 * 170
    # OFF, ON, OFF
    blue, red = (picture[..., 0] - picture[..., 2] > 100), (picture[..., 2] - picture[..., 0] > 100)
    thirds = np.array_split(np.arange(picture.shape[1]), 3)
    assert [bool(blue[:, x].sum() > red[:, x].sum()) for x in thirds] == [True, False, True]
    assert dataset_pictures.picture("n-cars") is None


def test_samples_that_lie_beside_the_repository(tmp_path):
    (tmp_path / "samples/samples").mkdir(parents=True)
    ev = Events([0, 10], [3, 4], [5, 6], [0, 1], (120, 100))
    formats.write(ev, tmp_path / "samples/samples/sample_ncars.dat")
    text, content = dataset_pictures.picture("n-cars")
    assert text == "A recording: ON in red, OFF in blue"
    assert decoded(content).size


def test_drawn_scenes_stand_in_for_what_is_not_here(tmp_path):
    text, content = dataset_pictures.picture("asl-dvs")
    assert text.startswith("No recordings: 30 ms of drawn scenes, emulated for this page")
    picture = decoded(content).astype(int)
    # both polarities are there
    assert (picture[..., 0] - picture[..., 2] > 100).sum() > 100
    assert (picture[..., 2] - picture[..., 0] > 100).sum() > 100
    assert dataset_pictures.picture("n-mnist") is None


def test_the_table_names_no_image_that_is_not_made_here():
    shown = re.findall(r"!\[\]\(([\w-]+)\.png\)", facts.table("datasets"))
    # as docs/hooks.py makes them
    made = {f"{name}-small" for name in DATASETS if name != "folder" and dataset_pictures.thumbnail(name)}
    assert {"n-mnist", "asl-dvs-small"} <= set(shown) <= made | {"n-mnist"}
    assert "n-cars-small" not in shown
    assert "[NCARS](n-cars.md)" in facts.table("datasets")


@pytest.mark.parametrize("name", look_alikes.SCENES)
def test_scenes_have_the_sensor_of_their_dataset(name):
    size = DATASETS[name].info.sensor_size
    found = look_alikes.look_alikes(name, size or (240, 180))
    assert len(found) >= 3
    assert all(len(events) > 500 and events.sensor_size == (size or (240, 180)) for events in found.values())
