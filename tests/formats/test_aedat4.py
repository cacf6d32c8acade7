import numpy as np
import pytest
from lookalikes import rows

import nvsdata
from nvsdata import FormatError

aedat = pytest.importorskip("aedat")


def test_the_real_file(shared_samples):
    recording = nvsdata.open(shared_samples / "sample.aedat4")
    ev = recording.read()
    found = list(rows(ev))
    assert recording.sensor_size == (320, 240)
    assert len(found) == 111_954
    assert (found[0], found[-1]) == ((1605537493718345, 154, 204, 0), (1605537494308262, 88, 237, 1))
    start = found[0][0] + 100_000
    assert recording.read(start, start + 30_000) == ev.window(start, start + 30_000)
    theirs = np.concatenate([p["events"] for p in aedat.Decoder(str(recording.path)) if "events" in p])
    for name, field in {"t": "t", "x": "x", "y": "y", "p": "on"}.items():
        assert np.array_equal(getattr(ev, name), theirs[field])


@pytest.mark.parametrize("share", [0.001, 0.5])
def test_a_truncated_file_is_refused_or_read_as_far_as_it_goes(tmp_path, shared_samples, share):
    raw = (shared_samples / "sample.aedat4").read_bytes()
    (tmp_path / "a.aedat4").write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(FormatError, match="damaged AEDAT 4"):
        nvsdata.read(tmp_path / "a.aedat4")
    if share == 0.5:
        assert 0 < len(nvsdata.read(tmp_path / "a.aedat4", strict=False)) < 111_954
