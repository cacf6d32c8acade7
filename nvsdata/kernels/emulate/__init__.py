"""Emulation of event cameras."""
