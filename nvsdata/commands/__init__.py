"""Commands of `nvsdata`: a module each, with `add_arguments(parser)` and `run(args)`, which returns the exit code."""
