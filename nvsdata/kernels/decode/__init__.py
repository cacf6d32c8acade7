"""Conversion of bytes of recordings to columns of events, and back."""
