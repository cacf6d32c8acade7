"""What the protocols build for which sensors and settings, at the bounds of each."""

import pytest
import torch
from torch import nn

from nvsdata import Events, models
from nvsdata.training import Team
from nvsdata.training.actions import Actions
from nvsdata.training.objects import FEATURES, Objects

HERE = Team(torch.device("cpu"))


def built(protocol, *sensor, classes=3):
    """The network, without weights."""
    with torch.device("meta"):
        return protocol.build(sensor, classes)


@pytest.mark.parametrize(
    ("sensor", "holds", "convolutions"),
    [
        ((34, 34), (34, 34), 3),
        ((12, 34), (34, 34), 3),
        ((35, 12), (128, 128), 4),
        ((12, 35), (128, 128), 4),
        ((128, 128), (128, 128), 4),
        ((129, 12), (240, 180), 4),
        ((240, 180), (240, 180), 4),
    ],
)
def test_other_datasets_have_the_network_of_the_smallest_sensor_that_holds_theirs(sensor, holds, convolutions):
    for network, kind in (("rgcnn", models.RGCNN), ("gcnn", models.GCNN)):
        model = built(Objects("folder", network), *sensor)
        assert type(model) is kind
        assert model.settings["sensor_size"] == holds
        assert len(model.settings["channels"]) == convolutions
        assert model.settings["num_classes"] == 3


@pytest.mark.parametrize("sensor", [(241, 180), (240, 181), (180, 240)])
def test_larger_sensors_than_all_are_refused(sensor):
    with pytest.raises(ValueError, match="the network is for 240x180 pixels, not {}x{}$".format(*sensor)):
        built(Objects("folder"), *sensor)


def test_a_known_dataset_has_its_own_network():
    assert built(Objects("n-cars"), 30, 30).settings["sensor_size"] == (128, 128)
    assert built(Objects("mnist-dvs"), 128, 128).settings["channels"] == (32, 64, 128)
    with pytest.raises(ValueError, match="the network is for 128x128 pixels, not 129x128"):
        built(Objects("n-cars"), 129, 128)


def test_depths_are_those_of_the_sensor():
    small, wide = (built(Objects("folder", depth=4), side, 20).settings for side in (34, 35))
    assert (small["sensor_size"], small["hidden"]) == ((34, 34), 128)
    assert small["channels"] == models.SMALL_DEPTHS[4]["channels"]
    assert (wide["sensor_size"], wide["hidden"]) == ((240, 180), 1024)
    assert wide["channels"] == models.DEPTHS[4]["channels"]
    # N-MNIST's own
    assert len(built(Objects("n-mnist"), 34, 34).settings["channels"]) == 5
    assert len(built(Objects("n-mnist", depth=3), 34, 34).settings["channels"]) == 3
    for side, known in ((34, r"\(3, 4, 5\)"), (35, r"\(2, 3, 4, 5, 6\)")):
        with pytest.raises(ValueError, match=f"depth must be one of {known} for a sensor of {side} pixels, not 7"):
            built(Objects("folder", depth=7), side, 10)


def test_settings_reach_the_network():
    given = {"kernel_size": 3, "loops": False, "root_weight": False, "shortcut_start": 0.5, "dropout": 0.0}
    model = built(
        Objects("n-cars", **given, width=0.3, pseudo="signed-time", features=("age", "patch3")), 128, 128, classes=7
    )
    expected = {**given, "num_classes": 7, "channels": (19, 38, 77, 154), "dim": 3, "convolution": "spline"}
    assert expected.items() <= model.settings.items()
    # polarity beside the features
    assert model.settings["in_channels"] == 1 + FEATURES["age"].channels + FEATURES["patch3"].channels
    plain = built(Objects("n-cars", "gcnn", features=(), convolution="gin"), 128, 128).settings
    assert (plain["in_channels"], plain["dim"], plain["convolution"], plain["kernel_size"]) == (1, 2, "gin", 5)
    assert (plain["loops"], plain["root_weight"], plain["shortcut_start"]) == (True, True, 0.0)


