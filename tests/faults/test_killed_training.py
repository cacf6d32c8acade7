"""Training under trouble: full disks, kills at any moment, two at one folder."""

import io
import os
import random
import subprocess
import sys
import time

import pytest
import torch
from disks import PAGE, file_limit, small_disk
from places import RECIPES
from processes_of_others import another_process, dead_owner

from nvsdata import models
from nvsdata.training.runs import CHECKPOINT, LOG, Checkpoint, add_to_log, write_log

posix = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
MOMENTS = 40
LINE = {"epoch": 1, "loss": 0.5}
SMALL = {"channels": (4, 8), "clusters": ((4, 4), (17, 17)), "hidden": 8}


def checkpoint(value):
    model = models.RGCNN(2, **SMALL)
    for weight in model.parameters():
        torch.nn.init.constant_(weight, value)
    return Checkpoint(1, 2, {}, [LINE], model.state_dict(), {}, {}), model


def read(out):
    """What a checkpoint and a network were filled with, None where there is none."""
    kept, where = None, out / "model.safetensors"
    if (out / CHECKPOINT).exists():
        kept = float(Checkpoint.read(out, torch.device("cpu")).model["hidden.bias"][0])
    return kept, float(models.load(where).model.hidden.bias.detach()[0]) if where.exists() else None


def tried(out, value):
    """Which of both could be written; in any case each is whole, the new one or the one before."""
    before, (state, model) = read(out), checkpoint(value)
    went = []
    for write in (lambda: state.write(out), lambda: models.save(model, out / "model.safetensors")):
        result = ""
        try:
            write()
        except OSError as error:
            result = str(error)
        assert not result or str(out) in result
        went.append(not result)
    assert not list(out.glob(".*"))
    expected = tuple(value if fine else old for fine, old in zip(went, before, strict=True))
    assert read(out) == expected
    return went


@posix
@pytest.mark.parametrize("kind", ["limit", "disk"])
def test_a_full_disk_leaves_whole_files(tmp_path, kind):
    buffer = io.BytesIO()
    torch.save(vars(checkpoint(1.0)[0]), buffer)
    size = len(buffer.getvalue())
    if kind == "limit":
        outcomes = []
        for n, limit in enumerate([*range(0, size + 4 * PAGE, PAGE)]):
            with file_limit(limit):
                outcomes.append(tried(tmp_path, float(n)))
    else:
        with small_disk(tmp_path / "disk") as resize:
            outcomes = []
            for n, room in enumerate(range(PAGE, 4 * size, PAGE)):
                resize(room)
                outcomes.append(tried(tmp_path / "disk", float(n)))
    assert outcomes[0] == [False, False]
    assert outcomes[-1] == [True, True]


@posix
def test_a_log_that_a_full_disk_tore_is_mended(tmp_path):
    write_log(tmp_path, [LINE])
    whole = (tmp_path / LOG).read_bytes()
    with file_limit(len(whole) + 5), pytest.raises(OSError, match=LOG):
        add_to_log(tmp_path, LINE)
    write_log(tmp_path, [LINE])
    assert (tmp_path / LOG).read_bytes() == whole


def command(root, out, *flags):
    words = [
        "--dataset",
        "n-mnist",
        "--root",
        root,
        "--out",
        out,
        "--epochs",
        2,
        "--votes",
        1,
        "--device",
        "cpu",
        "--no-report",
        *flags,
    ]
    return [sys.executable, str(RECIPES / "train_objects.py"), *map(str, words)]


def finish(*words):
    began = time.monotonic()
    done = subprocess.run(command(*words), timeout=300, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return time.monotonic() - began


def kill_when(there, process):
    """Kill a process once something is there; its children end by themselves."""
    deadline = time.monotonic() + 120
    while not there():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.002)
    process.kill()
    process.communicate()


def start(*words):
    return subprocess.Popen(command(*words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def timeless(out):
    return [line.partition(', "seconds"')[0] for line in (out / LOG).read_text().splitlines()]


def test_a_folder_in_use_is_told_in_a_line(run, fake_nmnist, tmp_path):
    held = f"context = locked({str(tmp_path)!r}); context.__enter__(); print(); input()"
    code = f"from nvsdata.common.locks import locked; {held}"
    with another_process(code) as (process, _), pytest.raises(SystemExit) as ended:
        run("train_objects.py", *command(fake_nmnist, tmp_path)[2:])
    output = str(ended.value)
    assert output.startswith(f"train_objects.py: {tmp_path} is being written by process {process.pid} on ")
    assert "\n" not in output


@posix
def test_a_killed_training_is_gone_on_with_at_once(run, fake_nmnist, tmp_path):
    first = start(fake_nmnist, tmp_path)
    kill_when(lambda: (tmp_path / CHECKPOINT).exists(), first)
    (tmp_path / f".{CHECKPOINT}.{dead_owner()}-x.part").touch()
    # no child of the killed one holds the folder any longer than it takes to start
    run("train_objects.py", *command(fake_nmnist, tmp_path, "--resume")[2:])
    assert [line.partition(",")[0] for line in timeless(tmp_path)] == ['{"epoch": 1', '{"epoch": 2']
    assert not list(tmp_path.glob(".*"))


@posix
@pytest.mark.long
def test_a_training_killed_at_many_moments(fake_nmnist, tmp_path):
    seconds = finish(fake_nmnist, tmp_path / "whole")
    weights = models.load(tmp_path / "whole" / "model.safetensors").model.state_dict()
    moment = random.Random(0)
    for n in range(MOMENTS):
        out = tmp_path / str(n)
        process, at = start(fake_nmnist, out), time.monotonic() + moment.uniform(0.3, 1) * seconds
        kill_when(lambda at=at, process=process: time.monotonic() > at or process.poll() is not None, process)
        finish(fake_nmnist, out, "--resume")
        assert timeless(out) == timeless(tmp_path / "whole")
        found = models.load(out / "model.safetensors").model.state_dict()
        assert all(torch.equal(found[name], weight) for name, weight in weights.items())
        assert not list(out.glob(".*"))
