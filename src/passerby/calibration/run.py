"""Data of one calibration: the scene and its options, an estimate, and corrections of the input."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

import numpy as np

from passerby.association.camera_tracklets import EarlierTracklets, earlier_tracklets
from passerby.association.initial_association import EarlierPairs, earlier_pairs
from passerby.association.result import Association
from passerby.calibration.kept_tracklets import KeptTracklets
from passerby.common.progress import Progress, silent
from passerby.core.solution import Solution
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.solver.geopose.geopose import GeoPoseOptions
from passerby.solver.people import PeopleOptions

SolverOptions = PeopleOptions | GeoPoseOptions


@dataclass(frozen=True, eq=False)
class EarlierAssociation:
    """Results of other estimates of a scene for single cameras and for pairs, used again if their input is the same."""

    tracklets: EarlierTracklets = field(default_factory=earlier_tracklets)
    pairs: EarlierPairs = field(default_factory=earlier_pairs)


@dataclass(frozen=True, eq=False)
class CalibrationRun:
    """The data that are the same for all estimates of one scene."""

    scene: Scene
    options: SolverOptions
    seed: int = 0
    progress: Progress = silent
    executor: Executor | None = None
    """Processes cameras, pairs of them and zones of large rigs in parallel; None: one after the other."""
    kept: KeptTracklets | None = None
    """Tracklets of earlier runs, to which those of this run are added; None: none are kept."""
    earlier: EarlierAssociation = field(default_factory=EarlierAssociation)

    def rng(self) -> np.random.Generator:
        """Return the random numbers of one estimate, from their beginning: no estimate depends on another one."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A rig, and the association that it was solved with."""

    solution: Solution
    association: Association


@dataclass(frozen=True, eq=False)
class Correction:
    """Inputs after the correction of a fault that an estimate showed. Subclasses, one for each kind of fault, describe it."""

    inputs: SceneInputs
    tentative: ClassVar[bool] = False
    """Whether it is dropped if the estimate after it is worse than that before."""

    def explains(self, after: Estimate, before: Estimate, person_height_m: float) -> bool:
        """Check whether the sign of this fault, present in the estimate before, is gone after."""
        return True


Kind = TypeVar("Kind", bound=Correction)


@dataclass(frozen=True, eq=False)
class Corrections:
    """The corrections of the input in the order in which they were made, and those that were dropped."""

    made: tuple[Correction, ...] = ()
    dropped: tuple[Correction, ...] = ()

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """Return the corrections of one kind that were made."""
        return tuple(one for one in self.made if isinstance(one, kind))

    def allows(self, kind: type[Correction], most: int) -> bool:
        """Check whether one more of a kind may be made: fewer than `most` were made, and none was dropped."""
        return len(self.of(kind)) < most and not any(isinstance(one, kind) for one in self.dropped)