def test_nodes_of_pixels_have_counts_and_times_and_a_smaller_network():
    protocol = Objects("n-cars", nodes="pixels", features=("patch3",))
    assert protocol.setting("k") == 1
    model = built(protocol, 120, 100, classes=2)
    assert model.settings["clusters"] == ((4, 4), (4, 4), (8, 8), (8, 8), (16, 16))
    events = Events(range(0, 90, 10), [3, 3, 4, 50, 50, 50, 50, 99, 99], [2] * 9, [1, 1, 0] * 3, (120, 100))
    graph = protocol.pipeline(training=False)(events)
    assert graph.num_nodes == 4
    assert graph.x.shape[1] == model.settings["in_channels"] == 2 + 3 + 18
    assert sorted(graph.x[:, :2].expm1().round().tolist()) == [[0, 1], [1, 1], [2, 0], [3, 1]]
    # the crop is in the middle of the sensor
    assert sorted(graph.pos[:, 0].tolist()) == [11, 12, 58, 107]
    assert graph.pos[:, 1].tolist() == [49] * 4
    halved = Objects("n-cars", nodes="pixels", downsample=2, features=())
    small = built(halved, 120, 100).settings
    assert (small["sensor_size"], small["clusters"]) == ((64, 64), ((2, 2), (2, 2), (4, 4), (4, 4), (8, 8)))
    assert halved.pipeline(training=False)(events).sensor_size == (60, 50)
    assert protocol.build((120, 100), 2).eval()(graph).shape == (1, 2)
    # a sensor like N-MNIST's keeps its own network
    assert built(Objects("n-mnist", nodes="pixels"), 34, 34).settings["channels"] == (32, 64, 64, 128, 128)


def test_what_is_left_open_is_the_datasets():
    usual = {name: Objects("n-cars").settings[name] for name in ("k", "depth", "dropout")}
    small = {name: Objects("n-mnist").settings[name] for name in ("k", "depth", "dropout")}
    assert usual == {"k": 8, "depth": None, "dropout": 0.5}
    assert small == {"k": 1, "depth": 5, "dropout": 0.2}
    given = Objects("n-mnist", k=3, depth=4, dropout=0.0)
    assert given.settings == vars(given)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"network": "vgg"}, r"network must be one of \('rgcnn', 'gcnn', 'vgg19', .*, not 'vgg'"),
        ({"k": 0}, "k must be"),
        ({"window": 0}, "window must be"),
        ({"kernel_size": 0}, "kernel_size must be"),
        ({"image_size": 0}, "image_size must be"),
        ({"width": 0.0}, "width must be positive"),
        ({"smoothing": 1.01}, "smoothing must be between"),
        ({"dropout": -0.01}, "dropout must be between"),
        ({"radius": -1.0}, "radius"),
        ({"convolution": "sage"}, r"convolution must be one of \('spline', 'gcn', .*, not 'sage'"),
        ({"nodes": "voxels"}, r"nodes must be one of \('events', 'pixels'\), not 'voxels'"),
        ({"schedule": "cosine"}, r"schedule must be one of \('one-cycle', 'steps'\), not 'cosine'"),
        ({"features": ("age", "old", "new")}, r"features must be of \('age', .*, not new, old$"),
    ],
)
def test_settings_that_will_not_do(wrong, reason):
    with pytest.raises(ValueError, match=reason):
        Objects("n-cars", **wrong)


def test_the_least_settings_that_will_do():
    least = Objects("n-cars", k=1, window=1, kernel_size=1, image_size=1, width=0.01, smoothing=0.0, dropout=0.0)
    assert least.settings["dropout"] == 0
    assert Objects("n-cars", smoothing=1.0, dropout=1.0).smoothing == 1


