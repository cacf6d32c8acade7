"""Events from video: PIX2NVS (thesis chapter 3), and DVS, the pixel of real sensors, which can be fitted to one."""

from nvsdata.emulation.dvs import DVS, SENSORS
from nvsdata.emulation.fitting import Fit, fit
from nvsdata.emulation.frame_emulator import StatefulEmulator
from nvsdata.emulation.pix2nvs import PIX2NVS, PRESETS

__all__ = ["DVS", "PIX2NVS", "PRESETS", "SENSORS", "Fit", "StatefulEmulator", "fit"]
