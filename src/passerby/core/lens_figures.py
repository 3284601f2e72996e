"""Figures of lenses, as `calibration.json` has them: estimated parameters, their sigmas and priors, fields of view."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from passerby.common.arrays import ABSENT, Floats
from passerby.core.cameras import Lens

RefinedPart = Literal["focal", "principal_point", "distortion"]
LensPrior = Literal["stated", "search", "assumed"]
"""What was known of a part of a lens before the adjustment: a value of the scene or of the intrinsics; a first estimate, from
how the same people fit together in several cameras; or what lenses usually are."""
MOSTLY, WHOLLY = 0.5, 0.9
"""Shares of people in what is known of a number, from which it counts as determined by them for the most part, and wholly."""
SIDE_SAMPLES = 8
"""Of each side of a picture: lenses bend its border."""
FLATTEST = 0.5
"""Cosine from the axis up to which a frustum ends in a plane, and beyond which (60 degrees) at one distance: the plane of a
fisheye lens lies at infinity."""


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


@dataclass(frozen=True)
class LensParameter:
    """One number of a lens that was estimated."""

    name: str
    """focal length, principal point x, principal point y, or distortion k1."""
    unit: str
    """px, or empty."""
    estimate: float
    sigma: float
    prior: LensPrior | None
    """Where the prior came from; None in files of an older Passerby, as are the others below."""
    prior_value: float | None
    """None where nothing was known before people were seen."""
    prior_sigma: float | None
    people_sigma: float | None
    """By people alone, beside a prior; None where they say nothing, or nothing else was known."""
    people_share: float | None
    """How much of what is known comes from people, 0 to 1."""

    @property
    def determined_by(self) -> str | None:
        """What determined it, in words; None where that was not written."""
        share, otherwise = (
            self.people_share,
            "stated" if self.prior_value is not None and self.prior != "assumed" else "assumed",
        )
        if share is None or self.prior is None:
            return None
        if share >= MOSTLY:
            return "people" if share >= WHOLLY else "largely people"
        return f"largely {otherwise}" if share >= 1 - WHOLLY else otherwise

    @property
    def by_prior(self) -> bool:
        """Whether it depends on its prior more than on people."""
        return self.people_share is not None and self.people_share < MOSTLY


def lens_parameters(parts: LensFigures) -> tuple[LensParameter, ...]:
    """The numbers of a lens that were estimated: focal length, principal point across and down, distortion."""
    out = [] if parts.focal is None else [_focal(parts.focal)]
    if (point := parts.principal_point) is not None:
        for k, axis in enumerate("xy"):
            sd, share = point.prior_sigma_px, point.people_share
            out.append(
                LensParameter(
                    f"principal point {axis}", "px", point.refined_px[k], point.sigma_px[k], point.prior, point.stated_px[k],
                    None if sd is None else sd[k], point.people_sigma_px[k], None if share is None else share[k],
                )
            )  # fmt: skip
    if (bent := parts.distortion) is not None:
        out.append(
            LensParameter(
                "distortion k1", "", bent.refined, bent.sigma, bent.prior, bent.stated, bent.prior_sigma, bent.people_sigma,
                bent.people_share,
            )
        )  # fmt: skip
    return tuple(out)


def names_in_words(parameters: Iterable[LensParameter]) -> str:
    """`focal length, principal point, k1`; empty for none. The two of the principal point are one where both are there."""
    names = [one.name.removeprefix("distortion ") for one in parameters]
    x, y = "principal point x", "principal point y"
    if {x, y} <= set(names):
        names.remove(y)
        names[names.index(x)] = "principal point"
    return ", ".join(names)


def _focal(focal: FocalFigures) -> LensParameter:
    """The focal length; a search is no prior of its own, so what the scene states stands beside people."""
    searched = focal.prior == "search"
    value, sd = (focal.scene_px, focal.scene_sigma_px) if searched else (focal.stated_px, focal.prior_sigma_px)
    alone = None if searched and value is None else focal.people_sigma_px
    return LensParameter(
        "focal length", "px", focal.refined_px, focal.sigma_px, focal.prior, value, sd, alone, focal.people_share
    )


def field_of_view_deg(lens: Lens) -> tuple[float | None, float | None]:
    """Horizontal and vertical field of view, degrees: between the rays through the middles of opposite borders of the image.

    None where the lens model has no ray there: its distortion turns over before the border.
    """
    (width, height), middle = lens.size, (np.array(lens.size) - 1) / 2
    ends = np.array([(-0.5, middle[1]), (width - 0.5, middle[1]), (middle[0], -0.5), (middle[0], height - 0.5)])
    left, right, top, bottom = lens.bearings(ends)
    return _measure_angle(left[[0, 2]], right[[0, 2]]), _measure_angle(top[1:], bottom[1:])


def _measure_angle(one: Floats, other: Floats) -> float | None:
    """The angle between rays (2,) across and along the optical axis, over that axis, degrees; None where a ray is missing."""
    angles = np.degrees(np.arctan2([one[0], other[0]], [one[1], other[1]]))
    return float(angles[1] - angles[0]) if np.isfinite(angles).all() else None


def border_rays(lens: Lens, samples: int = SIDE_SAMPLES) -> Floats:
    """(4 K, 3) unit rays of the picture's border, camera frame, clockwise from the first pixel's corner, K to a side.

    Where the lens model cannot be inverted, as in the black corners of a fisheye's picture, the ray of the point nearest to the
    border that can; NaN where there is none.
    """
    width, height = lens.size
    share = np.arange(samples) / samples
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    on_border = np.concatenate(
        [a + share[:, None] * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    middle = np.clip((lens.matrix[:2, 2] + 0.5) / (width, height), 0.05, 0.95)
    rays = np.full((len(on_border), 3), np.nan)
    for inward in np.linspace(1.0, 0.05, 39):
        rows = np.flatnonzero(np.isnan(rays[:, 0]))
        if not len(rows):
            break
        # The picture reaches half a pixel beyond the centres of its outermost pixels.
        rays[rows] = lens.bearings((middle + inward * (on_border[rows] - middle)) * (width, height) - 0.5)
    return rays


def frustum_rim(lens: Lens, depth: float, samples: int = SIDE_SAMPLES) -> Floats:
    """(4 K, 3) the border of the picture held before the camera, camera frame, metres: flat, `depth` in front; wider lenses'
    bent back. Rows as of `border_rays`.
    """
    rays = border_rays(lens, samples)
    return np.asarray(depth * rays / np.maximum(rays[:, 2:], FLATTEST))
