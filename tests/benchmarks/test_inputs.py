"""What a folder has to work on, and what takes the place of the rest."""

import numpy as np
import pytest

import nvsdata
from nvsdata.benchmarks import inputs
from nvsdata.benchmarks.case import Options

ALL = ["N-MNIST", "recording of a 240x180 sensor", "video", "pairs of frames and events"]


def test_an_empty_folder_lacks_everything(tmp_path):
    assert inputs.missing_recordings(tmp_path) == ALL


@pytest.mark.parametrize(
    ("name", "found"), [("N-MNIST/Train/0/a.bin", 0), ("a/b.mp4", 2), ("a.avi", 2), ("a/pairs/b.npz", 3)]
)
def test_what_is_there_is_found(tmp_path, name, found):
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).touch()
    assert inputs.missing_recordings(tmp_path) == ALL[:found] + ALL[found + 1 :]


def test_the_largest_recording_of_the_sensor_is_the_street(tmp_path):
    """Neither a larger one of another sensor, nor one that can't be read, nor a smaller one."""
    for count, size, name in ((900, (346, 260), "a.h5"), (700, (240, 180), "b.h5"), (80, (240, 180), "c.h5")):
        nvsdata.write(inputs.random_events(count, size), tmp_path / name)
    (tmp_path / "d.aedat4").write_bytes(bytes(10**6))
    assert len(inputs.sensor_recording(Options(tmp_path, data=tmp_path))) == 700
    assert inputs.missing_recordings(tmp_path) == [ALL[0], *ALL[2:]]


def test_without_a_folder_scenes_are_simulated(tmp_path):
    options = Options(tmp_path)
    assert inputs.sensor_recording(options).sensor_size == (240, 180)
    assert inputs.video(options) is None
    digits = inputs.digits(options, 3)
    assert [events.sensor_size for events in digits] == [(34, 34)] * 3
    assert not np.array_equal(digits[0].x, digits[1].x)
