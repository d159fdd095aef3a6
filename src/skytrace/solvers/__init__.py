"""Solvers on plain arrays: minimal problems, RANSAC, splines, banded least squares."""
