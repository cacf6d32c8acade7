"""Events to events: windows, subsampling, filters, noise and other changes."""
