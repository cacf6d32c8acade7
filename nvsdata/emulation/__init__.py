"""Events from video, by PIX2NVS (thesis, chapter 3) or DVS, a pixel model that can be fitted to a real sensor."""

from nvsdata.emulation.dvs import DVS, SENSORS
from nvsdata.emulation.fitting import Fit, fit
from nvsdata.emulation.frame_emulator import StatefulEmulator
from nvsdata.emulation.pix2nvs import PIX2NVS, PRESETS

__all__ = ["DVS", "PIX2NVS", "PRESETS", "SENSORS", "Fit", "StatefulEmulator", "fit"]
