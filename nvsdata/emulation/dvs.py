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

    The input of a pixel is the logarithm of light, L = ln(q + dark), interpolated linearly between frames. The pixel
    stores M, the value of L at its last event. When L - M reaches `on`, or falls to -`off`, the pixel fires, and M
    moves by this threshold: the rest of the change counts towards the next event. So the number of events doesn't
    depend on the frame rate, and changes below a threshold add up.

    Args:
        on: Threshold of ON events; 0.3 is a change of light by 35%.
        off: Threshold of OFF events.
        dark: Gray level that is added to the brightness q, which is luminance from 0 to 255.
        upsample: Frames made between frames: "none", "linear", "flow", or a number of linear steps; see
            `video.upsample`.
        mismatch: Standard deviation of the pixels' thresholds, independent for ON and OFF, relative to `on` and `off`.
            Each threshold is at least a tenth of `on` or `off`.
        cutoff: Bandwidth in Hz of a white pixel's photoreceptor, a low-pass filter of first order; 0 for no limit. At
            brightness q, the bandwidth is `cutoff` * (q + 20) / 275, as in v2e (Hu, Liu and Delbruck 2021). It is
            updated when light has changed by about 10%.
        leak: ON events per second and pixel that occur without a change of light, because M falls. With a leak, L - M
            starts at a random value between 0 and the ON threshold at each pixel.
        noise_rate: Rate of background activity of a black pixel in Hz; half of these events are ON. The rate falls
            linearly with brightness to a quarter at white, as in v2e.
        hot_pixels: Fraction of pixels that fire ON without a change of light.
        hot_rate: Rate at which hot pixels fire, in Hz.
        refractory: Time in µs after an event during which a pixel can't fire; M moves as if the suppressed events had
            occurred.
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


# thresholds, noise rates and readout bandwidths are those of Gallego et al. 2020, Table 1; the mismatch is that of
# Lichtsteiner et al. 2008 (dvs128) and Brandli et al. 2014 (davis240c), and not published for the other sensors
SENSORS = {
    "ideal": DVS(),
    "dvs128": DVS(on=log(1.17), off=log(1.17), mismatch=0.021 / 0.17, noise_rate=0.05, bandwidth=1e6),
    "davis240c": DVS(on=log(1.11), off=log(1.11), mismatch=0.035 / 0.11, noise_rate=0.1, bandwidth=12e6),
    "davis346": DVS(on=log(1.143), off=log(1.225), noise_rate=0.1, bandwidth=12e6),
    "gen4": DVS(on=log(1.11), off=log(1.11), noise_rate=0.1, bandwidth=1066e6),
}
