"""Figures of lenses in `calibration.json`: estimated parameters, their sigmas and priors, fields of view."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from passerby.common.arrays import ABSENT, Floats
from passerby.core.cameras import Lens

RefinedPart = Literal["focal", "principal_point", "distortion"]
LensPrior = Literal["stated", "search", "assumed"]
"""Origin of the prior of a part of a lens: `stated`, a value of the scene or of the intrinsics; `search`, a first estimate from
how the same people fit together in several cameras; `assumed`, the usual value of lenses."""
MOSTLY, WHOLLY = 0.5, 0.9
"""Shares of people in the information on a number, from which on people determine it for the most part, or completely."""
SIDE_SAMPLES = 8
"""Samples on each side of a picture: lenses bend its border."""
FLATTEST = 0.5
"""Cosine of the angle from the axis: up to this angle a frustum ends in a plane, and beyond it (60 degrees) at one distance,
because the plane of a fisheye lens is at infinity."""


@dataclass(frozen=True, kw_only=True)
class FocalFigures:
    """A focal length that was refined, pixels."""

    stated_px: float
    """The value of the prior."""
    refined_px: float
    sigma_px: float
    people_sigma_px: float | None
    """One sigma from people alone."""
    far: bool
    """Whether it is farther from the stated value than stated values usually are."""
    told: bool
    """Whether people determine it."""
    prior_sigma_px: float | None = field(default=None, metadata=ABSENT)
    """One sigma of the prior in the adjustment; None in files of an older Passerby, as are the fields below."""
    prior: LensPrior | None = field(default=None, metadata=ABSENT)
    people_share: float | None = field(default=None, metadata=ABSENT)
    """Share of the information that comes from people and not from the prior, 0 to 1; a search counts as people."""
    scene_px: float | None = field(default=None, metadata=ABSENT)
    """Value that the scene states, and its sigma; None where it states none."""
    scene_sigma_px: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class PrincipalPointFigures:
    """A refined principal point; fields as in `FocalFigures`, for x and y."""

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
    """The first distortion coefficient of a lens that was never calibrated; fields as in `FocalFigures`."""

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
    """Cameras of one group have one focal length and distortion; None where no other camera shares them."""


@dataclass(frozen=True, kw_only=True)
class LensRefinement:
    """Result of the refinement of stated lenses."""

    asked: tuple[RefinedPart, ...]
    """The parts that were to be refined."""
    kept: tuple[RefinedPart, ...] = ()
    """The parts that were refined; a refinement that is dropped leaves the rig as solved with the stated values."""
    why: Literal["diverged", "implausible", "prediction"] | None = None
    """Reason why the refinement was dropped: the adjustment did not converge, a lens left the range of wrong stated ones, or
    people who were held out were not predicted better. None where it is kept."""
    gain: float | None = None
    """Gain over the stated lenses in the prediction of held-out people, nats; None where that was not compared."""
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
    """Origin of the prior; None in files of an older Passerby, as are the others below."""
    prior_value: float | None
    """None where no value was known before people were seen."""
    prior_sigma: float | None
    people_sigma: float | None
    """One sigma from people alone, without the prior; None where they give no information, or where there was no prior."""
    people_share: float | None
    """Share of the information that comes from people, 0 to 1."""

    @property
    def determined_by(self) -> str | None:
        """The source that determined it, in words; None where the file does not have it."""
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
    """Return the numbers of a lens that were estimated: focal length, principal point across and down, distortion."""
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
    """Return names as `focal length, principal point, k1`; empty for none. The two of the principal point give one name."""
    names = [one.name.removeprefix("distortion ") for one in parameters]
    x, y = "principal point x", "principal point y"
    if {x, y} <= set(names):
        names.remove(y)
        names[names.index(x)] = "principal point"
    return ", ".join(names)


def _focal(focal: FocalFigures) -> LensParameter:
    """Return the parameter of the focal length. A search is no prior of its own: the prior is then the scene's value."""
    searched = focal.prior == "search"
    value, sd = (focal.scene_px, focal.scene_sigma_px) if searched else (focal.stated_px, focal.prior_sigma_px)
    alone = None if searched and value is None else focal.people_sigma_px
    return LensParameter(
        "focal length", "px", focal.refined_px, focal.sigma_px, focal.prior, value, sd, alone, focal.people_share
    )


def field_of_view_deg(lens: Lens) -> tuple[float | None, float | None]:
    """Return the horizontal and vertical field of view, degrees: between rays through the middles of opposite image borders.

    None where the lens model has no ray there: its distortion folds back before the border.
    """
    (width, height), middle = lens.size, (np.array(lens.size) - 1) / 2
    ends = np.array([(-0.5, middle[1]), (width - 0.5, middle[1]), (middle[0], -0.5), (middle[0], height - 0.5)])
    left, right, top, bottom = lens.bearings(ends)
    return _measure_angle(left[[0, 2]], right[[0, 2]]), _measure_angle(top[1:], bottom[1:])


def _measure_angle(one: Floats, other: Floats) -> float | None:
    """Return the angle between rays (2,), each across and along the optical axis, in degrees; None where a ray is missing."""
    angles = np.degrees(np.arctan2([one[0], other[0]], [one[1], other[1]]))
    return float(angles[1] - angles[0]) if np.isfinite(angles).all() else None


def border_rays(lens: Lens, samples: int = SIDE_SAMPLES) -> Floats:
    """Return unit rays (4 K, 3) of the picture's border, camera frame, K per side, clockwise from the first pixel's corner.

    Where the lens model cannot be inverted, as in the black corners of a fisheye's picture, the ray is that of the nearest
    point to the border where it can; NaN where there is none.
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
    """Return the border (4 K, 3) of the picture held in front of the camera, camera frame, metres.

    It is flat at `depth`; that of wider lenses is bent back. Rows as in `border_rays`.
    """
    rays = border_rays(lens, samples)
    return np.asarray(depth * rays / np.maximum(rays[:, 2:], FLATTEST))
