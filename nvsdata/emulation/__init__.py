"""PIX2NVS: video to events (thesis chapter 3)."""

from nvsdata.emulation.pix2nvs import PIX2NVS, PRESETS

__all__ = ["PIX2NVS", "PRESETS"]
