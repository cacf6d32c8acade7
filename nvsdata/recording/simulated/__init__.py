"""Simulated camera at the USB level, which runs with the real driver."""
