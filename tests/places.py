"""Where tests find what lies outside them: the folder of real recordings, the recipes."""

from pathlib import Path

SHARED = Path(__file__).parents[2] / "shared" / "data"
RECIPES = Path(__file__).parents[1] / "recipes"
