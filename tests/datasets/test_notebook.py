"""What a notebook shows of a dataset."""

from __future__ import annotations

import re
import string

import trees

from nvsdata import ASLANDVS, EventFolder


def test_a_recording_of_each_of_the_first_ten_classes(tmp_path):
    one = trees.atis(trees.some(1))
    trees.put(tmp_path, {f"{name}/{i}.bin": one for name in string.ascii_lowercase[:12] for i in range(2)})
    (tmp_path / "a/0.bin").write_bytes(b"abc")
    (tmp_path / "b/0.bin").unlink()
    (tmp_path / "b/0.bin").symlink_to(tmp_path / "nowhere")
    text = EventFolder(tmp_path)._repr_html_()
    assert text.startswith("<pre>EventFolder: 24 recordings, 12 classes\n")
    # of those two, the first can't be read
    assert re.findall(r'title="(.*?)"', text) == list("cdefghij")


def test_pairs_have_no_pictures(home):
    text = ASLANDVS(home(trees.aslandvs(True)))._repr_html_()
    assert "classes" in text
    assert "<img" not in text
    assert "title=" not in text
