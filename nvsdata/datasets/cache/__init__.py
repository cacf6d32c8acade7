"""The cache on disk: samples as the deterministic first transforms of a pipeline return them."""
