"""Spatio-temporal bundle adjustment: poses, clocks, lenses and the trajectory together."""
