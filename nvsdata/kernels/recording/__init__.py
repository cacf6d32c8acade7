"""Kernels for recording from cameras."""
