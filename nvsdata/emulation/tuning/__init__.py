"""The search for settings that come closest to a real recording (thesis 3.4.3)."""
