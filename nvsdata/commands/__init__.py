"""What `nvsdata` can do: a module per command, with `add_arguments(parser)` and `run(args)`, the exit code."""
