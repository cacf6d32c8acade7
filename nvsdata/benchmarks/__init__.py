"""Run time against error: what `nvsdata bench` measures, and how it is shown."""
