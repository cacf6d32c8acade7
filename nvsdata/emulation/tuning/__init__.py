"""Search for the settings whose events are nearest to a real recording (thesis, section 3.4.3)."""
