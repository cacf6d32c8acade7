"""Videos played on a monitor in front of a camera, and recorded."""
