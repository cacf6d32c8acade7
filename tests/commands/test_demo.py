"""The demo's shapes, scenes and recordings, by hand."""

import math

import numpy as np
import pytest

import nvsdata
from nvsdata import Events, plots
from nvsdata import transforms as T
from nvsdata.training import demo

# points of each shape of about radius 1, and how far they are from its edge: inside is below 0
DISTANCES = {
    "disc": {(0, 0): -1, (1, 0): 0, (0, -1): 0, (0.6, 0.8): 0, (3, 4): 4},
    "ring": {(0, 0): 0.55, (0.8, 0): -0.25, (0, 1.05): 0, (-0.55, 0): 0, (0, -2): 0.95},
    "square": {(0, 0): -0.9, (0.9, 0.5): 0, (-0.9, 0.5): 0, (0.3, 0.9): 0, (0.2, -1): 0.1, (2, 0): 1.1},
    "triangle": {(0, 0): -0.55, (0, 1.1): 0, (0.4, -0.55): 0, (0.5, 0.23): 0, (-0.5, 0.23): 0, (0, -1): 0.45},
    "cross": {(0, 0): -0.3, (0.3, 0.6): 0, (-0.6, 0.3): 0, (0, 1): 0, (-1, 0): 0, (1.5, 0): 0.5, (1, 1): 0.7},
}  # fmt: skip


@pytest.mark.parametrize("name", demo.SHAPES)
def test_how_far_places_are_from_the_edge_of_a_shape(name):
    places = np.array(list(DISTANCES[name]), float)
    found = demo.SHAPES[name](places[:, 0], places[:, 1])
    assert found.tolist() == pytest.approx(list(DISTANCES[name].values()), abs=1e-9)


class Dice:
    """Draws from the given part of each range, from 0 at its beginning to 1 at its end; of two, one from each side."""

    def __init__(self, part):
        self.part = part

    def uniform(self, low, high, size=None):
        value = low + self.part * (high - low)
        return value if size is None else np.array([value, low + high - value])


# radius in pixels, angle around the center, tilt, how far it turns until the end, column of the center
SCENES = {0.0: (6, 0, -0.25, -0.4, 15), 0.5: (7.5, math.pi, 0, 0, 17), 1.0: (9, 2 * math.pi, 0.25, 0.4, 19)}


@pytest.mark.parametrize("part", SCENES)
@pytest.mark.parametrize("shape", ["disc", "cross", "triangle"])
def test_a_shape_circles_and_turns(shape, part):
    radius, phase, tilt, turn, center = SCENES[part]
    frames = demo.scene(shape, Dice(part))
    assert (frames.shape, frames.dtype) == ((161, 34, 34), np.float32)
    row, column = np.mgrid[:34, :34]
    for number in (0, 40, 117, 160):
        share = number / 160
        middle = center + (34 - center) * 1j + 4 * np.exp(1j * (phase + 2 * math.pi * share))
        seen = (column + 1j * row - middle) * np.exp(-1j * (tilt + turn * share)) / radius
        # from dark to bright within a pixel of the edge
        bright = np.clip(0.5 - radius * demo.SHAPES[shape](seen.real, seen.imag), 0, 1)
        np.testing.assert_allclose(frames[number], 0.15 + 0.85 * bright, atol=1e-5)


def test_a_disc_is_as_large_as_it_should_be_and_never_leaves():
    frames = demo.scene("disc", Dice(1.0))
    area = ((frames - 0.15) / 0.85).sum((1, 2))
    assert area == pytest.approx(np.full(161, math.pi * 9**2), rel=0.01)
    assert frames.min() == pytest.approx(0.15)
    assert frames.max() == 1


