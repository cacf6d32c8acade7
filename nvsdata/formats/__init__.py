"""Files of events, with one module per format. A format is recognized by content first, and by extension second.

`docs/extending.md` shows how to add a format.
"""

from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.reading import open, read
from nvsdata.formats.registry import FORMATS, Format, register_format, suffixes, writer_of
from nvsdata.formats.saving import left_out, write

__all__ = [
    "FORMATS",
    "FileRecording",
    "Format",
    "left_out",
    "open",
    "read",
    "register_format",
    "suffixes",
    "write",
    "writer_of",
]
