"""The MNIST-DVS dataset."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import ClassVar, Self

from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Archive, Info, Sample, expected_names
from nvsdata.datasets.indexing import PairTransform, Transform

_CAVIAR = "http://www2.imse-cnm.csic.es/caviar/MNIST_DVS"
SCALES = (4, 8, 16)
FIRST_TEST_ID = 901
# bytes and sha256 of grabbed_data0.zip, grabbed_data1.zip, ...
ZIPS = (
    (790469447, "4263ec792b86015b52533d0a34970b7d0fbf26d3245e5a705515021050165b65"),
    (456285815, "aad599ba4c96c9ed4484adaf4c0a49138d87a7ff4b1ff759f999f46b04ecf620"),
    (579069198, "872089b93263c7cf9a7f5d105df4bccf00b7c600a7c7ee960f453559e4718e36"),
    (555396246, "82b120d031af135b3006d17c07a861508bb2c98e3919d41d2556fd20f6dbe7c7"),
    (491628272, "4e0f87859743233e0f587f963c7a05931cf61cd4f26b647abf02794a4651673c"),
    (636477424, "d11345b2d282367f2836e9ba94fe1bfd3bbc707094d15298364bf9c905ed43b3"),
    (520197908, "9144d1f80d6e5e2ddd5ebcc5e98ea33b50974c54776ecd800dcd86b06196ed3d"),
    (633912358, "b498053366b6b6ab979ac3dedbbc4417041e203569ecac8287cf018e9836ce67"),
    (802631746, "dbce305d64f9f2bda87dae58966289e0070102f56ef1506b2f5c27f9e86b947d"),
    (739912195, "c9d9087a1db0b4e4af1904b3481c8d9bdc8fb6b4ea757d51d4b0c6341b8dd280"),
)


class MNISTDVS(EventDataset):
    """MNIST-DVS (Serrano-Gotarredona and Linares-Barranco 2015): moving digits on a monitor, recorded by a DVS128.

    10,000 digits, each at three scales, about 2.3 s per recording, in
    `grabbed_data<d>/scale<s>/mnist_<d>_scale<ss>_<id>.aedat`. The monitor's refresh rate of 75 Hz is visible in the
    recordings.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all". The dataset is published without a split: here recordings 901 to 1000 of each
            digit are for testing (the customary 90/10), the same digits at every scale.
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        scale: 4, 8 or 16; None for all three.
        fold: must be None: there is one split.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.MNISTDVS("data/mnist-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.MNISTDVS.info.sensor_size, len(nvsdata.MNISTDVS.info.classes)
        ((128, 128), 10)
    """

    info = Info(
        name="mnist-dvs",
        sensor_size=(128, 128),
        classes=tuple("0123456789"),
        page="http://www2.imse-cnm.csic.es/caviar/MNISTDVS.html",
        license="not stated",
        archives=tuple(
            Archive(f"grabbed_data{d}.zip", sha256, (f"{_CAVIAR}/grabbed_data{d}.zip",), f"grabbed_data{d}", size)
            for d, (size, sha256) in enumerate(ZIPS)
        ),
        recordings=30_000,
        expected_counts=tuple(
            expected_names(str(d), f"mnist_{d}_scale{scale:02d}_{{:04d}}", range(1, 1001))
            for d in range(10)
            for scale in SCALES
        ),
        known_from="the files of digit 0, and a list of the others in public code that reads them",
        tree="grabbed_data<digit>/scale<4, 8 or 16>/mnist_<digit>_scale<04, 08 or 16>_<id>.aedat",
    )
    # names of the digits' folders; the folders of the scales, such as "scale4", are below them and name no class
    aliases: ClassVar[dict[str, str]] = {f"grabbed_data{d}": str(d) for d in range(10)} | {
        f"processed_data{d}": str(d) for d in range(10)
    }

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
        *,
        scale: int | None = 4,
        fold: int | None = None,
        train: bool | None = None,
        transforms: PairTransform | None = None,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        if scale is not None and scale not in SCALES:
            raise ValueError(f"scale must be 4, 8, 16 or None for all, not {scale}")
        self.scale = scale
        super().__init__(
            root,
            split,
            transform,
            target_transform,
            download,
            fold=fold,
            train=train,
            transforms=transforms,
            seed=seed,
            errors=errors,
        )

    @classmethod
    def complete(cls, root: str | os.PathLike[str]) -> Self:
        return cls(root, "all", scale=None)

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        for sample in found:
            parts = sample.stem.split("_")
            if len(parts) < 4 or not (parts[2][5:].isdigit() and parts[3].isdigit()):
                continue
            part = "test" if int(parts[3]) >= FIRST_TEST_ID else "train"
            if self.scale in (None, int(parts[2][5:])) and self.split_name in ("all", part):
                yield sample
