"""Small look-alikes of the datasets as they are distributed: folders, names, split files and known defects."""

from __future__ import annotations

import io
import struct
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import scipy.io
from lookalikes import AEDAT3_HEADER, aedat2_bytes, aedat3_packet, matlab_bytes

from nvsdata import Events


def some(seed: int, n: int = 60, size: tuple[int, int] = (34, 34), first: int = 0, gap: int = 3_000) -> Events:
    """Random events that differ from seed to seed."""
    rng = np.random.default_rng(seed)
    t = first + np.cumsum(rng.integers(1, gap, n))
    return Events(t, rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n), size)


def atis(ev: Events) -> bytes:
    """ATIS records."""
    columns = (ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), ev.p.tolist())
    return b"".join(bytes([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255]) for t, x, y, p in zip(*columns, strict=True))


def dvs128(ev: Events, header: bytes = b"#!AER-DAT2.0\r\n# This is a raw AE data file\r\n") -> bytes:
    """AEDAT 2.0 of a DVS128, without a line that names the chip, as MNIST-DVS has it."""
    x, y, p = ev.x.astype(int), ev.y.astype(int), ev.p.astype(int)
    return aedat2_bytes(((127 - y) << 8 | (127 - x) << 1 | (1 - p)).tolist(), ev.t.tolist(), header)


def davis(ev: Events) -> bytes:
    """AEDAT 2.0 of a DAVIS240C, with frame samples between the events."""
    header = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End Of ASCII Header\r\n"
    x, y, p = ev.x.astype(int), ev.y.astype(int), ev.p.astype(int)
    address = ((179 - y) << 22 | (239 - x) << 12 | p << 11).tolist()
    words, times = [], []
    for k, (a, t) in enumerate(zip(address, ev.t.tolist(), strict=True)):
        words += [a, 1 << 31 | k] if k % 3 == 0 else [a]
        times += [t, t] if k % 3 == 0 else [t]
    return aedat2_bytes(words, times, header)


def dat(ev: Events) -> bytes:
    """Prophesee .dat as N-CARS has it: version 2, no size, event type 0."""
    head = b"% Data file containing N9Chronocam7Event2dE events.\n% Version 2\n% Date 2017-10-31 11:29:21\n\x00\x08"
    columns = (ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), ev.p.tolist())
    return head + b"".join(struct.pack("<II", t, x | y << 14 | p << 28) for t, x, y, p in zip(*columns, strict=True))


def mat(ev: Events) -> bytes:
    """MATLAB v5 with y counted from the bottom."""
    return matlab_bytes(ev, y=ev.sensor_size[1] - 1 - ev.y)


def put(root: Path, files: dict[str, bytes]) -> Path:
    """Write files below a folder."""
    for name, data in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(data)
    return root


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip of files."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


