"""Figures of the thesis: each is drawn without data, and with those that it takes."""

import sys

import cv2
import numpy as np
import pytest
from clips import write_video
from places import RECIPES
from test_compare_runs import write as write_run

import nvsdata

sys.path.insert(0, str(RECIPES))
import thesis_figure
import thesis_figures_networks as networks
import thesis_scenes as scenes


@pytest.mark.parametrize("number", thesis_figure.FIGURES)
def test_a_figure_needs_no_data(run, tmp_path, number):
    output = run("thesis_figure.py", number, "--out", tmp_path / "a.png")
    assert output.startswith(f"Figure {number}, remade by nvsdata. Data: ")
    image = cv2.imread(str(tmp_path / "a.png"))
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 20


def test_unknown_numbers_and_options_end_with_one_line(run, tmp_path):
    for arguments, message in (
        (("9.9",), "no figure 9.9: choose one of 3.2, 3.3, "),
        (("4.6", "--root", tmp_path), "figure 4.6 takes no --root; figures 3.2, "),
        (("3.3", "--run", tmp_path), "figure 3.3 takes no --run; figures 4.2, 5.4 do"),
    ):
        with pytest.raises(SystemExit) as ended:
            run("thesis_figure.py", *arguments)
        assert str(ended.value).startswith(f"thesis_figure.py: {message}")


@pytest.mark.parametrize("number", ["3.3", "3.4"])
def test_a_figure_of_an_interval_needs_two_frames(run, tmp_path, number):
    write_video(tmp_path / "a.avi", [np.zeros((48, 64, 3), np.uint8)])
    with pytest.raises(SystemExit, match="the figure needs at least 2 frames, not 1"):
        run("thesis_figure.py", number, "--root", tmp_path / "a.avi", "--out", tmp_path / "a.png")


def test_a_caption_is_below_the_image_in_lines_of_its_width():
    image = np.full((50, 300, 3), 7, np.uint8)
    short, long = (thesis_figure.with_caption(image, "word " * n) for n in (3, 60))
    assert (short[:50] == 7).all()
    assert (short[50:] < 200).any()
    assert short.shape[1] == 300
    assert long.shape[0] > short.shape[0] + 60


def test_a_scene_is_that_of_the_file(tmp_path):
    events = nvsdata.example().window(0, 120_000)
    frames = np.arange(4 * 180 * 240, dtype=np.uint32).reshape(4, 180, 240).astype(np.uint8)
    columns = {"t": events.t, "x": events.x, "y": events.y, "p": events.p}
    np.savez(tmp_path / "a.npz", frames=frames, frame_times=np.arange(4) * 40_000, **columns)
    scene = scenes.scene_of(tmp_path / "a.npz")
    assert (np.stack(scene.frames) == frames).all()
    assert scene.times == [0, 40_000, 80_000, 120_000]
    assert (scene.events.t == events.t).all()
    assert (scene.about, scene.camera) == ("a", "recorded")
    np.savez(tmp_path / "b.npz", frames=frames, frame_times=np.arange(3), **columns)
    with pytest.raises(nvsdata.FormatError, match=r"b\.npz.*with F times"):
        scenes.scene_of(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", frames=frames[:0], frame_times=np.arange(0), **columns)
    with pytest.raises(nvsdata.FormatError, match=r"b\.npz.*at least 1"):
        scenes.scene_of(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", frames=frames)
    with pytest.raises(nvsdata.FormatError, match=r"b\.npz.*isn't a file of frames and events"):
        scenes.scene_of(tmp_path / "b.npz")


def test_a_video_is_recorded_by_a_simulated_camera(run, tmp_path):
    write_video(tmp_path / "moving.avi")
    scene = scenes.scene_of(tmp_path / "moving.avi")
    assert (len(scene.frames), scene.camera) == (12, scenes.SIMULATED)
    assert len(scene.events) > 100
    output = run("thesis_figure.py", "3.4", "--root", tmp_path / "moving.avi", "--out", tmp_path / "a.png")
    assert "Data: frames of moving.avi." in output


def test_a_typical_frame_is_not_one_after_a_cut():
    t = np.concatenate([np.full(count, 10 * n + 5) for n, count in enumerate((10, 900, 11, 2))])
    events = nvsdata.Events(t, 0 * t, 0 * t, 0 * t, (2, 2))
    assert thesis_figure.events.typical(events, [0, 10, 20, 30, 40]) == 3


def test_recordings_of_a_dataset_take_the_place_of_letters(run, fake_nmnist, tmp_path):
    flags = ("--root", fake_nmnist, "--dataset", "n-mnist", "--out", tmp_path / "a.png")
    assert "a recording of each class of n-mnist" in run("thesis_figure.py", "4.5", *flags)


def test_letters_are_in_the_middle_and_differ():
    images = [scenes.letter(name) for name in scenes.LETTERS]
    for image in images:
        y, x = np.nonzero(image > 40)
        assert abs(x.min() + x.max() - 63) <= 1
        assert abs(y.min() + y.max() - 63) <= 1
    assert len({image.tobytes() for image in images}) == 26


def test_pairs_are_half_of_one_class():
    labels = [0, 0, 0, 1, 1, 2]
    pairs, same = scenes.pairs_of(labels)
    assert (len(pairs), same.sum()) == (8, 4)
    assert [labels[a] == labels[b] for a, b in pairs] == same.tolist()
    assert len({tuple(pair) for pair in pairs}) == 8


def test_similarity_of_a_run_is_that_of_its_predictions(tmp_path):
    folder = write_run(tmp_path / "a", [1, 1, 0, 1], sure=20.0)
    np.savez(folder / "scores.npz", scores=20 * np.eye(2, dtype=np.float32)[[0, 0, 1, 1]][None], targets=[0, 0, 1, 1])
    scores, same = networks.of_run(folder)
    assert (scores > 0.5).tolist() == same.tolist()
    assert 0 < same.sum() < len(same)


def test_a_diagram_has_the_layers_and_shapes_of_the_network():
    model, graph, _ = networks.network_and_graph(thesis_figure.argparse.Namespace(run=[]))
    boxes = networks.boxes(model, graph)
    names = [box.name.split("\n")[0] for box in boxes]
    assert names == [
        *("graph", "Conv(1, 64)", "MaxP 4x3", "Res_g(64, 128)", "MaxP 16x12", "Res_g(128, 256)", "MaxP 30x23"),
        *("Res_g(256, 512)", "MaxP 60x45", "FC(1024)", "Dropout", "FC(101)"),
    ]
    assert sum(box.weights for box in boxes) == sum(p.numel() for p in model.parameters())
    assert boxes[0].output == f"{graph.num_nodes:,} nodes x 1\n{graph.num_edges:,} edges"
    assert boxes[-1].output == "[1, 1024] to [1, 101]"


@pytest.mark.parametrize("width", [400, 760, 1500])
def test_a_caption_is_not_cut(width):
    text = "Figure 4.6, remade by nvsdata. Data: the numbers in nvsdata's registry; N-Caltech101 is without the class "
    image = thesis_figure.with_caption(
        np.full((20, width, 3), 255, np.uint8), text + "Faces. Both axes are logarithmic."
    )
    assert image.shape[1] == width
    assert (image[:, -4:] == 255).all()
    assert (image < 128).any()
