"""The one configuration: every stage's settings in one frozen tree, unpacked where a stage begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from skytrace.estimation.adjust.settings import AdjustSettings, Freedom
from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.clock_wander import WanderSettings
from skytrace.estimation.coverage import CoverageSettings
from skytrace.estimation.finish import FinishSettings
from skytrace.estimation.grow import GrowSettings
from skytrace.estimation.initialize import InitialSettings
from skytrace.estimation.register import RegisterSettings
from skytrace.estimation.structure import StructureSettings
from skytrace.estimation.synchronize import SyncSettings


@dataclass(frozen=True, slots=True)
class Config:
    """Defaults serve every recording; none is tuned to one."""

    seed: int = 0
    clean: CleanSettings = field(default_factory=CleanSettings)
    synchronise: SyncSettings = field(default_factory=SyncSettings)
    initialise: InitialSettings = field(default_factory=InitialSettings)
    structure: StructureSettings = field(default_factory=StructureSettings)
    register: RegisterSettings = field(default_factory=RegisterSettings)
    grow: GrowSettings = field(default_factory=GrowSettings)
    adjust: AdjustSettings = field(default_factory=AdjustSettings)
    freedom: Freedom = field(default_factory=Freedom)
    start_attempts: int = 3  # initial pairs to grow from until all cameras are in
    passes: int = 2  # final adjustments, each but the first on a trajectory triangulated anew
    doubt_lenses: bool = True  # take radial distortions that the flight contradicts from the flight
    finish: FinishSettings = field(default_factory=FinishSettings)
    wander: WanderSettings = field(default_factory=WanderSettings)
    coverage: CoverageSettings = field(default_factory=CoverageSettings)

    def as_dict(self) -> Mapping[str, Any]:
        """Plain nested values, for config.toml."""
        return asdict(self)
