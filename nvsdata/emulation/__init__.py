"""Events from video: PIX2NVS (thesis chapter 3), and DVS, the pixel of real sensors."""

from nvsdata.emulation.dvs import DVS
from nvsdata.emulation.pix2nvs import PIX2NVS, PRESETS

__all__ = ["DVS", "PIX2NVS", "PRESETS"]
