"""A monitor that shows images at given times, and returns the actual times (pygame-ce, SDL 2)."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any, Literal, Self, get_args

import cv2
import numpy as np

from nvsdata.recording.camera import host_time
from nvsdata.recording.live_view import DisplayError, pygame_or_error
from nvsdata.video.frames import VideoFrame

Scaling = Literal["aspect", "integer"]
OnChange = Callable[[float, np.ndarray], None]
USUAL_REFRESH = 60.0  # Hz that are assumed for a display that doesn't state its refresh rate
TRIALS = 240  # flips by which the refresh is measured
SAME = 0.01  # fraction by which a measured refresh may differ from that of the display's settings
# fractions of a refresh by which a flip may be off: at the stated refresh rate, and at any other
EVEN, VERY_EVEN = 0.05, 0.01
MOST = 0.95  # fraction of the flips that must be within that limit
FASTEST = 1e6 / 500  # µs; a shorter time between flips isn't a refresh
NAP = 0.02  # s between checks of the keyboard


class Monitor:
    """Full screen of a display for images on black, without mouse pointer and screen saver; use it in a `with` block.

    `refresh` is the measured time between two refreshes in µs, and `stated` the one that the display states. `synced`
    is True if images appear at refreshes of the display, False if a clock with the stated refresh paces them. `check`
    is a function that is called often during waits; an exception that it raises ends the wait. `confirmed` becomes True
    when Enter or Space is pressed. All methods must be called from the main thread. They raise KeyboardInterrupt when
    Escape is pressed or the window is closed.

    Args:
        display: Number of the display (default 0).
        region: (x, y, width, height) of the screen's part for images, in pixels (default: the entire screen).
        scaling: Scaling of images to that part: "aspect" for the largest size that fits, "integer" for the largest
            whole number (default "aspect").
        window: (width, height) in pixels of a window in place of the entire screen (default: none).
        on_change: Function that is called whenever the screen changes, with the host time (µs) and the pixels (uint8
            [H, W, 3], red first) (default: none).

    Raises:
        DisplayError: There is no such display.
        ValueError: The region is not within the screen.
    """

    def __init__(
        self,
        display: int = 0,
        *,
        region: tuple[int, int, int, int] | None = None,
        scaling: Scaling = "aspect",
        window: tuple[int, int] | None = None,
        on_change: OnChange | None = None,
    ) -> None:
        if scaling not in get_args(Scaling):
            raise ValueError(f"scaling must be one of {get_args(Scaling)}, not {scaling!r}")
        self._pygame = pygame = pygame_or_error()
        self.scaling, self._on_change = scaling, on_change
        self.check: Callable[[], None] = lambda: None
        self.confirmed = False
        try:
            pygame.display.init()
            screen = pygame.display.get_desktop_sizes()
            if not 0 <= display < len(screen):
                there = ", ".join(f"{n} ({width}x{height})" for n, (width, height) in enumerate(screen))
                raise pygame.error(f"there is no display {display}; there are {there}")
            self.size = window or screen[display]
            flags = 0 if window else pygame.FULLSCREEN | pygame.SCALED
            with warnings.catch_warnings():
                # pygame warns about drivers that draw without a GPU
                warnings.simplefilter("ignore")
                self._surface = pygame.display.set_mode(self.size, flags, display=display, vsync=int(not window))
            pygame.display.set_caption("nvsdata")
            pygame.display.set_allow_screensaver(False)
            pygame.mouse.set_visible(False)
        except pygame.error as error:
            pygame.display.quit()
            raise DisplayError(f"videos can't be shown: {error}") from None
        self.region = region or (0, 0, *self.size)
        x, y, width, height = self.region
        if min(x, y) < 0 or min(width, height) < 1 or x + width > self.size[0] or y + height > self.size[1]:
            self.close()
            raise ValueError(f"region {self.region} is not within the screen of {self.size[0]}x{self.size[1]}")
        self.refresh, self.stated, self.synced, self._cost = self._measure(display)
        self._origin, self._drawing = host_time(), 0.0

    def _measure(self, display: int) -> tuple[float, float, bool, float]:
        """Measure the times of flips; return the attributes `refresh`, `stated` and `synced`, and the cost of a flip.

        The cost is the duration of a flip in µs if flips don't wait for a refresh, otherwise 0.
        """
        times = []
        for _ in range(TRIALS):
            self._pygame.display.flip()
            times.append(host_time())
        rates = self._pygame.display.get_desktop_refresh_rates()
        stated = 1e6 / (rates[display] if display < len(rates) and rates[display] > 0 else USUAL_REFRESH)
        # the first flips don't wait, because the display's queue is empty
        found = np.array(times[2:])
        gaps = np.diff(found)
        usual = max(float(np.median(gaps)), 1.0)
        steps = np.maximum(np.rint(gaps / usual), 1)
        away = np.abs(gaps / usual - steps)
        even = EVEN if abs(usual / stated - 1) < SAME else VERY_EVEN
        if usual > FASTEST and (away < even).mean() >= MOST:
            # `steps` includes missed refreshes
            return float(np.polyfit(np.append(0, steps.cumsum()), found, 1)[0]), stated, True, 0.0
        return stated, stated, False, float(gaps.min())

    def refresh_warning(self) -> str | None:
        """Return a warning about an unusual refresh of the display, or None."""
        if not self.synced:
            return "the display doesn't wait for a refresh (is vertical sync off?): frames may be shown late"
        if abs(self.refresh / self.stated - 1) >= SAME / 10:
            return (
                f"the display states {1e6 / self.stated:.2f} Hz, but {1e6 / self.refresh:.2f} Hz are measured and used"
            )
        return None

    def fill(self, level: int, due: float | None = None) -> float:
        """Fill the screen with a gray level at the refresh nearest to `due`, and return its host time; see `show`."""
        return self._shown(lambda: self._surface.fill((level, level, level)), due)

    def show(self, frame: VideoFrame, due: float | None = None) -> float:
        """Show an image at the refresh nearest to `due` (host time in µs; None: the next refresh).

        Returns:
            The host time (µs) of that refresh.

        Raises:
            ValueError: "integer" scaling can't fit the image into the region.
        """
        picture, place = self._placed(frame)
        return self._shown(lambda: self._draw(picture, place), due)

    def fade(self, level: int, frame: VideoFrame, duration: int, *, back: bool = False) -> None:
        """Fade the entire screen in `duration` µs from a gray level to an image on black; with `back`, in reverse.

        Raises:
            ValueError: "integer" scaling can't fit the image into the region.
        """
        picture, (x, y) = self._placed(frame)
        whole = np.zeros((self.size[1], self.size[0], 3), np.uint8)
        height, width = picture.shape[:2]
        whole[y : y + height, x : x + width] = picture
        gray = np.full_like(whole, level)
        steps = max(int(duration / (2 * self.refresh)), 1)
        began = host_time()
        for n in range(1, steps):
            share = 1 - n / steps if back else n / steps
            mixed = np.asarray(cv2.addWeighted(whole, share, gray, 1 - share, 0))
            self._shown(lambda mixed=mixed: self._draw(mixed, (0, 0)), began + 2 * n * self.refresh)  # type: ignore[misc]

    def wait(self, until: float) -> None:
        """Keep the current image until a host time (µs)."""
        while (left := until - host_time()) > 0:
            self._attend()
            if self.synced and left < 4 * self.refresh:
                # flips without a pause keep the display's queue full, so that their times are those of refreshes
                self._pygame.display.flip()
            else:
                time.sleep(min(left / 1e6, NAP))

    def _shown(self, draw: Callable[[], Any], due: float | None) -> float:
        self._attend()
        if due is not None:
            self.wait(due - 1.5 * self.refresh - self._drawing)
        began = host_time()
        draw()
        # large images take long to draw, so the longest recent time is assumed
        self._drawing = max(host_time() - began, 0.9 * self._drawing)
        if not self.synced:
            earliest = max(host_time() + self._cost, (due or 0) - self.refresh / 2)
            tick = self._origin + np.ceil((earliest - self._origin) / self.refresh) * self.refresh
            time.sleep(max(0.0, (tick - self._cost - host_time()) / 1e6))
        try:
            self._pygame.display.flip()
        except self._pygame.error as error:
            raise DisplayError(f"the display is gone: {error}") from None
        now = host_time()
        if self._on_change is not None:
            self._on_change(now, np.ascontiguousarray(self._pygame.surfarray.pixels3d(self._surface).swapaxes(0, 1)))
        return now

    def _placed(self, frame: VideoFrame) -> tuple[np.ndarray, tuple[int, int]]:
        """Return the scaled image, uint8 [H, W, 3], red first, and the position (x, y) of its upper left corner."""
        pixels = frame.pixels
        height, width = pixels.shape[:2]
        x, y, *shown = self.place_of(width, height)
        size, scale = (shown[0], shown[1]), shown[0] / width
        how = cv2.INTER_NEAREST if self.scaling == "integer" else cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        picture = np.asarray(pixels if size == (width, height) else cv2.resize(pixels, size, interpolation=how))
        if picture.ndim == 2:
            picture = picture[..., None].repeat(3, 2)
        if picture.dtype != np.uint8:
            picture = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        picture = picture if frame.red_first else picture[..., ::-1]
        return np.ascontiguousarray(picture), (x, y)

    def place_of(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Return (x, y, width, height) on the screen of an image of that size; raise ValueError as `show` does."""
        x, y, wide, high = self.region
        scale = min(wide / width, high / height)
        if self.scaling == "integer":
            if scale < 1:
                raise ValueError(f"a frame of {width}x{height} is larger than the region of {wide}x{high}")
            scale = int(scale)
        wide_shown, high_shown = max(1, round(width * scale)), max(1, round(height * scale))
        return x + (wide - wide_shown) // 2, y + (high - high_shown) // 2, wide_shown, high_shown

    def _draw(self, picture: np.ndarray, place: tuple[int, int]) -> None:
        self._surface.fill((0, 0, 0))
        height, width = picture.shape[:2]
        self._surface.blit(self._pygame.image.frombuffer(picture, (width, height), "RGB"), place)

    def _attend(self) -> None:
        """Handle window and keyboard, and call `check`."""
        for event in self._pygame.event.get():
            key = event.key if event.type == self._pygame.KEYDOWN else None
            self.confirmed |= key in (self._pygame.K_RETURN, self._pygame.K_SPACE)
            if key == self._pygame.K_ESCAPE or event.type == self._pygame.QUIT:
                raise KeyboardInterrupt
        self.check()

    def close(self) -> None:
        """Release the screen."""
        self._pygame.display.quit()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
