"""Recording with DAVIS cameras over USB."""
