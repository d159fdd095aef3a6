"""3D flight trajectories, camera poses and clocks from unsynchronised cameras that see only the flying target."""

__version__ = "0.1.0"
