"""What became of the lenses that were refined: figures, notes, and doubts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Lens, Rig
from passerby.solver.lens_check import size_drift
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people_state import PeopleState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import LensPriors

Floats = NDArray[np.float64]

# A lens that moved by more than so many standard deviations of what is stated is not the stated one, or people do not fit.
_FAR_SIGMAS = 3.0
# People tell nothing of a lens whose sigma is still this share of the stated one.
_UNTOLD_SHARE = 0.8


def lens_priors(unknowns: LensUnknowns, stated: Rig, problem: PeopleProblem, state: PeopleState) -> LensPriors | None:
    """What is known of the lenses beside the sightings, and how far their errors mislead; None where none is refined.

    Sightings of joints fix a focal length by geometry alone; that of a camera with boxes alone follows how tall people seem
    near and far.
    """
    if not unknowns.parts:
        return None
    sd = unknowns.prior_sd(stated)
    drift = np.zeros_like(sd)
    by_boxes = np.bincount(problem.joints.camera, minlength=len(stated)) == 0
    drift[:, unknowns.columns_of("focal")] = (size_drift(problem, state) * by_boxes)[:, None]
    return LensPriors(sd, drift)


def lens_figures(unknowns: LensUnknowns, stated: Rig, refined: Rig, sigma: Floats | None) -> dict[str, dict[str, Any]]:
    """JSON-ready: by camera, each refined part as stated and as refined, with both sigmas; empty where nothing is refined.

    Args:
        unknowns: what was refined.
        stated: lenses as stated.
        refined: as refined, in the same order.
        sigma: (C, L) standard deviations of the unknowns.
    """
    if sigma is None:
        return {}
    prior = unknowns.prior_sd(stated)
    return {
        before.name: _parts(unknowns, before.lens, after.lens, sigma[c], prior[c])
        for c, (before, after) in enumerate(zip(stated, refined, strict=True))
    }


def _parts(unknowns: LensUnknowns, stated: Lens, refined: Lens, sigma: Floats, prior: Floats) -> dict[str, Any]:
    out: dict[str, Any] = {}
    if "focal" in unknowns.parts:
        column = unknowns.columns_of("focal").start
        out["focal"] = {
            "stated_px": stated.focal, "refined_px": refined.focal, "sigma_px": float(sigma[column] * refined.focal),
            "stated_sigma_px": float(prior[column] * stated.focal),
        }  # fmt: skip
    if "principal_point" in unknowns.parts:
        columns = unknowns.columns_of("principal_point")
        out["principal_point"] = {
            "stated_px": stated.matrix[:2, 2].tolist(), "refined_px": refined.matrix[:2, 2].tolist(),
            "sigma_px": sigma[columns].tolist(), "stated_sigma_px": prior[columns].tolist(),
        }  # fmt: skip
    return out


def lens_notes(figures: Mapping[str, Any]) -> list[str]:
    """What was refined in words, one sentence for each camera and part of its lens.

    Args:
        figures: of a solution; its `lenses` are those of `lens_figures`.
    """
    out = []
    for name, parts in figures.get("lenses", {}).items():
        if focal := parts.get("focal"):
            change, sigma = focal["refined_px"] / focal["stated_px"] - 1, focal["sigma_px"] / focal["refined_px"]
            out.append(
                f"camera {name}: focal length {focal['refined_px']:.0f} px instead of {focal['stated_px']:.0f} "
                f"({100 * change:+.1f} %, sigma {100 * sigma:.1f} %){_untold(focal['sigma_px'], focal['stated_sigma_px'])}"
            )
        if point := parts.get("principal_point"):
            (x, y), (u, v) = point["stated_px"], point["refined_px"]
            worst, prior = max(point["sigma_px"]), max(point["stated_sigma_px"])
            out.append(
                f"camera {name}: principal point ({u:.0f}, {v:.0f}) px instead of ({x:.0f}, {y:.0f}), sigma "
                f"{worst:.0f} px{_untold(worst, prior)}"
            )
    return out


def _untold(sigma: float, prior: float) -> str:
    return ": the people hardly tell it, it may as well be left out of [solver] refine" if sigma > _UNTOLD_SHARE * prior else ""


def far_lenses(figures: Mapping[str, Any]) -> list[str]:
    """The cameras whose lens ended farther from the stated one than stated lenses are off; `figures` as of `lens_figures`."""
    out = []
    for name, parts in figures.items():
        if focal := parts.get("focal"):
            change = np.log(focal["refined_px"] / focal["stated_px"])
            if abs(change) > _FAR_SIGMAS * focal["stated_sigma_px"] / focal["stated_px"]:
                out.append(
                    f"camera {name}: its focal length was refined by {100 * np.expm1(change):+.0f} %, farther than a stated "
                    "one should be off: check its intrinsics and the size of the picture that they were made for"
                )
        if point := parts.get("principal_point"):
            moved = np.subtract(point["refined_px"], point["stated_px"])
            if (np.abs(moved) > _FAR_SIGMAS * np.array(point["stated_sigma_px"])).any():
                out.append(
                    f"camera {name}: its principal point was refined by {np.linalg.norm(moved):.0f} px, farther than a stated "
                    "one should be off: check its intrinsics and whether its picture was cropped"
                )
    return out
