"""What the other rooms hand to each other: events, recordings, graphs, batches."""
