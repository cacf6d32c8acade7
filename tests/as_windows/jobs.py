"""The main jobs, one after the other, as a program: `python jobs.py FOLDER`, with this folder in PYTHONPATH."""

import os
import sys
from pathlib import Path

import clips
import numpy as np
import torch
import trees
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import EventFolder, models
from nvsdata import transforms as T
from nvsdata.cli import main
from nvsdata.datasets.archives.download import download
from nvsdata.datasets.facts import Archive, Info


def command(*words):
    code = main([str(word) for word in words])
    assert code == 0, f"nvsdata {words[0]} ended with {code}"


def videos_to_recordings(folder):
    for n, name in enumerate(("run/a", "run/b", "walk/c", "walk/d")):
        clips.write_video(folder / f"videos/{name}.avi", clips.moving_square(seed=n))
    for more in ((), ("--overwrite", "--preview"), ("--jobs", "2", "--out", folder / "two")):
        command("convert-videos", folder / "videos", *more)
    return folder / "videos-events"


def recordings_to_batches(folder, recordings):
    graphs = T.Compose([T.Window(0, 50_000), T.RadiusGraph()])
    dataset = EventFolder(recordings, transform=graphs)
    for workers in (1, 0):
        # the second time from the cache
        cached = nvsdata.cache(dataset, folder / "cache")
        batches = list(DataLoader(cached, 2, num_workers=workers, collate_fn=nvsdata.collate))
        assert sum(len(batch.targets) for batch in batches) == 4
    command("pack", recordings, "--dataset", "folder", "--out", folder / "all.h5")
    command("pack", recordings, "--dataset", "folder", "--out", folder / "all.h5", "--overwrite")
    packed = EventFolder(folder / "all.h5")
    assert [packed[n][0] for n in range(4)] == [EventFolder(recordings)[n][0] for n in range(4)]
    command("verify", recordings, "--dataset", "folder")


def formats(folder, recordings):
    first = nvsdata.read(recordings / "run/a.h5")
    for suffix in (".aedat", ".aedat3", ".aedat4", ".raw", ".dat", ".npy", ".txt", ".h5"):
        path = folder / f"one{suffix}"
        for _ in range(2):
            # a file that was read can be replaced
            nvsdata.write(first, path)
            found = nvsdata.open(path, sensor_size=first.sensor_size)
            assert np.array_equal(found.read(0, 200_000).t, first.window(0, 200_000).t)
    command("view", folder / "one.h5", folder / "one.png")
    command("info", folder / "one.raw")


def networks(folder):
    model = models.RGCNN(2, channels=(4, 8), clusters=((4, 4), (17, 17)), hidden=8)
    for _ in range(2):
        # a network that is in use can be saved again
        models.save(model, folder / "a.safetensors")
        model = models.load(folder / "a.safetensors").model
    assert all(torch.isfinite(weight).all() for weight in model.parameters())


def an_archive(folder):
    (folder / "mirror").mkdir()
    (folder / "mirror/a.zip").write_bytes(trees.zipped({"a/0/b.bin": b"1" * 100_000}))
    info = Info("made-up", None, ("0",), "", "none", (Archive("a.zip", "", (), "a"),))
    os.environ["NVSDATA_MIRROR"] = str(folder / "mirror")
    for _ in range(2):
        assert download(info, folder / "fetched", keep=False) == [folder / "fetched/a"]
    assert [path.name for path in (folder / "fetched").iterdir()] == ["a"]


def a_camera(folder):
    for more in ((), ("--overwrite",)):
        command("record", "--simulate", "--seconds", "0.3", "--out", folder / "live.h5", *more)
    assert nvsdata.open(folder / "live.h5").sensor_size == (240, 180)


if __name__ == "__main__":
    root = Path(sys.argv[1])
    made = videos_to_recordings(root)
    recordings_to_batches(root, made)
    formats(root, made)
    networks(root)
    an_archive(root)
    a_camera(root)
    print("all done")
