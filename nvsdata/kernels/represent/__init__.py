"""Loops that turn events into images, surfaces, features and samples."""
