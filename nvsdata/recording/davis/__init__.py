"""DAVIS cameras: their registers, their byte stream, and the file that keeps it."""
