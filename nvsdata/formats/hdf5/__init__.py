"""HDF5 files of events: the layouts that are read, and nvsdata's own, which is written."""
