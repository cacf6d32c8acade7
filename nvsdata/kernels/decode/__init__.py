"""Bytes of recordings to columns of events, and back."""
