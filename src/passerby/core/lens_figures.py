"""Figures of refined lenses, as `calibration.json` has them under `figures`; see `passerby.core.figures`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from passerby.common.arrays import ABSENT

RefinedPart = Literal["focal", "principal_point", "distortion"]
LensPrior = Literal["stated", "search", "assumed"]
"""What was known of a part of a lens before the adjustment: a value of the scene or of the intrinsics; a first estimate, from
how the same people fit together in several cameras; or what lenses usually are."""


@dataclass(frozen=True, kw_only=True)
class FocalFigures:
    """A focal length that was refined, pixels."""

    stated_px: float
    """The value of the prior."""
    refined_px: float
    sigma_px: float
    people_sigma_px: float | None
    """By people alone."""
    far: bool
    """Farther from the stated one than stated ones are off."""
    told: bool
    """Whether people know it."""
    prior_sigma_px: float | None = field(default=None, metadata=ABSENT)
    """Of the prior, as the adjustment took it; None in files of an older Passerby, as are the others below."""
    prior: LensPrior | None = field(default=None, metadata=ABSENT)
    people_share: float | None = field(default=None, metadata=ABSENT)
    """How much of what is known comes from people rather than from the prior, 0 to 1; a search counts as people."""
    scene_px: float | None = field(default=None, metadata=ABSENT)
    """What the scene states, with its sigma; None where it states nothing."""
    scene_sigma_px: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class PrincipalPointFigures:
    """As `FocalFigures`, of x and y."""

    stated_px: tuple[float, float]
    refined_px: tuple[float, float]
    sigma_px: tuple[float, float]
    people_sigma_px: tuple[float | None, float | None]
    far: bool
    told: bool
    prior_sigma_px: tuple[float, float] | None = field(default=None, metadata=ABSENT)
    prior: LensPrior | None = field(default=None, metadata=ABSENT)
    people_share: tuple[float, float] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DistortionFigures:
    """As `FocalFigures`, of the first distortion coefficient of a lens that was never calibrated."""

    refined: float
    sigma: float
    stated: float | None = field(default=None, metadata=ABSENT)
    prior_sigma: float | None = field(default=None, metadata=ABSENT)
    people_sigma: float | None = field(default=None, metadata=ABSENT)
    prior: LensPrior | None = field(default=None, metadata=ABSENT)
    people_share: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class LensFigures:
    """The parts of a camera's lens that were refined."""

    focal: FocalFigures | None = field(default=None, metadata=ABSENT)
    principal_point: PrincipalPointFigures | None = field(default=None, metadata=ABSENT)
    distortion: DistortionFigures | None = field(default=None, metadata=ABSENT)
    group: str | None = field(default=None, metadata=ABSENT)
    """Cameras of one group have one focal length and distortion; None where no other camera is like it."""


@dataclass(frozen=True, kw_only=True)
class LensRefinement:
    """What became of stated lenses that were to be refined."""

    asked: tuple[RefinedPart, ...]
    """The parts that were to be refined,"""
    kept: tuple[RefinedPart, ...] = ()
    """and those that are; a refinement that is dropped leaves the rig as solved with the stated values."""
    why: Literal["diverged", "implausible", "prediction"] | None = None
    """Why what was asked for was dropped: the adjustment did not converge, a lens left the range of wrong stated ones, or
    people who were held out were not predicted better. None where it is kept."""
    gain: float | None = None
    """Over the stated lenses, in the prediction of people held out, nats; None where that was not compared."""
    gain_sigma: float | None = None
    """Standard error of `gain`."""
