"""Estimation: from cleaned tracks to synchronisation, geometry, trajectory and adjustment."""
