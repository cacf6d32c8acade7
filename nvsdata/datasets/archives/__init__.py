"""The archives in which a dataset is published: fetched, checked, unpacked."""
