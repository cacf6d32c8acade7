"""The packed store: all recordings of a dataset in one file (docs/dev/store.md)."""