@pytest.mark.parametrize(("network", "rate"), [("rgcnn", 3e-3), ("gcnn", 3e-3), ("vgg19", 1e-3), ("resnet50", 1e-3)])
def test_one_cycle_is_the_schedule_of_all_networks_unless_asked(network, rate):
    optimizer, schedule = Objects("n-cars", network).optimization(nn.Linear(1, 1), 100, 10)
    assert isinstance(optimizer, torch.optim.Adam)
    rates = []
    for _ in range(100):
        rates.append(schedule.get_last_lr()[0])
        optimizer.step()
        schedule.step()
    assert max(rates) == pytest.approx(rate, rel=1e-3)
    assert rates[0] < max(rates) / 20 > rates[-1]
    optimizer, _ = Objects("n-cars", network, schedule="steps").optimization(nn.Linear(1, 1), 100, 10)
    assert isinstance(optimizer, torch.optim.SGD if network in ("vgg19", "resnet50") else torch.optim.Adam)


def test_steps_of_an_epoch_say_when_image_networks_are_decayed():
    def milestones(steps, epochs=9):
        _, schedule = Objects("n-cars", "vgg19", schedule="steps").optimization(nn.Linear(1, 1), epochs, steps)
        return sorted(schedule.milestones)

    assert milestones(5_000) == [2, 4, 6, 8]
    assert milestones(5_001) == [1, 2, 3, 4, 5, 6, 7, 8]
    assert milestones(3_333) == [3, 6]
    # an epoch may be longer than that
    assert milestones(20_000) == [1, 2, 3, 4, 5, 6, 7, 8]
    assert milestones(3_333, 6) == [3]


@pytest.mark.parametrize(
    ("recordings", "given", "epochs"),
    [
        (64, {}, 4_000),
        (65, {}, 2_000),
        (26 * 64, {}, 154),
        (27 * 64, {}, 150),
        (5, {"epochs": 2}, 2),
        (66, {"batch": 3}, 182),
    ],
)
def test_small_datasets_are_passed_more_often(tmp_path, capsys, recordings, given, epochs):
    protocol = Objects("n-mnist", depth=3, width=0.1, features=())
    known = {"sensor_size": (34, 34), "classes": 2, "data": {"dataset": "n-mnist"}, "team": HERE}
    trainer = protocol.trainer(tmp_path, recordings=recordings, **known, **given)
    assert (trainer.epochs, trainer.batch) == (epochs, given.get("batch", 64))
    assert "protocol Objects(dataset='n-mnist', network='rgcnn'" in capsys.readouterr().out
    # what was left open is kept as it is for the dataset
    assert "k=1" in trainer.data["protocol"]
    assert "dropout=0.2" in trainer.data["protocol"]
    assert trainer.data["dataset"] == "n-mnist"


@pytest.mark.parametrize(
    ("sensor", "holds"),
    [
        *(((64, 48), (64, 64)), ((48, 64), (64, 64)), ((65, 12), (128, 128)), ((12, 65), (128, 128))),
        *(((128, 128), (128, 128)), ((12, 128), (128, 128)), ((129, 12), (240, 180)), ((12, 129), (240, 180))),
    ],
)
def test_the_network_for_actions_holds_the_sensor(sensor, holds):
    for temporal in models.TEMPORAL:
        settings = built(Actions(temporal=temporal), *sensor, classes=5).settings
        assert (settings["sensor_size"], settings["temporal"], settings["num_classes"]) == (holds, temporal, 5)


@pytest.mark.parametrize("temporal", models.TEMPORAL)
def test_narrow_networks_for_actions_have_a_fraction_of_the_channels(temporal):
    full, half = (built(Actions(temporal=temporal, width=width), 64, 48) for width in (1.0, 0.5))
    for wide, narrow in zip(full.parameters(), half.parameters(), strict=True):
        if wide.ndim == 1 and wide.shape[0] != 3:
            assert narrow.shape[0] * 2 == wide.shape[0]
    with pytest.raises(ValueError, match="width must be positive, not 0"):
        built(Actions(width=0.0), 64, 48)