def test_from_recording_to_graph():
    times = np.arange(0, 80_000, 10)
    ev = Events(times, times // 10 % 34, times // 340 % 34, times // 10 % 2, (34, 34))
    graph = demo.pipeline(augmented=False)(ev)
    assert 0 < graph.num_nodes < 3_000
    assert 29_900 < int(graph.t.max()) < 30_000
    names = [type(step).__name__ for step in demo.pipeline(augmented=True).transforms]
    assert names == ["RandomWindow", "NonUniformSample", "RadiusGraph", "RandomScale", "RandomRotate"]
    assert repr(demo.pipeline(augmented=False)) == repr(
        T.Compose([T.RandomWindow(30_000), T.NonUniformSample(2), T.RadiusGraph()])
    )


def test_recordings_are_made_once_for_each_seed(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "COUNTS", {"train": 2, "test": 1})
    monkeypatch.setattr(demo, "SHAPES", {"cross": demo.SHAPES["cross"]})
    folder = tmp_path / "new" / "shapes"
    demo.make_dataset(folder, 0)
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.h5"))
    assert names == ["test/cross/000.h5", "train/cross/000.h5", "train/cross/001.h5"]
    ev = nvsdata.read(folder / names[0])
    # 161 frames at 2000 per second
    assert (ev.sensor_size, ev.end) == ((34, 34), 80_000)
    assert len(ev) > 500
    # what was interrupted, or is another seed's, is made anew
    for mark in ("", "9"):
        (folder / demo.MARK).write_text(mark)
        (folder / "train/cross/extra.h5").touch()
        demo.make_dataset(folder, 0)
        assert not (folder / "train/cross/extra.h5").exists()
    assert nvsdata.read(folder / names[0]) == ev


def test_the_picture_shows_the_beginnings_of_eight_recordings_of_each_shape(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "SHAPES", {name: demo.SHAPES[name] for name in ("disc", "ring")})
    for shape in demo.SHAPES:
        for n in range(9):
            path = tmp_path / "train" / shape / f"00{n}.h5"
            path.parent.mkdir(parents=True, exist_ok=True)
            nvsdata.write(Events([0, 9_999, 10_000], [n, n, 30], [3, n, 30], [1, 0, 1], (34, 34)), path)
    shown = [Events([0, 9_999], [n, n], [3, n], [1, 0], (34, 34)) for n in range(8)]
    rows = [(shape, [plots.event_image(ev, zoom=3) for ev in shown]) for shape in demo.SHAPES]
    assert np.array_equal(demo._samples_picture(tmp_path), plots.contact_sheet(rows))


def test_only_what_is_trained_on_is_augmented(tmp_path, monkeypatch):
    made = []

    class Folder:
        def __init__(self, root, split, transform):
            self.root, self.split_name, self.transform, self.classes = root, split, transform, list("ab")
            made.append(self)

        def __len__(self):
            return 10

        def split(self, share, seed):
            return self, Folder(self.root, "validation", self.transform)

    def network(name, classes):
        raise OSError("enough")

    monkeypatch.setattr(demo, "make_dataset", lambda root, seed: made.append((root, seed)))
    monkeypatch.setattr(demo, "EventFolder", Folder)
    monkeypatch.setattr(demo, "_samples_picture", lambda data: np.zeros((2, 2, 3), np.uint8))
    monkeypatch.setattr(demo.models, "rgcnn", network)
    with pytest.raises(OSError, match="enough"):
        demo.train(tmp_path, 1, 7)
    dataset, *folders = made
    assert dataset == (tmp_path / "shapes", 7)
    assert [(data.root, data.split_name, len(data.transform.transforms)) for data in folders] == [
        (tmp_path / "shapes", "train", 5),
        (tmp_path / "shapes", "validation", 3),
        (tmp_path / "shapes", "test", 3),
    ]


@pytest.mark.parametrize("name", ["log.jsonl", "checkpoint.pt", "model.safetensors"])
def test_a_training_that_is_not_the_demos_is_left_alone(tmp_path, monkeypatch, name):
    def made(root, seed):
        raise OSError("the demo's own")

    monkeypatch.setattr(demo, "make_dataset", made)
    (tmp_path / name).touch()
    with pytest.raises(FileExistsError, match=f"contains a training \\({name}\\) that isn't the demo's"):
        demo.train(tmp_path, 1, 0)
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / demo.MARK).touch()
    with pytest.raises(OSError, match="the demo's own"):
        demo.train(tmp_path, 1, 0)
