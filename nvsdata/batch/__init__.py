"""Runs over folders of files: manifests, shards, workers, estimates, and resuming."""
