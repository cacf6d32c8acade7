"""Frames of video files, cameras, folders of images and recordings."""
