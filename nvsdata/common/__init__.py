"""Basic tools that all other packages use: errors, files, locks, signals, processes, checks of settings."""
