"""PIX2NVS (thesis, chapter 3): the emulator and its presets."""

from __future__ import annotations

from dataclasses import dataclass

from nvsdata.emulation.frame_emulator import FrameEmulator
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.emulation.settings import PIX2NVSSettings
from nvsdata.video.frames import VideoFrame


@dataclass(frozen=True)
class PIX2NVS(PIX2NVSSettings, FrameEmulator):
    """Emulator that converts video to events by PIX2NVS (thesis, chapter 3).

    Each frame becomes a value per pixel, and a pixel whose value differs from a reference by the threshold fires. Then
    the reference is updated. Defaults are the best row of Table 3.3 of the thesis. Equations (eq.) are those of the
    thesis, and names in brackets are its symbols (Table 3.1).

    Args:
        hue: Use the hue b / (r + g) in place of luminance, 0.299 r + 0.587 g + 0.114 b; black has hue 0.
        mode: (LICE_mode) Value of a pixel: "LI" for the logarithm of brightness (eq. 3.1), "CE" for the contrast to
            the four neighbors (eq. 3.2), "LICE" for the logarithm of that contrast.
        t_log: (T_log) Brightness, 0 to 255, up to which eq. 3.1 is linear; 0 for the plain logarithm.
        gamma: (γ) Exponent of the perceptual luminance that CE and LICE are computed from.
        continuous: Scale the linear part, q ln(T_log) / T_log, so that it meets the logarithm. As printed in the
            thesis, eq. 3.1 jumps at T_log.
        difference: (dif) Reference that is subtracted from a pixel's value, which results in the difference d:
            "co-located" for that of the same pixel (eq. 3.3), "average" for the average over the four neighbors
            (eq. 3.4), or "minimum" for the smaller one of the upper left and the lower right neighbor (eq. 3.4).
            Borders are replicated.
        inhibition: (B) Side in pixels of the blocks in which only the largest |d| fires (eq. 3.5); 1 for none.
        threshold: (T_map) |d| at which a pixel fires.
        max_events: (M_max) Largest number of events per pixel and frame, out of floor(|d| / T_map) (eq. 3.8).
        timestamps: (tstamp) Times of events. "interpolated": the k-th event is when the line from 0 to d crosses
            k T_map. "random", "linear" and "fixed" are those of eq. 3.7. In whole µs, random times are in
            [F_n-1, F_n), and the last of the linear times is F_n, where F_n is the time of frame n.
        new: Update the reference of all pixels after each frame (True), or only of those that fired (False).
        exp: The reference is a moving average of the frames (True; eq. 3.10), or the previous frame (False; eq. 3.9).
        alpha: (α) Weight of the newest frame in the moving average, above 0 and up to 1.
        noise_rate: Rate of background activity in Hz per pixel; half of these events are ON.
        mismatch: Standard deviation of the pixels' thresholds, relative to `threshold`.
        hot_pixels: Fraction of pixels that fire ON without a change of light.
        hot_rate: Rate at which hot pixels fire, in Hz.
        refractory: Time in µs after an event during which a pixel can't fire.
        bandwidth: Events per second that the readout can pass, 0 for no limit. Events queue, and a pixel can't fire
            while its event waits.
        seed: Seed of all random numbers.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> import numpy as np
        >>> frames = [np.full((4, 6), gray, np.uint8) for gray in (100, 110, 200)]
        >>> PIX2NVS(threshold=0.5).emulate(frames, fps=25)
        Events(24 events, 0 µs, 6x4)
    """

    def begin(self, first: VideoFrame) -> PIX2NVSState:
        """Return the state of an emulation that begins with a frame."""
        return PIX2NVSState(self, first)


# the rows of Table 3.3 of the thesis, from the farthest from real recordings to the nearest; the settings of the first
# comparison with a camera (thesis, section 3.4.1); and settings for videos with dark parts
PRESETS = {
    "table-3.3-row-1": PIX2NVS(t_log=20, inhibition=2, max_events=1, threshold=0.4, new=False, exp=False),
    "table-3.3-row-2": PIX2NVS(t_log=0, inhibition=2, max_events=1, threshold=0.2, new=False, exp=False),
    "table-3.3-row-3": PIX2NVS(t_log=0, inhibition=2, max_events=1, threshold=0.2, new=False, exp=True),
    "table-3.3-row-4": PIX2NVS(t_log=0, inhibition=2, max_events=1, threshold=0.2, new=True, exp=True),
    "table-3.3-row-5": PIX2NVS(),
    "section-3.4.1": PIX2NVS(t_log=20, max_events=1, threshold=0.4, timestamps="fixed", exp=False),
    # in the dark, the plain logarithm turns noise of a single gray level into events
    "footage": PIX2NVS(t_log=20, continuous=True),
}
