import base64
import re

import cv2
import numpy as np

from nvsdata import Events, plots
from nvsdata.plots.gallery import COLUMNS, ClassSummary, gallery, image_tags


def events(count, on):
    """An event each half ms, the first `on` of them ON."""
    t = 10**9 + np.arange(count) * 500
    return Events(t, t % 3, t * 0, np.arange(count) < on, (3, 2))


def test_figures_of_a_class_are_by_hand():
    shelf = ClassSummary("cat", 1_234)
    assert shelf.cells() == ["1,234", "0", "", "", "", ""]
    for count, on in ((1_001, 1_001), (3_001, 0), (2_001, 500)):
        shelf.add(events(count, on))
    # median number, 6,003 events in 3 s, median seconds, 1,501 of 6,003
    assert shelf.cells() == ["1,234", "3", "2,001", "2,001", "1", "25.0%"]


def test_a_class_of_recordings_without_events_or_time():
    shelf = ClassSummary("cat", 2)
    shelf.add(Events.empty((3, 2)))
    assert shelf.cells() == ["2", "1", "0", "", "0", ""]
    shelf.add(events(1, 1))
    assert shelf.cells() == ["2", "2", "0", "", "0", "100.0%"]


def test_a_picture_is_of_the_middle_twentieth_of_a_second():
    # an event in each of the first 201 ms, at another pixel in each of three parts
    t = np.arange(201) * 1_000
    part = (t >= 75_000).astype(int) + (t >= 125_000)
    recording = Events(t, part, t * 0, t > -1, (3, 1))
    shelf = ClassSummary("cat", 1)
    shelf.show("<a>", recording)
    ((_, png),) = shelf.images
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(picture, plots.event_image(recording.window(75_000, 125_000)))
    assert picture[0, :, 1].tolist() == [255, 60, 255]
    text = image_tags(shelf, "height: 9px")
    assert text.count("<img") == 1
    assert 'alt="&lt;a&gt;" title="&lt;a&gt;" style="height: 9px"' in text
    assert f'src="data:image/png;base64,{base64.b64encode(png).decode()}"' in text


def test_classes_are_joined_if_there_are_several():
    cat, dog = ClassSummary("c & t", 5, [10, 30], [1.0, 1.0], [10, 20]), ClassSummary("dog", 7, [50], [2.0], [15])
    one, both = gallery("<pets>", [cat]), gallery("<pets>", [cat, dog], ["x<y: torn", "z: torn"])
    assert "<b>all</b>" not in one
    assert "Not read" not in one
    assert '<tr><td>c &amp; t</td><td class="n">5</td><td class="n">2</td><td class="n">20</td>' in one
    last = both[both.index("<b>all</b>") :]
    for cell in ("12", "3", "30", "22", "1", "50.0%"):
        start = f'<td class="n">{cell}</td>'
        assert last.index(start) >= 0
        last = last[last.index(start) + len(start) :]
    assert "<h2>Not read: 2</h2><ul><li>x&lt;y: torn</li><li>z: torn</li></ul>" in both
    assert "<title>&lt;pets&gt;</title>" in both


def test_a_gallery_fits_a_phone_and_follows_dark_mode():
    text = gallery("pets", [ClassSummary("cat", 5, [10], [1.0], [10])])
    assert '<meta name="viewport" content="width=device-width' in text
    assert "@media (prefers-color-scheme: dark)" in text
    narrow = text[text.index("@media (max-width") : text.index("</style>")]
    # each number has the name of its column
    labels = re.findall(r'nth-child\((\d)\)::before { content: "(.*?)"; }', narrow)
    assert labels == [(str(n), name) for n, name in enumerate(COLUMNS, 1)][1:-1]
    assert narrow.count("{") == narrow.count("}")
