"""Other libraries, which `nvsdata bench --peers` measures; each module imports them where they are used."""
