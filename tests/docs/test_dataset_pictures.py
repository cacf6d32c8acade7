"""Pictures of datasets, drawn from what lies on the machine that builds the site."""

import cv2
import dataset_pictures
import numpy as np
import pytest

from nvsdata import Events, formats


@pytest.fixture(autouse=True)
def nothing_here(monkeypatch, tmp_path):
    monkeypatch.setattr(dataset_pictures, "SAMPLES", tmp_path / "samples")
    monkeypatch.delenv(dataset_pictures.HOME, raising=False)


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
