"""The numbers of a lens that was estimated, one by one: each with its sigma, its prior, and what determined it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from passerby.core.lens_figures import FocalFigures, LensFigures, LensPrior

MOSTLY, WHOLLY = 0.5, 0.9
"""Shares of people in what is known of a number, from which it counts as determined by them for the most part, and wholly."""


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
