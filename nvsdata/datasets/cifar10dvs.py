"""The CIFAR10-DVS dataset."""

from __future__ import annotations

from nvsdata.datasets.facts import Archive, Info, expected_names
from nvsdata.datasets.families import RandomSplitDataset

# number of the figshare file, bytes and md5 of each class's zip
ZIPS = {
    "airplane": (7712788, 747054427, "0afd5c4bf9ae06af762a77b180354fdd"),
    "automobile": (7712791, 970159102, "8438dfeba3bc970c94962d995b1b9bdd"),
    "bird": (7712794, 760766288, "a9c207c91c55b9dc2002dc21c684d785"),
    "cat": (7712812, 843271197, "52c63c677c2b15fa5146a8daf4d56687"),
    "deer": (7712815, 778283422, "b6bf21f6c04d21ba4e23fc3e36c8a4a3"),
    "dog": (7712818, 844609875, "f379ebdf6703d16e0a690782e62639c3"),
    "frog": (7712842, 818824848, "cad6ed91214b1c7388a5f6ee56d08803"),
    "horse": (7712851, 929265395, "e7cbbf77bec584ffbf913f00e682782a"),
    "ship": (7712836, 742404857, "41c7bd7d6b251be82557c6cce9a7d5c9"),
    "truck": (7712839, 950111954, "89f3922fd147d9aeff89e76a2b0b70a7"),
}


def figshare(number: int) -> tuple[str, ...]:
    """Return the addresses of a figshare file, in the order in which they are tried.

    The first one is the usual address, but its server may send an empty response.
    """
    return (
        f"https://ndownloader.figshare.com/files/{number}",
        f"https://api.figshare.com/v2/file/download/{number}",
        f"https://figshare.com/ndownloader/files/{number}",
    )


class CIFAR10DVS(RandomSplitDataset):
    """CIFAR10-DVS (Li et al. 2017): CIFAR-10's images moving on a monitor in front of a DVS128.

    10,000 recordings of about 1.3 s, `<class>/cifar10_<class>_<n>.aedat` (AEDAT 2), or the later
    release in AEDAT 4. The axes are those of the camera, with the origin at the top left. Public programs that read the
    dataset disagree on whether the camera was turned by 90 degrees.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all"; a random fifth of each class is for testing.
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: seed of the random split, at least 0 (default 0).
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.CIFAR10DVS("data/cifar10-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.CIFAR10DVS.info.sensor_size, len(nvsdata.CIFAR10DVS.info.classes)
        ((128, 128), 10)
    """

    info = Info(
        name="cifar10-dvs",
        sensor_size=(128, 128),
        classes=tuple(ZIPS),
        page="https://figshare.com/articles/dataset/CIFAR10-DVS_New/4724671",
        license="CC BY 4.0 (as reported)",
        archives=tuple(
            Archive(f"{name}.zip", md5, figshare(number), name, size) for name, (number, size, md5) in ZIPS.items()
        ),
        recordings=10_000,
        expected_counts=tuple(expected_names(name, f"cifar10_{name}_{{}}", range(1000)) for name in ZIPS),
        known_from="two public programs that read the dataset",
        tree="<class>/cifar10_<class>_<id>.aedat",
    )
