"""Ground tools that every room stands on: errors, files, locks, signals, processes, checks of settings."""
