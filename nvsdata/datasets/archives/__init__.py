"""Archives in which a dataset is published: download, check, unpack."""
