"""The nouns of the package: cameras, clocks, tracks, trajectories, reconstructions. Frozen, checked on construction."""
