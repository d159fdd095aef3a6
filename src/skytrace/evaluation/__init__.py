"""How far a reconstruction lies from the truth: its path, its camera centres, its clocks. Plain arrays, no files."""
