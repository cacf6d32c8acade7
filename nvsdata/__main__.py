"""Command line for `python -m nvsdata`."""

import sys

from nvsdata.cli import main

sys.exit(main())
