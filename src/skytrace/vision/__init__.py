"""From pictures to numbers: lens calibration, detection and tracking of targets against the sky."""
