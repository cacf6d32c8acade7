"""Files of a camera's stream whose first line or words aren't those of a camera."""

import json

import numpy as np
import pytest

import nvsdata
from nvsdata import FormatError
from nvsdata.recording.davis.file import header
from nvsdata.recording.davis.stream import DavisDecoder

RESET, BEGIN, SIGNAL, COLUMN_END, END = 1, 8, 12, 13, 10


def journal(path, words, **how):
    """A file of these words; `how`: what its first line says otherwise than a camera's."""
    line = header(DavisDecoder(240, 180, steady=True), None, {})
    mark, result = line.split(b" ", 1)
    result = json.loads(result)
    result["decoder"] |= how
    path.write_bytes(mark + b" " + json.dumps(result).encode() + b"\n" + np.array(words, "<u2").tobytes())
    return path


def test_a_decoder_whose_times_may_fall_is_refused(tmp_path):
    words = [RESET, 0x8000 | 500, 0x2001, 0x8000 | 3, 0x2002]
    with pytest.raises(FormatError, match=r"the first line doesn't describe the decoder: .* isn't steady"):
        nvsdata.open(journal(tmp_path / "a.davis", words, steady=False))
    # a time that falls shows that the camera's clock went round
    assert nvsdata.read(journal(tmp_path / "a.davis", words)).t.tolist() == [500, 3 + (1 << 15)]
    with pytest.raises(ValueError, match="only a steady decoder returns events in order"):
        next(DavisDecoder(240, 180).decoded([b""], None))


def region(first, last):
    """Words that announce a region from one column and row to others."""
    numbers = (*first, *last)
    return [word for n in numbers for word in (0x5000 | 1 << 8 | n >> 8, 0x5000 | 2 << 8 | n & 0xFF)]


def test_frames_without_pixels_are_left_out_beyond_the_bound(tmp_path):
    """16 KB of words that end columns claim a frame of 32 MB."""
    side = 4096
    frame = [BEGIN, *region((0, 0), (side - 1, side - 1)), *[COLUMN_END] * side, SIGNAL, *[COLUMN_END] * side, END]
    path = journal(tmp_path / "a.davis", [RESET, *frame * 4], width=side, height=side)
    recording = nvsdata.open(path)
    assert [one.pixels.shape for one in recording.frames()] == [(side, side)] * 2
    recording.read()
    assert recording.repairs["broken_frames"] == 2
