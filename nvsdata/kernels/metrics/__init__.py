"""Distances between streams of events."""
