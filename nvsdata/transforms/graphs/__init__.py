"""Graphs of events: edges, node features, augmentation."""
