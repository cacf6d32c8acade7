import cv2
import numpy as np

from nvsdata import Events, plots
from nvsdata.plots import drawing


def test_pixels_take_the_color_of_what_they_saw():
    ev = Events([0, 1, 2, 3], [0, 1, 2, 2], [0, 0, 0, 0], [1, 0, 1, 0], (4, 2))
    image = plots.event_image(ev, zoom=3)
    assert image.shape == (6, 12, 3)
    assert [tuple(image[1, x * 3 + 1]) for x in range(4)] == [drawing.ON, drawing.OFF, drawing.BOTH, (255,) * 3]


def test_a_contact_sheet_shows_every_image():
    images = [np.full((10, 10, 3), value, np.uint8) for value in (0, 50, 100)]
    sheet = plots.contact_sheet([("a", images[:2]), ("b", images[2:])])
    assert all((sheet == image[0, 0]).all(2).sum() >= 100 for image in images)


def test_curves_are_saved_as_a_picture(tmp_path):
    picture = plots.curves([("train", [0.1, 0.5, 0.9]), ("test", [0.2])], "title", "epoch")
    plots.save_png(picture, tmp_path / "a.png")
    assert np.array_equal(cv2.imread(str(tmp_path / "a.png")), picture)
