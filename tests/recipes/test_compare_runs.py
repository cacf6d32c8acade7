"""Comparisons of runs whose predictions are made up."""

import re

import numpy as np
import pytest
from scipy import stats

from nvsdata.training.summary import COLUMNS


def write(folder, right, votes=1, windows=(0, 5), names=None, sure=1.0):
    """A run's predictions, given the number of right votes of each recording, all with one log-probability."""
    folder.mkdir(parents=True)
    names = names or [f"cat/{n}.bin" for n in range(len(right))]
    rows = [f"{name},,cat,cat,{n},{votes},{windows[0]},{windows[1]}" for name, n in zip(names, right, strict=True)]
    (folder / "predictions.csv").write_text("\n".join([",".join(COLUMNS), *rows, ""]))
    # class 1 is the true one
    scores = sure * np.eye(2, dtype=np.float32)[[int(n > votes / 2) for n in right]]
    np.savez(folder / "scores.npz", scores=scores[None], targets=np.ones(len(right), int))
    return folder


def test_one_run_each_by_mcnemars_test(run, tmp_path):
    rng = np.random.default_rng(0)
    a = rng.random(200) < 0.95
    b = a ^ (rng.random(200) < 0.1)
    output = run("compare_runs.py", write(tmp_path / "a", a.astype(int)), write(tmp_path / "b", b.astype(int)))
    better, worse = (a & ~b).sum(), (b & ~a).sum()
    p = stats.binomtest(int(better), int(better + worse)).pvalue
    assert "200 test recordings" in output
    votes = output[output.index("Votes") :]
    assert f"A: {a.mean():.3f} (" in votes
    assert f"B: {b.mean():.3f} (" in votes
    found = re.search(r"A is better by ([\d.]+) points, 95% interval (-?[\d.]+) to ([\d.]+), p (.*)", votes)
    assert float(found[1]) == pytest.approx(100 * (better - worse) / 200, abs=0.051)
    assert float(found[2]) < float(found[1]) < float(found[3])
    assert found[4] == (f"= {p:.2g}" if p >= 0.001 else "< 0.001")


def test_seeds_are_averaged_and_compared_with_fewer(run, tmp_path):
    for seed, right in enumerate(([1, 1, 1, 0], [1, 1, 0, 0], [1, 0, 0, 0])):
        write(tmp_path / "a" / str(seed), right)
    (tmp_path / "a" / "others").mkdir()
    output = run("compare_runs.py", tmp_path / "a", write(tmp_path / "b", [1, 1, 1, 1]))
    votes = output[output.index("Votes") :]
    assert "A: 0.500 (" in votes
    assert "), 3 runs: mean 0.500, standard deviation 0.250\n" in votes
    assert "B is better by 50.0 points" in votes


def test_runs_are_an_ensemble(run, tmp_path):
    names = ["cat/2.bin", "cat/0.bin", "cat/1.bin", "cat/3.bin"]
    write(tmp_path / "a/0", [1, 1, 0, 0])
    # as sure as the two others: right for 0 and 3
    write(tmp_path / "a/1", [0, 1, 0, 1], names=names, sure=2.5)
    write(tmp_path / "a/2", [1, 0, 1, 0])
    output = run("compare_runs.py", tmp_path / "a", write(tmp_path / "b", [1, 1, 1, 1]))
    ensembles = output[output.index("Ensembles") :]
    assert "A: 0.500 (" in ensembles
    assert "), number of networks: 3\n" in ensembles
    assert "B: 1.000 (" in ensembles
    assert "B is better by 50.0 points" in ensembles
    assert "Ensembles" not in run("compare_runs.py", tmp_path / "a/0", tmp_path / "b")
    (tmp_path / "a/1/scores.npz").unlink()
    output = run("compare_runs.py", tmp_path / "a", tmp_path / "b")
    assert f"not compared: {tmp_path / 'a/1/scores.npz'} doesn't exist" in output


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"scores": np.ones((1, 3, 2), np.float32)}, "isn't the scores.npz of a run"),
        ({"scores": np.ones((1, 2, 2), np.float32), "targets": np.zeros(3, int)}, "scores must be of 3 recordings"),
        ({"scores": np.ones((1, 3, 2), int), "targets": np.zeros(3, int)}, "scores must be of 3 recordings"),
        ({"scores": np.ones((1, 3, 2), np.float32), "targets": np.zeros(3, int)}, "has other rounds or classes than"),
        ({"scores": np.ones((1, 3, 4), np.float32), "targets": np.ones(3, int)}, "has other rounds or classes than"),
        ({"scores": np.ones((2, 3, 2), np.float32), "targets": np.ones(3, int)}, "has other rounds or classes than"),
        ({"scores": np.array([object()]), "targets": np.zeros(3, int)}, "isn't the scores.npz of a run"),
        (None, "isn't the scores.npz of a run"),
    ],
)
def test_damaged_scores_are_refused(run, tmp_path, arrays, reason):
    a, b = (write(tmp_path / "a" / name, [1, 1, 0]) for name in "01")
    if arrays is None:
        (b / "scores.npz").write_bytes((b / "scores.npz").read_bytes()[:-30])
    else:
        np.savez(b / "scores.npz", **arrays)
    assert f"{b / 'scores.npz'}: {reason}" in refused(run, tmp_path / "a", a)
    with (b / "scores.npz").open("wb") as file:
        np.save(file, np.ones(3))
    assert "isn't the scores.npz of a run" in refused(run, tmp_path / "a", a)


def refused(run, *folders):
    with pytest.raises(SystemExit) as ended:
        run("compare_runs.py", *folders)
    return str(ended.value)


def test_runs_of_other_recordings_are_refused(run, tmp_path):
    a = write(tmp_path / "a", [1, 1, 0])
    b = write(tmp_path / "b", [1, 1, 0], names=["cat/0.bin", "cat/1.bin", "cat/9.bin"])
    assert "were tested on different recordings: 2 are in one only, such as cat/2.bin/cat" in refused(run, a, b)


def test_what_is_no_run_is_named(run, tmp_path):
    a = write(tmp_path / "a", [1, 1, 0])
    assert f"{tmp_path / 'no'} has no predictions.csv" in refused(run, a, tmp_path / "no")
    for text, words in (
        ("a,b\n", "the columns must be recording, part_us"),
        (",".join(COLUMNS) + "\nx,,cat,cat,1\n", "line 2 has no whole numbers"),
        (",".join(COLUMNS) + "\nx,,cat,cat,2,1,0,5\n", "line 2 has more right votes"),
        (",".join(COLUMNS) + "\nx,,cat,cat,0,0,0,5\n", "line 2 has more right votes"),
    ):
        bad = tmp_path / f"bad{len(words)}"
        bad.mkdir(exist_ok=True)
        (bad / "predictions.csv").write_text(text)
        assert words in refused(run, a, bad)
    (bad / "predictions.csv").write_bytes(bytes(range(128, 256)))
    assert "the columns must be recording, part_us" in refused(run, a, bad)
    uneven = write(tmp_path / "uneven", [1, 1, 0])
    path = uneven / "predictions.csv"
    path.write_text(path.read_text().replace("cat/1.bin,,cat,cat,1,1", "cat/1.bin,,cat,cat,1,2"))
    assert "recordings have different numbers of votes: 1 to 2" in refused(run, a, uneven)
