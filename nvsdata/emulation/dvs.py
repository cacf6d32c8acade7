"""DVS: a pixel that remembers the light at its last event; the settings, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from math import log

from nvsdata.emulation.dvs_state import DVSState
from nvsdata.emulation.frame_emulator import FrameEmulator
from nvsdata.emulation.settings import DVSSettings
from nvsdata.video.frames import VideoFrame


@dataclass(frozen=True)
class DVS(DVSSettings, FrameEmulator):
    """Video to events, by the pixel of real sensors (Lichtsteiner, Posch and Delbruck 2008).

    A pixel sees the logarithm of light, L = ln(q + dark), a line from frame to frame, and remembers M, what L was at
    its last event. At the instant at which L - M reaches `on`, or falls to -`off`, it fires, and M moves by this
    threshold: what is beyond it counts towards the next event. Nothing is lost between frames, so the number of
    events doesn't depend on the frame rate, and changes below a threshold add up.

    - `on`, `off`: thresholds (default 0.3: light that changes by 35%)
    - `dark`: gray level that is added to brightness q, luminance from 0 to 255 (default 3)
    - `upsample`: frames between frames, "linear", "flow" or a number; see `video.upsample` (default "none")
    - `mismatch`: standard deviation of the pixels' thresholds, ON and OFF by themselves, relative to `on` and `off`;
      none is below a tenth of these (default 0)
    - `cutoff`: bandwidth in Hz of a white pixel's photoreceptor, of first order; that of a darker one is
      (q + 20) / 275 of it, as v2e has it (Hu, Liu and Delbruck 2021); it is constant while light changes by 10%. 0 for
      one that follows at once (default 0)
    - `leak`: ON events per s and pixel that come without light, because M falls; where pixels begin is random then
      (default 0)
    - `noise_rate`: background activity in Hz of a black pixel, half of it ON; a quarter of it at white, in proportion
      between, as v2e has it (default 0)
    - `hot_pixels`, `hot_rate`: share of pixels that fire ON by themselves, and how often, in Hz (default 0, 100)
    - `refractory`: µs for which a pixel is blind after an event; M moves on with what it doesn't show (default 0)
    - `bandwidth`: events per second that the readout can pass, 0 for any number; events wait for their turn, and
      a pixel whose event still waits is blind (default 0)
    - `seed`: of all that is random (default 0)

    Raises ValueError for settings out of range.
    """

    def begin(self, first: VideoFrame) -> DVSState:
        """A run that begins with a frame."""
        return DVSState(self, first)


# Gallego et al. 2020, Table 1: the least contrast that each can be set to, its noise at rest and its readout; spread of
# the thresholds by Lichtsteiner et al. 2008 and Brandli et al. 2014, for the others none is stated
SENSORS = {
    "ideal": DVS(),
    "dvs128": DVS(on=log(1.17), off=log(1.17), mismatch=0.021 / 0.17, noise_rate=0.05, bandwidth=1e6),
    "davis240c": DVS(on=log(1.11), off=log(1.11), mismatch=0.035 / 0.11, noise_rate=0.1, bandwidth=12e6),
    "davis346": DVS(on=log(1.143), off=log(1.225), noise_rate=0.1, bandwidth=12e6),
    "gen4": DVS(on=log(1.11), off=log(1.11), noise_rate=0.1, bandwidth=1066e6),
}
