"""Networks that follow events, one by one."""
