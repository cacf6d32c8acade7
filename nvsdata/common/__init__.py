"""Tools that all other packages use: errors, files, locks, signals, processes, validation of settings."""
