"""Calibration of a lens from pictures of a flat board, the camera or board moving while the rows are read out."""
