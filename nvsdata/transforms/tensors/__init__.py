"""Events to tensors: frames, images, surfaces, histograms, points."""
