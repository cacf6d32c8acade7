"""Readers of a USB endpoint that lose no transfer."""
