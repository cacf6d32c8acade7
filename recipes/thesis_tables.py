"""The tables of the thesis: whether their data can be had, and the commands that repeat them.

docs/facts.py lists the commands in docs/thesis.md.
"""

from __future__ import annotations

from functools import partial

import thesis_results as results
from thesis_commands import Command, Table, ablation, actions, counts, each_network, trained

from nvsdata.datasets import DATASETS

# placeholders of command lines that aren't datasets, and what they stand for
OTHERS = {
    "LOOK-ALIKES": "`recipes/emulate_actions.py --out DIR`",
    "SIGNS": "`recipes/emulate_signs.py --out DIR`",
    "VIDEO": "any video; for Table 3.3 the one that REAL shows",
    "REAL": "recording of a camera in front of a video (3.3), or a folder of them (3.5)",
    "EMULATED": "the same recordings, emulated: nvsdata convert-videos",
    "VIDEOS": "folder of the videos",
    "MODELS": "folder of trained networks, such as OUT/ucf101-dvs-s16 of Table 5.2",
}
# settings of docs/results.md#n-cars
N_CARS = (
    "recipes/train_objects.py --dataset n-cars --root N-CARS --validate 0.1 --nodes pixels --downsample 2 --radius 1.5"
    " --kernel-size 3 --window 100000 --features bins4 --votes 1"
)
IMAGES = "recipes/train_objects.py --dataset n-cars --root N-CARS --validate 0.1 --window 100000 --votes 1"
GESTURES = "--dataset dvs128-gesture --root DVS128-GESTURE --duration"
POINTS = "--network {lstm,pointnet,pointnet++}"
FRAMES_5_1 = "--network {resnet3d,i3d}"
FRAMES_5_2 = "--network {c3d,resnet3d,p3d,r2plus1d,resnext3d,i3d}"
FRAMES_5_6 = "--network {resnet3d,p3d,r2plus1d,resnext3d,i3d}"
SIMILARITY = "recipes/similarity_aslan.py --root"
FEATURES = "{resnet3d,p3d,r2plus1d,resnext3d,i3d,plain,inception,residual}/model.safetensors"
RGCNN = "--temporal {plain,inception,residual}"
# smaller inputs and networks, as in docs/results.md#action-look-alikes-emulated
LOOK_ALIKES = "--dataset folder --root LOOK-ALIKES --no-flip --validate 0.2 --epochs 8"
LEFT_OUT = "--dataset folder --root LOOK-ALIKES/train --groups 10 --no-flip --epochs 8"
SMALL_POINTS = f"{POINTS} --batch 8 --events 256"
SMALL_FRAMES = "--batch 16 --image-size 32 --adam"
SMALL_RGCNN = f"{RGCNN} --batch 8 --width 0.25"

