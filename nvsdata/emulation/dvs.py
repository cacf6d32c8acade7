"""DVS, a model of the pixels of real sensors: the emulator and its presets."""

from __future__ import annotations

from dataclasses import dataclass
from math import log

from nvsdata.emulation.dvs_state import DVSState
from nvsdata.emulation.frame_emulator import FrameEmulator
from nvsdata.emulation.settings import DVSSettings
from nvsdata.video.frames import VideoFrame


@dataclass(frozen=True)
class DVS(DVSSettings, FrameEmulator):
    """Emulator that converts video to events by a model of a sensor's pixels (Lichtsteiner, Posch and Delbruck 2008).

    A pixel sees the logarithm of light, L = ln(q + dark), interpolated linearly between frames, and stores M, its value
    at the last event. When L - M reaches `on`, or falls to -`off`, the pixel fires, and M moves by this threshold: the
    rest of the change counts towards the next event. So the number of events doesn't depend on the frame rate, and
    changes below a threshold add up.

    Args:
        on: Threshold of ON events; 0.3 is a change of light by 35%.
        off: Threshold of OFF events.
        dark: Gray level that is added to the brightness q, which is luminance from 0 to 255.
        upsample: Frames made between frames: "none", "linear", "flow", or a number of linear steps; see
            `video.upsample`.
        mismatch: Standard deviation of the pixels' thresholds, independent for ON and OFF, relative to `on` and `off`;
            none is below a tenth of these.
        cutoff: Bandwidth in Hz of a white pixel's photoreceptor, a low-pass filter of first order. That of a darker
            pixel is (q + 20) / 275 of it, as in v2e (Hu, Liu and Delbruck 2021), and constant while light changes by
            10%. 0 for no limit.
        leak: ON events per second and pixel that occur without a change of light, because M falls. With a leak, pixels
            begin at random phases.
        noise_rate: Rate of background activity in Hz of a black pixel; half of it is ON. It falls linearly with
            brightness to a quarter at white, as in v2e.
        hot_pixels: Fraction of pixels that fire ON without a change of light.
        hot_rate: Rate at which hot pixels fire, in Hz.
        refractory: Time in µs after an event during which a pixel can't fire; M still moves by events that it misses.
        bandwidth: Events per second that the readout can pass, 0 for no limit. Events queue, and a pixel can't fire
            while its event waits.
        seed: Seed of all random numbers.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> import numpy as np
        >>> frames = [np.full((4, 6), gray, np.uint8) for gray in (100, 110, 200)]
        >>> DVS().emulate(frames, fps=25)
        Events(48 events, 20485 µs, 6x4)
    """

    def begin(self, first: VideoFrame) -> DVSState:
        """Return the state of an emulation that begins with a frame."""
        return DVSState(self, first)


# least contrast, noise at rest and readout by Gallego et al. 2020, Table 1; spread of the thresholds by Lichtsteiner et
# al. 2008 and Brandli et al. 2014, who don't state it for the other sensors
SENSORS = {
    "ideal": DVS(),
    "dvs128": DVS(on=log(1.17), off=log(1.17), mismatch=0.021 / 0.17, noise_rate=0.05, bandwidth=1e6),
    "davis240c": DVS(on=log(1.11), off=log(1.11), mismatch=0.035 / 0.11, noise_rate=0.1, bandwidth=12e6),
    "davis346": DVS(on=log(1.143), off=log(1.225), noise_rate=0.1, bandwidth=12e6),
    "gen4": DVS(on=log(1.11), off=log(1.11), noise_rate=0.1, bandwidth=1066e6),
}
