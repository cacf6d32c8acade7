"""AEDAT files, versions 1 to 4 (jAER, cAER, DV)."""