CONVOLUTIONS = each_network(
    f"{N_CARS} --epochs 5 --network gcnn --convolution {{gin,cheb,gcn,monet}}",
    "",
    "report.json",
    partial(results.accuracy, column="N-CARS"),
)
TABLES: dict[str, Table] = {
    "3.2": Table(
        "look-alike",
        "a video, and a simulated camera",
        (
            Command(
                "recipes/validate_metrics.py --video VIDEO --out OUT/distances.json",
                "distances.json",
                results.distances,
            ),
        ),
    ),
    "3.3": Table(
        "look-alike",
        "a recording and its video, in place of UCF-50's",
        (Command("recipes/tune_pix2nvs.py --real REAL --video VIDEO --out OUT", "rows.json", results.settings),),
    ),
    "3.4": Table(
        "look-alike",
        "N-MNIST and emulated digits, in place of UCF-50",
        (
            Command(
                "recipes/transfer_digits.py --real N-MNIST --out OUT/digits", "digits/table.json", results.transfer
            ),
            Command(
                "recipes/transfer_emulated.py --real UCF50-DVS --emulated EMULATED --out OUT/ucf50",
                "ucf50/table.json",
                results.transfer,
            ),
        ),
    ),
    "3.5": Table(
        "look-alike",
        "drawn letters and a simulated camera; the recordings of signs weren't released",
        (
            Command(
                "recipes/sign_language.py --real REAL --emulated EMULATED --videos VIDEOS --out OUT/signs",
                "signs/table.json",
                results.signs(""),
            ),
            Command(
                "recipes/sign_language.py --real SIGNS/real --emulated SIGNS/emulated --videos SIGNS/videos"
                " --network resnet50 --image-size 32 --no-flip --iterations 1500 --out OUT/look-alikes",
                "look-alikes/table.json",
                results.signs(", look-alikes"),
            ),
        ),
    ),
    "4.1": Table("look-alike", "N-MNIST in place of N-Caltech101", (ablation("k", "k", "1"), counts("4.1"))),
    "4.2": Table("look-alike", "N-MNIST in place of N-Caltech101", (ablation("radius", "radius", "3"), counts("4.2"))),
    "4.3": Table(
        "look-alike",
        "N-CARS (100 ms) in place of N-Caltech101",
        (
            Command(f"{N_CARS} --epochs 10 --out OUT/rgcnn", "rgcnn/report.json", results.by_window),
            counts("4.3"),
        ),
    ),
    "4.4": Table("look-alike", "N-MNIST in place of N-Caltech101", (ablation("depth", "depth", "5"), counts("4.4"))),
    "4.5": Table(
        "look-alike", "N-MNIST in place of N-Caltech101", (ablation("kernel", "kernel_size", "5"), counts("4.5"))
    ),
    "4.6": Table("real", "none for the operations; accuracy: Table 4.9 with --image-size", (counts("4.6"),)),
    "4.7": Table(
        "real",
        "N-CARS, N-MNIST",
        tuple(
            Command(
                f"recipes/baselines.py --dataset {name.lower()} --root {name} --out OUT/{name.lower()}.json",
                f"{name.lower()}.json",
                results.baselines(name),
            )
            for name in ("N-CARS", "N-MNIST")
        ),
    ),
    "4.8": Table(
        "real",
        "N-CARS, N-MNIST",
        (
            trained(f"{N_CARS} --epochs 10", "n-cars", "RG-CNNs", "N-CARS"),
            trained(f"{N_CARS} --epochs 5 --network gcnn", "n-cars-gcnn", "G-CNNs", "N-CARS"),
            CONVOLUTIONS,
            trained(
                "recipes/train_objects.py --dataset n-mnist --root N-MNIST --validate 0.1",
                "n-mnist",
                "RG-CNNs",
                "N-MNIST",
            ),
        ),
    ),
    "4.9": Table(
        "real",
        "N-CARS",
        (
            trained(
                f"{IMAGES} --network resnet50 --image-size 32 --batch 32 --epochs 4", "resnet50", "ResNet_50", "N-CARS"
            ),
            trained(
                f"{IMAGES} --network inception-v4 --image-size 80 --batch 32 --epochs 1",
                "inception",
                "Inception_V4",
                "N-CARS",
            ),
            trained(f"{IMAGES} --network vgg19 --image-size 32 --batch 128 --epochs 1", "vgg19", "VGG_19", "N-CARS"),
        ),
    ),
    "4.10": Table("real", "none", (counts("4.10"),)),
    "5.1": Table(
        "real",
        "DVS128 Gesture; look-alikes",
        (
            *actions(f"{GESTURES} 250000", "0.25 s", POINTS, FRAMES_5_1, RGCNN),
            *actions(f"{GESTURES} 500000", "0.5 s", POINTS, FRAMES_5_1, RGCNN),
            *actions(LOOK_ALIKES, "look-alikes", SMALL_POINTS, f"{FRAMES_5_1} {SMALL_FRAMES}", SMALL_RGCNN),
        ),
    ),
    "5.2": Table(
        "real",
        "UCF101-DVS, HMDB51-DVS; look-alikes",
        tuple(
            command
            for options, data, kinds in (
                ("--dataset ucf101-dvs --root UCF101-DVS", "UCF101-DVS", (FRAMES_5_2, RGCNN)),
                ("--dataset hmdb51-dvs --root HMDB51-DVS", "HMDB51-DVS", (FRAMES_5_2, RGCNN)),
                (LOOK_ALIKES, "look-alikes", (f"{FRAMES_5_2} {SMALL_FRAMES}", SMALL_RGCNN)),
            )
            for graphs in (8, 16)
            for command in actions(f"{options} --graphs {graphs}", f"{data}, S = {graphs}", *kinds)
        ),
    ),
    "5.3": Table("real", "none", (counts("5.3"),)),
    "5.4": Table("real", "none: the table defines what `nvsdata.metrics.similarities` computes"),
    "5.5": Table(
        "real",
        "ASLAN-DVS, and the networks of Table 5.2; look-alikes",
        (
            each_network(f"{SIMILARITY} ASLAN-DVS --model MODELS/{FEATURES}", "", "log.jsonl", results.similarity),
            *actions(f"{LOOK_ALIKES} --graphs 16", "look-alikes, S = 16", f"{FRAMES_5_6} {SMALL_FRAMES}", SMALL_RGCNN),
            each_network(
                f"{SIMILARITY} LOOK-ALIKES --stated-sizes --model OUT/look-alikes-s16/{FEATURES}",
                "pairs/",
                "log.jsonl",
                partial(results.similarity, data=", look-alikes"),
            ),
        ),
    ),
    "5.6": Table(
        "look-alike",
        "actions in place of the scenes of YUPENN-DVS, of which no source is known",
        tuple(
            each_network(
                f"recipes/scenes_yupenn.py {options} --graphs {graphs} {kind}",
                f"{folder}s{graphs}/",
                "log.jsonl",
                partial(results.scenes, column=f"{column}S = {graphs}"),
                journal=True,
            )
            for options, folder, column, kinds in (
                ("--root YUPENN-DVS", "", "", (FRAMES_5_6, RGCNN)),
                (LEFT_OUT, "look-alikes-", "look-alikes, ", (f"{FRAMES_5_6} {SMALL_FRAMES}", SMALL_RGCNN)),
            )
            for graphs in (8, 16)
            for kind in kinds
        ),
    ),
}


def where(name: str) -> str:
    """Return what a placeholder stands for, and where the data can be had."""
    if name in OTHERS:
        return OTHERS[name]
    info = DATASETS[name.lower()].info
    return f"`nvsdata download {name.lower()}`" if info.by_program else f"manual download: {info.page}"
