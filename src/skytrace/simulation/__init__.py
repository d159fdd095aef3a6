"""Flights with known truth: scenarios, the cameras and detectors that film them, and their FLIGHT folders."""

from skytrace.simulation.scenario import Scenario, presets
from skytrace.simulation.simulator import SimulatedFlight, TrueCamera, TrueDetections, Truth, simulate
from skytrace.simulation.write import write_flight

__all__ = [
    "Scenario",
    "SimulatedFlight",
    "TrueCamera",
    "TrueDetections",
    "Truth",
    "presets",
    "simulate",
    "write_flight",
]
