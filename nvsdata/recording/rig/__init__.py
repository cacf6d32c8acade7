"""Videos played on a monitor before a camera, and recorded."""
