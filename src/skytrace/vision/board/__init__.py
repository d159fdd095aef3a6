"""Finding calibration boards in pictures: the corners of chessboards, whole or in part, and ChArUco boards."""
