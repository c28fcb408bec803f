"""Parts that algorithms are assembled from: networks, distributions, losses, mixers. Torch only."""
