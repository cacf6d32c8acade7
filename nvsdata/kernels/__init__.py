"""Numba loops: arrays in, arrays out; no classes, no files, no torch."""
