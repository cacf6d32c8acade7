"""Incremental inference: networks that are updated as events arrive."""
