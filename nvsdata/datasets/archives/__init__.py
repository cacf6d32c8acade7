"""What a dataset is published as: fetched, checked, unpacked."""
