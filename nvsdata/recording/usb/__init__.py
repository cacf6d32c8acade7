"""Reading a USB endpoint without losing a transfer."""