def tarred(files: dict[str, bytes]) -> bytes:
    """A tar.gz of files."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as archive:
        for name, data in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))
    return out.getvalue()


def nmnist() -> dict[str, bytes]:
    """Three recordings a digit for training and two for testing; ids occur in both."""
    return {
        f"{part}/{d}/{i + 1:05d}.bin": atis(some(100 * d + 10 * i + (part == "Test")))
        for part, count in (("Train", 3), ("Test", 2))
        for d in range(10)
        for i in range(count)
    }


def ncaltech101() -> dict[str, bytes]:
    """Four classes with annotations (none for the background); a box that begins outside."""
    files = {}
    for c, name in enumerate(("BACKGROUND_Google", "Faces_easy", "ant", "yin_yang")):
        for i in range(10):
            files[f"Caltech101/{name}/image_{i + 1:04d}.bin"] = atis(some(100 * c + i, size=(200 - i, 150)))
            if c:
                box = [-3 if i == 0 else 5, 7, 105, 7, 105, 87, 5, 87, 5, 7]
                outline = [2, 2, 1, 1, 2, 2]
                files[f"Caltech101_annotations/{name}/annotation_{i + 1:04d}.bin"] = struct.pack(
                    "<18h", 2, 5, *box, *outline
                )
    return files


def mnistdvs() -> dict[str, bytes]:
    """Three ids a digit and scale, two for training and one for testing."""
    return {
        f"grabbed_data{d}/scale{s}/mnist_{d}_scale{s:02d}_{i:04d}.aedat": dvs128(
            some(1000 * d + s + i, size=(128, 128))
        )
        for d in range(10)
        for s in (4, 8, 16)
        for i in (1, 900, 901)
    }


def cifar10dvs() -> dict[str, bytes]:
    """Ten recordings of three classes, numbers without leading zeros."""
    return {
        f"{name}/cifar10_{name}_{i}.aedat": dvs128(some(100 * c + i, size=(128, 128)))
        for c, name in enumerate(("airplane", "dog", "truck"))
        for i in range(10)
    }


def ncars() -> dict[str, bytes]:
    """The inner zips hold train/ and test/."""
    parts = {}
    for part, start in (("train", 4), ("test", 0)):
        files = {
            f"{part}/{name}/obj_{start + i:06d}_td.dat": dat(some(10 * start + 100 * c + i, size=(70 + i, 40)))
            for c, name in enumerate(("background", "cars"))
            for i in range(4)
        }
        parts[f"Prophesee_Dataset_n_cars/n-cars_{part}.zip"] = zipped(files)
    return parts


def asldvs() -> dict[str, bytes]:
    """A zip a letter, as the shared folder has them."""
    return {
        f"Yin Bi - {letter}.zip": zipped(
            {f"{letter}/{letter}_{i + 1:04d}.mat": mat(some(100 * c + i, size=(240, 180))) for i in range(10)}
        )
        for c, letter in enumerate("aky")
    }


def dvs128gesture() -> dict[str, bytes]:
    """Four trials of 12 labels (class 8 twice); user22_led's class 9 ends after class 10 begins."""
    files = {}
    for k, trial in enumerate(("user01_natural", "user22_led", "user24_lab", "user29_fluorescent_led")):
        ev = some(k, 3_000, (128, 128), first=80_000_000, gap=500)
        cuts = range(0, 3_000, 250)
        files[f"DvsGesture/{trial}.aedat"] = AEDAT3_HEADER + b"".join(aedat3_packet(ev[c : c + 250]) for c in cuts)
        starts = np.linspace(ev.t[0], ev.t[-1], 13).astype(int).tolist()
        rows = [
            f"{label},{a + 100},{b - 100}"
            for label, a, b in zip((*range(1, 9), 8, 9, 10, 11), starts[:-1], starts[1:], strict=True)
        ]
        if trial == "user22_led":
            rows[9] = f"9,{starts[9] + 100},{starts[11]}"
        files[f"DvsGesture/{trial}_labels.csv"] = "\r\n".join(["class,startTime_usec,endTime_usec", *rows, ""]).encode()
    files["DvsGesture/trials_to_train.txt"] = b"user01_natural.aedat\nuser22_led.aedat\n\n"
    files["DvsGesture/trials_to_test.txt"] = b"user24_lab.aedat\nuser29_fluorescent_led.aedat\n"
    return files


def dvs128gesture_preprocessed() -> dict[str, bytes]:
    """Three users' gestures as arrays x, y, p, t with t in ms, named by their class."""
    files = {}
    for k, trial in enumerate(("Train/user01_lab", "Train/user23_fluorescent_led", "Test/user24_led")):
        for label in range(11):
            ev = some(20 * k + label, 300, (128, 128), first=0, gap=30)
            file = io.BytesIO()
            np.save(file, np.stack([ev.x, ev.y, ev.p, ev.t], 1))
            files[f"ibmGesture{trial}/{label}.npy"] = file.getvalue()
    return files


