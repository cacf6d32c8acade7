"""Events to events: windows, sampling, filters, noise and other changes."""
