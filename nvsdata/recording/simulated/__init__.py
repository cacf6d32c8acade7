"""A camera that isn't there, simulated at the USB level, so that the real driver is what runs."""
