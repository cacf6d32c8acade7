"""DAVIS cameras: their registers, their byte stream, and a file format of that stream."""
