"""Containers that the other packages pass to each other: events, recordings, graphs, batches."""
