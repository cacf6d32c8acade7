"""Contact sheets of recordings: a frame of each video next to an image of its events."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from nvsdata import formats
from nvsdata.batch.folder import Video
from nvsdata.batch.manifest import Manifest
from nvsdata.plots import event_image, save_png
from nvsdata.plots.drawing import FONT, INK
from nvsdata.video.decoder import quiet

COLUMNS, ROWS = 4, 10
TILE = (160, 120)
CAPTION = 18
LONGEST = 30  # characters of a name
SPAN = 40_000  # µs of events in an image


class Sheets:
    """Contact sheets `out/contact-sheet-001.png` and so on; use it in a `with` block.

    Each sheet is drawn when all its videos are done, or when the block ends. Then `contact-sheet-000.png` is drawn with
    up to forty flagged recordings, if there are any.
    """

    def __init__(self, out: Path, videos: list[Video], manifest: Manifest) -> None:
        size = COLUMNS * ROWS
        self.out, self.manifest = out, manifest
        self._pages = [videos[first : first + size] for first in range(0, len(videos), size)]
        self._page_of = {video.name: n for n, page in enumerate(self._pages) for video in page}
        self._stale: set[int] = set()

    def add(self, video: Video) -> None:
        """Note that a video has a new line in the manifest; draw its page if all its videos are done."""
        page = self._page_of[video.name]
        self._stale.add(page)
        if all(other.name in self.manifest.videos for other in self._pages[page]):
            self._draw(page)

    def _draw(self, page: int) -> None:
        there = [(video, self.manifest.videos.get(video.name)) for video in self._pages[page]]
        save_png(_page(there), self.out / f"contact-sheet-{page + 1:03}.png")
        self._stale.discard(page)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # an error of drawing must not hide the error that ended the block
        with suppress(OSError):
            for page in sorted(self._stale):
                self._draw(page)
            self._draw_flagged()

    def _draw_flagged(self) -> None:
        path, lines = self.out / "contact-sheet-000.png", self.manifest.videos
        videos = [video for page in self._pages for video in page]
        flagged = [(video, lines[video.name]) for video in videos if lines.get(video.name, {}).get("review")]
        if flagged:
            save_png(_page(flagged[: COLUMNS * ROWS]), path)
        else:
            path.unlink(missing_ok=True)


def _page(videos: Sequence[tuple[Video, dict[str, Any] | None]]) -> np.ndarray:
    wide, high = 2 * TILE[0] + 12, TILE[1] + CAPTION + 8
    rows = -(-len(videos) // COLUMNS)
    page = np.full((rows * high, min(COLUMNS, len(videos)) * wide, 3), 240, np.uint8)
    for n, (video, line) in enumerate(videos):
        left, top = n % COLUMNS * wide, n // COLUMNS * high
        page[top : top + CAPTION + TILE[1], left : left + 2 * TILE[0]] = _tile(video, line)
    return page


def _tile(video: Video, line: dict[str, Any] | None) -> np.ndarray:
    tile = np.full((CAPTION + TILE[1], 2 * TILE[0], 3), 240, np.uint8)
    tile[CAPTION:, : TILE[0]] = _fitted(_middle(video.path))
    rate = "-"
    if line is not None and "events" in line:
        half = line["duration"] // 2
        # the tile of a missing or damaged recording stays empty
        with suppress(OSError, ValueError):
            events = formats.read(video.target, max(half - SPAN // 2, 0), half + SPAN // 2)
            tile[CAPTION:, TILE[0] :] = _fitted(event_image(events))
            rate = f"{line['events'] * 1e3 / max(line['duration'], 1):,.0f} k/s"
    caption = f"{_short(video.name)}  {rate}"
    cv2.putText(tile, caption, (2, CAPTION - 5), FONT, 0.4, INK, 1, cv2.LINE_AA)
    return tile


def _short(name: str) -> str:
    """Return the name of a video with its folder, without the extension; of a long name only the end."""
    text = Path(name).with_suffix("").as_posix()
    return text if len(text) <= LONGEST else f"..{text[2 - LONGEST :]}"


def _middle(path: Path) -> np.ndarray:
    """Return the frame at the midpoint of a video; gray if it can't be read."""
    with quiet():
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        try:
            capture.set(cv2.CAP_PROP_POS_FRAMES, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) // 2)
            ok, image = capture.read()
        finally:
            capture.release()
    return np.asarray(image) if ok else np.full((*TILE[::-1], 3), 128, np.uint8)


def _fitted(image: np.ndarray) -> np.ndarray:
    """Scale an image to fit a tile, and keep its aspect ratio."""
    height, width = image.shape[:2]
    scale = min(TILE[0] / width, TILE[1] / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    tile = np.full((TILE[1], TILE[0], 3), 220, np.uint8)
    x, y = (TILE[0] - size[0]) // 2, (TILE[1] - size[1]) // 2
    tile[y : y + size[1], x : x + size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return tile
