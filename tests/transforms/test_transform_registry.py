import pytest

from nvsdata import transforms as T
from nvsdata.transforms import from_repr


@pytest.mark.parametrize(
    "transform",
    [
        T.RandomWindow(30_000, (0.0, 0.2)),
        T.Compose([T.RandomWindows(8, 33_333), T.Each(T.Compose([T.NonUniformSample(8), T.KNNGraph()]))]),
        T.Compose(
            [
                T.ToFrames(fps=25.0, values="sum", factor=8),
                T.RandomTemporalCrop(160),
                T.RandomCrop(24, (0.5, 1.0)),
                T.Normalize(),
            ]
        ),
        T.RandomAffine(scale=(0.85, 1.1), degrees=15, shift=-0.0),
        T.RadiusGraph(4.0, alpha=0.5, beta=0.5e-5, max_degree=16, pseudo="signed-time", reach_t=9_000),
        T.KNNGraph(3, reach=5, pseudo="abs"),
        T.NodeFeatures(
            T.Compose([T.NonUniformSample(2, beta=0.0), T.RadiusGraph(pseudo="abs")]),
            [T.Age(), T.Patch(3), T.PatchMean(7), T.TimeBins(2)],
        ),
        T.Each(T.Compose([T.MergePixels(("first", "last", "mean")), T.KNNGraph(2)])),
    ],
    ids=repr,
)
def test_a_repr_builds_the_transform(transform):
    assert from_repr(repr(transform)) == transform


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Window(",
        "Nothing()",
        "collate([])",
        "window(1, 2)",
        "1 + x",
        "Window(0, eval('5'))",
        "CameraModel((4, 4), (1.0,) * 4)",
        "CameraModel((4, 4), (1.0, 1.0, 2.0, 2.0))",
        "(" * 5000,
    ],
)
def test_nothing_else_is_built(text):
    with pytest.raises(ValueError, match=r"repr|transform"):
        from_repr(text)
