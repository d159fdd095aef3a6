"""Geometry on plain arrays: rigid motions, lenses, epipolar relations, triangulation."""
