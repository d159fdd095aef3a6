"""Measured tables of what the methods achieve: recordings, synchronisation, ablations."""
