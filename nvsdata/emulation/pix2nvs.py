"""PIX2NVS (thesis chapter 3): the settings, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass

from nvsdata.emulation.frame_emulator import FrameEmulator
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.emulation.settings import PIX2NVSSettings
from nvsdata.video.frames import VideoFrame


@dataclass(frozen=True)
class PIX2NVS(PIX2NVSSettings, FrameEmulator):
    """Video to events, by the parameters of Table 3.1; the defaults are the best row of Table 3.3.

    How a pixel's brightness is seen (3.2.1):

    - `hue`: b / (r + g) in place of luminance, 0.299 r + 0.587 g + 0.114 b (black: 0; default False)
    - `mode` (LICE_mode): "LI" logarithm (3.1), "CE" contrast to the four neighbors (3.2), "LICE" the
      logarithm of that (default "LI")
    - `t_log` (T_log): brightness, 0 to 255, up to which (3.1) is linear; 0 for the plain logarithm (default 0)
    - `gamma` (γ): exponent of the perceptual luminance that CE and LICE take (default 2.2)
    - `continuous`: scale the linear part so that it meets the logarithm, q ln(T_log) / T_log; as printed,
      (3.1) jumps at T_log (default False)

    When it fires (3.2.2):

    - `difference` (dif): d, to the reference at the same place, "co-located" (3.3), or to the "average" of its
      four or the "minimum" of its two diagonal neighbors (3.4), borders replicated (default "co-located")
    - `inhibition` (B): in each B x B block only the largest |d| stays (3.5); 1 for none (default 1)
    - `threshold` (T_map): |d| at which a position fires (default 0.2)
    - `max_events` (M_max): most events per position and frame, out of floor(|d| / T_map) (3.8) (default 3)
    - `timestamps` (tstamp): "interpolated", the k-th event at the instant at which the line from 0 to d
      crosses k T_map; "random", "linear" or "fixed" as in (3.7). In whole µs, random times lie in
      [F_n-1, F_n), and the last of the linear times is F_n (default "interpolated")

    What the reference remembers (3.2.3):

    - `new` (new): update all positions (True) or only those that fired (default True)
    - `exp` (exp): moving average (3.10) or the last frame itself (3.9) (default True)
    - `alpha` (α): share of the newest frame in the moving average, above 0 and up to 1 (default 0.5)

    What real sensors add, off by default:

    - `noise_rate`: background activity in Hz per pixel, half of it ON (default 0)
    - `mismatch`: standard deviation of the pixels' thresholds, relative to `threshold` (default 0)
    - `hot_pixels`, `hot_rate`: share of pixels that fire ON by themselves, and how often, in Hz (default 0, 100)
    - `refractory`: µs for which a pixel is blind after an event (default 0)
    - `bandwidth`: events per second that the readout can pass, 0 for any number; events wait for their turn, and
      a pixel whose event still waits is blind (default 0)
    - `seed`: of all that is random (default 0)

    Raises ValueError for settings out of range.
    """

    def begin(self, first: VideoFrame) -> PIX2NVSState:
        """A run that begins with a frame."""
        return PIX2NVSState(self, first)


# rows of Table 3.3 from the worst to the best, and the settings of section 3.4.1
PRESETS = {
    "table-3.3-row-1": PIX2NVS(t_log=20, inhibition=2, max_events=1, threshold=0.4, new=False, exp=False),
    "table-3.3-row-2": PIX2NVS(t_log=0, inhibition=2, max_events=1, threshold=0.2, new=False, exp=False),
    "table-3.3-row-3": PIX2NVS(t_log=0, inhibition=2, max_events=1, threshold=0.2, new=False, exp=True),
    "table-3.3-row-4": PIX2NVS(t_log=0, inhibition=2, max_events=1, threshold=0.2, new=True, exp=True),
    "table-3.3-row-5": PIX2NVS(),
    "section-3.4.1": PIX2NVS(t_log=20, max_events=1, threshold=0.4, timestamps="fixed", exp=False),
    # the logarithm alone makes events of a single level of noise in the dark
    "footage": PIX2NVS(t_log=20, continuous=True),
}