def ucf101dvs() -> dict[str, bytes]:
    """Two classes, one with its folder misspelt, files in another case than the lists, an empty recording."""
    files = {}
    for c, (folder, stem) in enumerate((("Billards", "Billiards"), ("HandstandPushups", "HandStandPushups"))):
        for g in (1, 7, 8, 25):
            files[f"{folder}/v_{stem}_g{g:02d}_c01.mat"] = mat(some(100 * c + g, 300, (240, 180), first=5_000_000))
    files["Billards/v_Billiards_g08_c02.mat"] = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    lines = {"train": [], "test": []}
    for folder, stem in (("Billiards", "Billiards"), ("HandstandPushups", "HandstandPushups")):
        for g in (1, 7, 8, 25):
            lines["test" if g <= 7 else "train"].append(f"{folder}/v_{stem}_g{g:02d}_c01.avi")
    files["ucfTrainTestlist/trainlist01.txt"] = "".join(f"{line} 1\r\n" for line in lines["train"]).encode()
    files["ucfTrainTestlist/testlist01.txt"] = "".join(f"{line}\r\n" for line in lines["test"]).encode()
    return files


def ucf50dvs() -> dict[str, bytes]:
    """AEDAT 2 of a DAVIS240C; file names that spell the class differently; an empty recording."""
    files = {}
    for c, (folder, stem) in enumerate((("Billiards", "Billards"), ("PullUps", "Pullup"))):
        for g in (1, 2, 25):
            files[f"UCF50_DVS/{folder}/v_{stem}_g{g:02d}_c01.aedat"] = davis(some(100 * c + g, 300, (240, 180)))
    files["UCF50_DVS/PullUps/v_Pullup_g02_c02.aedat"] = b"#!AER-DAT2.0\r\n"
    return files


def hmdb51dvs(kind: str = "mat") -> dict[str, bytes]:
    """Two classes with HMDB51's kind of names, in either release's format; one recording is empty."""
    files = {}
    write = {"mat": mat, "aedat": davis}[kind]
    for c, name in enumerate(("brush_hair", "wave")):
        lines = []
        for i in range(6):
            stem = f"April_09_{name}_#{i}_(goo)_np1_ba_med_{i}"
            files[f"{name}/{stem}.{kind}"] = write(some(100 * c + i, 300, (240, 180), first=2_000_000))
            lines.append(f"{stem}.avi {(1, 1, 1, 2, 2, 0)[i]} \n")
        files[f"testTrainMulti_7030_splits/{name}_test_split1.txt"] = "".join(lines).encode()
    files[f"wave/empty_wave_1.{kind}"] = b""
    return files


def aslandvs(view2: bool) -> dict[str, bytes]:
    """Twelve recordings and ten folds of two pairs each, one with a recording that is missing."""
    files = {f"ASLAN/v_{i}.mat": mat(some(i, 300, (240, 180))) for i in range(1, 13)}
    pairs = [(f + 1, (f % 12) + 1, (f * 5 + k) % 12 + 1, k) for f in range(10) for k in (0, 1)]
    pairs[3] = (2, 1, 99, 1)
    if view2:
        table = np.zeros((2, 5, 10))
        for row, (fold, a, b, same) in enumerate(pairs):
            table[row % 2, :3, fold - 1] = a, b, same
        out = io.BytesIO()
        scipy.io.savemat(out, {"action_splits_pairs": table})
        files["Info/View2.mat"] = out.getvalue()
    else:
        lines = ["fold,video_a,video_b,same", *(f"{f},{a},v_{b},{same}" for f, a, b, same in pairs)]
        files["aslan_pairs.csv"] = "\n".join(lines).encode()
    return files


def yupenndvs() -> dict[str, bytes]:
    """Scene folders spelt with capitals and spaces."""
    return {
        f"YUPENN/{name}/{i}.mat": matlab_bytes(some(10 * c + i, size=(240, 180)))
        for c, name in enumerate(("Forest Fire", "beach", "Windmill_farm"))
        for i in range(3)
    }
