"""Graphs of events: neighbors, edges, convolutions and pooling."""
