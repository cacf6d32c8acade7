"""Networks whose scores follow events, one event at a time."""
