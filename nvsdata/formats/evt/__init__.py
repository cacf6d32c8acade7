"""Prophesee RAW files: EVT2, EVT 2.1 and EVT3."""
