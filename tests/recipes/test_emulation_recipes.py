"""The recipes on emulation, run as a user would, on a small video."""

import json

import cv2
import numpy as np
import pytest
from clips import write_video

import nvsdata
from nvsdata import PIX2NVS
from nvsdata.emulation import DVS


@pytest.fixture(scope="module")
def squares(tmp_path_factory):
    """Squares that move over a still ground."""
    ground = np.random.default_rng(0).integers(50, 70, (48, 64, 3), dtype=np.uint8)
    pictures = []
    for n in range(12):
        picture = ground.copy()
        picture[8:18, 2 * n : 2 * n + 10], picture[30:40, 50 - 3 * n : 58 - 3 * n] = 200, 10
        pictures.append(picture)
    return write_video(tmp_path_factory.mktemp("video") / "squares.avi", pictures)


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    """A camera that passes over a blotchy ground."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.uniform(0, 255, (100, 130, 3)), (0, 0), 3)
    ground = np.interp(ground, (ground.min(), ground.max()), (5, 250)).astype(np.uint8)
    pictures = [ground[n : n + 48, 2 * n : 2 * n + 64] for n in range(12)]
    return write_video(tmp_path_factory.mktemp("video") / "ground.avi", pictures)


def test_the_distances_move_as_in_table_3_2(run, squares, tmp_path):
    out = run("validate_metrics.py", "--video", squares, "--size", "64x48", "--out", tmp_path / "a.json")
    rows = {row["events"]: row for row in json.loads((tmp_path / "a.json").read_text())}
    assert list(rows) == [
        "original",
        *("SD 32x24", "SD 21x16", "SD 16x12"),
        *("TD fps/2", "TD fps/3"),
        *("AN 1%", "AN 3%", "AN 5%", "AN 7%"),
    ]
    original = rows.pop("original")
    for name, row in rows.items():
        assert name in out
        assert row["chamfer"] > original["chamfer"]
        assert row["repeatability"] <= original["repeatability"]
        assert row["emd"] > original["emd"]


def test_the_search_beats_the_rows_of_table_3_3(run, ground, tmp_path):
    nvsdata.write(PIX2NVS(threshold=0.3, noise_rate=2, mismatch=0.1).emulate(ground), tmp_path / "real.h5")
    out = run("tune_pix2nvs.py", "--real", tmp_path / "real.h5", "--video", ground, "--trials", 40, "--out", tmp_path)
    table = out.split("\n\n")[0].splitlines()[2:]
    assert len(table) == 6
    assert table[-1].split()[0] == "camera"
    assert float(out.rstrip().split(" times that")[0].split()[-1]) < 1
    for name in ("table.txt", "score.png", "best.png", "trials.jsonl"):
        assert (tmp_path / name).stat().st_size > 0
    rows = json.loads((tmp_path / "rows.json").read_bytes())
    assert list(rows) == [f"row {n}" for n in range(1, 6)]
    scores = sorted((cells["Score"] for cells in rows.values()), reverse=True)
    # from the worst to the best, before the columns of event counts
    assert [f"{score:.3f}" for score in scores] == [line.split()[-3] for line in table[:-1]]


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Frames, and the events that a hidden sensor gave of what was between them, 5 ms late."""
    ground = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, (60, 200)), (0, 0), 3)
    ground = np.interp(ground, (ground.min(), ground.max()), (5, 250)).astype(np.float32)

    def still(ms):
        moved = cv2.warpAffine(ground, np.float32([[1, 0, -0.1 * ms], [0, 1, 0]]), (90, 60))
        return np.rint(moved).astype(np.uint8)

    events = DVS(on=0.35, off=0.25, dark=5).emulate([still(ms) for ms in range(281)], fps=1_000)
    frames = np.stack([still(ms) for ms in range(0, 281, 40)])
    path = tmp_path_factory.mktemp("pair") / "hidden.npz"
    columns = {"t": events.t + 5_000, "x": events.x, "y": events.y, "p": events.p}
    np.savez(path, frames=frames, frame_times=np.arange(8) * 40_000, **columns)
    return path


def test_the_fitted_pixel_is_the_closest_to_a_hidden_one(run, pair, tmp_path):
    said = run("emulation_accuracy.py", pair, "--out", tmp_path, "--trials", 8)
    rows = {row.pop("emulator"): row for row in json.loads((tmp_path / "hidden.json").read_text())}
    assert list(rows) == [
        *("PIX2NVS", "PIX2NVS, tuned", "DVS, not fitted", "one threshold", "one threshold, dark, flow"),
        *("thresholds", "thresholds, flow", "thresholds, dark", "DVS, fitted", "DVS, fitted with noise"),
    ]
    for row in rows.values():
        assert all(low <= value <= high for value, low, high in row.values())
    fitted = {name: value[0] for name, value in rows["DVS, fitted"].items()}
    for name in ("PIX2NVS", "PIX2NVS, tuned", "DVS, not fitted", "one threshold"):
        row = {figure: value[0] for figure, value in rows[name].items()}
        assert name in said
        # one that fires too little comes close, but not back
        assert fitted["chamfer"] + fitted["chamfer_back"] < row["chamfer"] + row["chamfer_back"]
        assert fitted["correlation"] > row["correlation"]
    assert abs(fitted["on"] - 1) < 0.1
    assert abs(fitted["off"] - 1) < 0.15
    assert (tmp_path / "hidden.txt").read_text().splitlines()[0] == "hidden.npz"
    for half in ("first", "last"):
        assert f"hidden.npz, {half} half: delay " in said
        assert cv2.imread(str(tmp_path / f"hidden-{half}.png")).std() > 10


def test_pairs_of_too_few_frames_are_refused(run, pair, tmp_path):
    with np.load(pair) as data:
        np.savez(tmp_path / "few.npz", **{name: data[name][:3] if "frame" in name else data[name] for name in data})
    with pytest.raises(SystemExit) as ended:
        run("emulation_accuracy.py", tmp_path / "few.npz", "--out", tmp_path)
    said = str(ended.value)
    assert said.startswith("emulation_accuracy.py: ")
    assert said.endswith("few.npz: 3 frames, at least 4 are needed to fit and to test")
    assert "\n" not in said
