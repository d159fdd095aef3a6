"""Files in and out; other conventions are converted here and nowhere else."""
