"""Still pictures that a camera sees in saccades."""

import numpy as np
import pytest

from nvsdata.datasets.nmnist import stabilize
from nvsdata.emulation import DVS
from nvsdata.video.saccades import saccades

SPOT = np.zeros((28, 28), np.uint8)
SPOT[10:18, 12:16] = 200


def center(picture):
    y, x = np.indices(picture.shape)
    return (picture * x).sum() / picture.sum(), (picture * y).sum() / picture.sum()


def test_the_path_is_that_of_n_mnist():
    frames = list(saccades(SPOT))
    assert [frame.time for frame in frames] == [5_000 * n for n in range(64)]
    assert frames[0].pixels.shape == (34, 34)
    assert frames[0].pixels.dtype == np.uint8
    x0, y0 = center(frames[0].pixels)
    for time, place in ((0, (0, 0)), (105_000, (3.5, 7)), (210_000, (7, 0)), (315_000, (0, 0)), (50_000, (1.67, 3.33))):
        x, y = center(frames[time // 5_000].pixels)
        assert (x - x0, y - y0) == pytest.approx(place, abs=0.05)
    # in the middle of what it covers: 13.5 + 3.5 from the left of 28 is that of 34 less 0.5
    x, y = np.mean([center(frame.pixels) for frame in (frames[0], frames[42])], axis=0)
    assert (x, y) == pytest.approx((16.5, 16.5 - 3.5), abs=0.05)


def test_its_events_stand_still_once_the_saccades_are_undone():
    events = DVS().emulate(saccades(SPOT, fps=1_000))
    assert len(events) > 1_000
    still = stabilize(events)
    spread = [np.ptp(np.stack([e.x, e.y]), axis=1).max() for e in (events, still)]
    assert spread[0] >= 15
    assert spread[1] <= 12


def test_other_pictures_and_paths():
    colors = np.zeros((4, 6, 3), np.uint8)
    colors[..., 0] = 90
    frames = list(saccades(colors, (20, 10), fps=10, path=((0, 0), (-4, 2)), duration=500_000, background=30))
    assert [frame.time for frame in frames] == [100_000 * n for n in range(6)]
    assert all(frame.red_first for frame in frames)
    first, last = frames[0].pixels, frames[-1].pixels
    assert (first == 30).all(axis=2).sum() == 20 * 10 - 24
    where = [np.argwhere(frame[..., 1] == 0).min(axis=0).tolist() for frame in (first, last)]
    assert where == [[2, 9], [4, 5]]
    assert len(list(saccades(np.ones((4, 4)), fps=1e6 / 105_000))) == 4


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"fps": 0}, "fps must be positive"),
        ({"duration": -1}, "duration must be positive"),
        ({"path": ((0, 0),)}, "a path has at least a beginning and an end"),
        ({"size": (0, 5)}, "size must be"),
        ({"still": np.zeros(5)}, "the image has shape"),
        ({"still": np.full((4, 4), 2.0)}, "the image: floats must be in"),
    ],
)
def test_what_cannot_be_shown_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        saccades(**{"still": SPOT, **wrong})
