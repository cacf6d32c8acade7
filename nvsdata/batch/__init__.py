"""Runs over folders of files: manifest, shards, workers, estimate, resuming."""
