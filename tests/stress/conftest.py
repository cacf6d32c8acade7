"""The list of all transforms lies among the tests of transforms."""

import sys
from pathlib import Path

TRANSFORMS = str(Path(__file__).parents[1] / "transforms")
if TRANSFORMS not in sys.path:
    sys.path.append(TRANSFORMS)