def test_smaller_frames_are_cut_out_in_proportion():
    for image_size, side, square in ((None, 178, 160), (32, 36, 32)):
        pipeline = repr(Actions("p3d", image_size=image_size).pipeline(training=True))
        assert f"Resize(size={side}), RandomCrop(size={square}," in pipeline
    with pytest.raises(ValueError, match="image_size must be a whole number of at least 1, not 0"):
        Actions("p3d", image_size=0)


@pytest.mark.parametrize("name", ["c3d", "pointnet++", "lstm"])
def test_other_networks_for_actions_are_those_of_their_names(name):
    model = built(Actions(name), 240, 180, classes=7)
    assert type(model).__name__.lower() == {"pointnet++": "pointnet2"}.get(name, name)
    assert [layer for layer in model.modules() if isinstance(layer, nn.Linear)][-1].out_features == 7


def test_batches_of_longer_sequences_are_smaller(tmp_path):
    assert [Actions(graphs=graphs).batch for graphs in (7, 8, 9, 16)] == [16, 32, 16, 16]
    known = {"sensor_size": (128, 128), "classes": 2, "data": {"dataset": "x"}, "team": HERE}
    trainer = Actions("pointnet", graphs=16).trainer(tmp_path, **known)
    assert (trainer.batch, trainer.epochs, trainer.seed) == (16, 150, 0)
    assert trainer.data["dataset"] == "x"
    assert trainer.data["protocol"].startswith("Actions(network='pointnet'")
    trainer = Actions("pointnet").trainer(tmp_path, **known, batch=5, epochs=3, seed=9)
    assert (trainer.batch, trainer.epochs, trainer.seed) == (5, 3, 9)
    with pytest.raises(ValueError, match=r"network must be one of \('rgcnn3d', 'c3d', .*, not 'c4d'"):
        Actions("c4d")


def test_networks_of_frames_can_be_trained_by_adam():
    for adam, kind, rate in ((False, torch.optim.SGD, 0.01), (True, torch.optim.Adam, 1e-3)):
        optimizer, schedule = Actions("p3d", adam=adam).optimization(nn.Linear(2, 2), 150)
        assert type(optimizer) is kind
        assert schedule.get_last_lr() == [rate]


@pytest.mark.parametrize("kind", ["rgcnn", "gcnn"])
@pytest.mark.parametrize(("sensor", "channels", "last"), [((34, 34), 32, (7, 7)), ((240, 180), 64, (60, 45))])
def test_causal_networks_pool_at_their_end_only_and_can_stream(kind, sensor, channels, last):
    protocol = Objects("folder", kind, causal=True, features=())
    assert protocol.settings["k"] == 1
    model = protocol.build(sensor, 3)
    assert model.settings["channels"] == (channels, 2 * channels, 128)
    assert model.settings["clusters"] == (None, None, last)
    assert model.settings["sensor_size"] == sensor
    trained = models.Trained(model.eval(), (), protocol.pipeline(training=False), {}, {})
    decider = models.OnlineClassifier(trained)
    assert isinstance(decider.stream, models.incremental.streaming.CausalStream)
    assert decider.stream.window == 30_000


@pytest.mark.parametrize(
    "wrong", [{"features": ("age",)}, {"depth": 3}, {"k": 2}, {"network": "vgg19"}, {"nodes": "pixels"}]
)
def test_causal_networks_know_no_events_to_come(wrong):
    with pytest.raises(ValueError, match=f"a causal network is .*: {next(iter(wrong))} is "):
        Objects("n-mnist", causal=True, **{"features": ()} | wrong)
    assert Objects("n-mnist", causal=True, features=(), k=1).settings["k"] == 1


def test_the_usual_networks_can_stream_as_they_were_trained():
    protocol = Objects("n-mnist")
    trained = models.Trained(protocol.build((34, 34), 10).eval(), (), protocol.pipeline(training=False), {}, {})
    assert models.OnlineClassifier(trained).stream.scores().shape == (10,)
