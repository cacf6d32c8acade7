"""Files at URLs: reading of ranges with retries, and a cache of blocks on the local disk."""
