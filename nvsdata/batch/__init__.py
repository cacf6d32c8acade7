"""Running over folders of files: manifests, shards, workers, estimates, resuming."""
