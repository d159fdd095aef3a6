"""3D flight trajectories, camera poses and clocks from unsynchronised cameras that see only the flying target.

    import skytrace

    flight = skytrace.read_flight("flight")
    result = skytrace.reconstruct(flight)
    result.reconstruction.trajectory.position([12.0, 12.5])
    skytrace.write_run("run", result)

Every name below is imported when it is first used, so that `import skytrace` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from skytrace.api import Result, reconstruct, write_run
    from skytrace.errors import InputError, ReconstructionError, SkytraceError
    from skytrace.estimation.hints import Hints, OffsetHint, SimultaneousHint
    from skytrace.estimation.known import Known, KnownDistance, KnownPosition
    from skytrace.evaluation.summary import Evaluation
    from skytrace.geometry.rigid import Rigid, Similarity
    from skytrace.io.flight import Flight, read_flight
    from skytrace.io.georeference import read_georeference, write_georeference
    from skytrace.io.run_folder import RunFolder, read_run
    from skytrace.model.camera import Clock, Intrinsics
    from skytrace.model.georeference import Georeference
    from skytrace.model.reconstruction import CameraEstimate, Reconstruction
    from skytrace.model.track import Recording, Track
    from skytrace.model.trajectory import Segment, Trajectory
    from skytrace.pipeline.config import Config
    from skytrace.pipeline.export import ExportOptions, export_run
    from skytrace.pipeline.judging import evaluate
    from skytrace.simulation import Scenario, presets, simulate, write_flight

# Where each name lives; the imports above say the same to type checkers, and a test compares the two.
_HOMES = {
    "skytrace.api": ("Result", "reconstruct", "write_run"),
    "skytrace.errors": ("InputError", "ReconstructionError", "SkytraceError"),
    "skytrace.estimation.hints": ("Hints", "OffsetHint", "SimultaneousHint"),
    "skytrace.estimation.known": ("Known", "KnownDistance", "KnownPosition"),
    "skytrace.evaluation.summary": ("Evaluation",),
    "skytrace.geometry.rigid": ("Rigid", "Similarity"),
    "skytrace.io.flight": ("Flight", "read_flight"),
    "skytrace.io.georeference": ("read_georeference", "write_georeference"),
    "skytrace.io.run_folder": ("RunFolder", "read_run"),
    "skytrace.model.camera": ("Clock", "Intrinsics"),
    "skytrace.model.georeference": ("Georeference",),
    "skytrace.model.reconstruction": ("CameraEstimate", "Reconstruction"),
    "skytrace.model.track": ("Recording", "Track"),
    "skytrace.model.trajectory": ("Segment", "Trajectory"),
    "skytrace.pipeline.config": ("Config",),
    "skytrace.pipeline.export": ("ExportOptions", "export_run"),
    "skytrace.pipeline.judging": ("evaluate",),
    "skytrace.simulation": ("Scenario", "presets", "simulate", "write_flight"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "CameraEstimate",
    "Clock",
    "Config",
    "Evaluation",
    "ExportOptions",
    "Flight",
    "Georeference",
    "Hints",
    "InputError",
    "Intrinsics",
    "Known",
    "KnownDistance",
    "KnownPosition",
    "OffsetHint",
    "Reconstruction",
    "ReconstructionError",
    "Recording",
    "Result",
    "Rigid",
    "RunFolder",
    "Scenario",
    "Segment",
    "Similarity",
    "SimultaneousHint",
    "SkytraceError",
    "Track",
    "Trajectory",
    "evaluate",
    "export_run",
    "presets",
    "read_flight",
    "read_georeference",
    "read_run",
    "reconstruct",
    "simulate",
    "write_flight",
    "write_georeference",
    "write_run",
]


def __getattr__(name: str) -> Any:
    # The lazy attributes of PEP 562.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
