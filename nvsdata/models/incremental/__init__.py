"""Incremental inference: scores that are updated with each event."""
