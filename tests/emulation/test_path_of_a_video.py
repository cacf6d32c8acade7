"""The functions that a frame passes from its file to the recording."""

import sys
import threading
from collections import Counter
from pathlib import Path

from clips import moving_square, write_video

import nvsdata
from nvsdata.batch.folder import Video
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.job import Job, convert

ROOT = Path(nvsdata.__file__).parent
FRAMES = 12


def test_a_frame_passes_at_most_15_functions(tmp_path):
    path = write_video(tmp_path / "a.avi", moving_square(FRAMES))
    calls = Counter()

    def count(frame, event, _):
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(str(ROOT)):
            module = Path(code.co_filename).relative_to(ROOT).as_posix()
            if module.split("/")[0] in ("batch", "emulation", "video") or module == "common/prefetch.py":
                calls[module, code.co_qualname] += 1

    threading.setprofile(count)
    sys.setprofile(count)
    try:
        convert(Job(Video("a.avi", path, tmp_path / "a.h5"), PIX2NVS(), None, None))
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    passed = [name for name, number in calls.items() if number >= FRAMES - 1 and "<" not in name[1]]
    assert len(passed) <= 15, passed
