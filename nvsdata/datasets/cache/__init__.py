"""The cache on disk, which stores the output of a pipeline's first, deterministic transforms."""
