"""Benchmarks of `nvsdata bench`: run time, memory and error, as tables and charts."""
