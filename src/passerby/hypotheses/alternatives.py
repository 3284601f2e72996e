"""List of the lens errors that Passerby can suspect: each alternative frees something that the adjustment assumes.

An alternative widens a prior of the base model, in which every stated lens is already free within `LENS_PRIORS`. Prior odds
hold for a whole site and are divided among its cameras, so that a sound site of 1,000 cameras is accepted as often as a room
of four.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.solver.lens_unknowns import LENS_PARTS, LensPart, LensUnknowns
from passerby.solver.person_model import PeopleProblem
from passerby.solver.systematic import stated_sd

LENS = LensUnknowns(LENS_PARTS)
WRONG: Mapping[LensPart, float] = MappingProxyType({"focal": 0.2, "principal_point": 0.08, "distortion": 0.1})
"""One standard deviation of the error of a wrongly stated lens: of the focal length, relative; of the principal point, as a
share of the image's width; of the first distortion coefficient. The causes are zooms that were moved, images that were cropped
and lens models that were left out."""
WRONG_SITES: Mapping[LensPart, float] = MappingProxyType({"focal": 0.05, "principal_point": 0.05, "distortion": 0.02})
"""Share of sites in which one camera's lens is wrong in this respect."""
ALL_WRONG = 0.01
"""Share of sites in which the focal lengths of all cameras are wrong by one factor, as for another image size. Also the share
of sites in which all distortions are wrong alike: left out, or of images that were already undistorted."""


@dataclass(frozen=True)
class Alternative:
    """A hypothesis that some stated lens parameters are wrong."""

    code: str
    cameras: tuple[int, ...]
    """Indices of the cameras."""
    parameters: tuple[LensPart, ...]
    """The parts of the lens that become free."""
    log_prior: float
    """Logarithm of its prior odds against the inputs as stated."""
    alike: bool = False
    """Whether the cameras are wrong by the same factor instead of each by its own."""
    correctable: bool = True

    @property
    def columns(self) -> Ints:
        """Indices of the unknowns of a lens that become free."""
        return np.concatenate([np.arange(LENS.size)[LENS.columns_of(part)] for part in self.parameters])

    def apply(self, problem: PeopleProblem, rig: Rig) -> PeopleProblem:
        """Return the base problem with the suspected parameters free.

        Args:
            problem: the base problem (`case.Case`).
            rig: the lenses as stated.
        """
        wrong = prior_scales(rig, WRONG)
        assert problem.lens_core is not None
        columns = self.columns
        if self.alike:
            common = np.zeros(LENS.size) if problem.lens_common is None else problem.lens_common.copy()
            common[columns] = wrong[0, columns]
            return replace(problem, lens_common=common)
        core = problem.lens_core.copy()
        at = np.ix_(np.array(self.cameras), columns)
        core[at] = np.maximum(core[at], wrong[at])
        return replace(problem, lens_core=core)

    def with_parts_of(self, other: Alternative) -> Alternative:
        """Return the alternative in which the parts of both are free, for the same cameras."""
        parts = tuple(part for part in LENS_PARTS if part in (*self.parameters, *other.parameters))
        return replace(self, code="lens", parameters=parts, log_prior=max(self.log_prior, other.log_prior))


def lens_alternatives(rig: Rig) -> list[Alternative]:
    """Return the alternatives: each part of each camera's lens, and a common error of all focal lengths or all distortions."""
    n = len(rig)
    single = [
        Alternative(part, (c,), (part,), float(np.log(WRONG_SITES[part] / n))) for part in LENS_PARTS for c in range(n)
    ]  # fmt: skip
    parts: tuple[LensPart, ...] = ("focal", "distortion")
    alike = [Alternative(part, tuple(range(n)), (part,), float(np.log(ALL_WRONG)), alike=True) for part in parts]
    return [*single, *alike]


def prior_scales(rig: Rig, of: Mapping[LensPart, float]) -> Floats:
    """Return the standard deviations (C, L) of the lenses' unknowns: pixels for the principal point."""
    out = np.zeros((len(rig), LENS.size))
    width = np.array([camera.lens.size[0] for camera in rig], dtype=np.float64)
    out[:, LENS.columns_of("focal")] = of["focal"]
    out[:, LENS.columns_of("principal_point")] = of["principal_point"] * width[:, None]
    out[:, LENS.columns_of("distortion")] = of["distortion"]
    return out


def stated_scales(rig: Rig) -> Floats:
    """Return the standard deviations (C, L) of the unknowns of the stated lenses."""
    return np.concatenate([prior_scales(Rig((camera,)), stated_sd(camera.lens)) for camera in rig])
