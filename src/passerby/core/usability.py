"""Whether what a rig measures is known well enough to use, and which cameras have no pose: two doubts with reasons.

A rig is used for points, positions on the ground and lengths. Each has one sigma, where people walked, and one limit. Why it
is large (few observations, uneven ground, noisy boxes) is a notice of the stage that finds it; here it becomes a part of the
doubt, and no doubt of its own.

Why a camera could not be registered is a notice of the stage that finds it. Here it becomes a part of the doubt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, SolverFigures
from passerby.findings.finding import Finding, doubt

Quantity = Literal["points", "ground", "scale", "world"]
"""`world`: scale and ground."""
CODE = "rig_uncertain"
USABLE_M = 0.25
"""A camera whose rays pass points by more than this, one sigma, is no calibration. Of what is accepted, 95 % are then within
half a metre. What other limits would do: docs/results/limits.md."""
LARGE_SHARE, SMALL_SHARE = 0.005, 0.05
"""In rigs so large that `USABLE_M` is less than the first share of their extent, that share counts; in rigs so small that it is
more than the second, that one."""
ON_GROUND = 0.4
"""The height of the ground at people's feet has to be known to this share of it, 0.1 m but in large rigs; what that is along
the ground goes by how flat a camera looks. In ordinary scenes (seeds 4711 to 4718) it is 0.04 m, most of it from the lower
edges of boxes."""
USABLE_SCALE = 0.15
"""Relative one sigma of all lengths: what is off by 30 %, two sigmas, is no metre. Adults alone leave 0.05, and 0.11 beside
a cue that contradicts them."""
EXPLAINS: Mapping[str, tuple[Quantity, ...]] = MappingProxyType({
    "adjustment_not_converged": ("points",),
    "lens_doubtful": ("points", "ground"),
    "boxes_coarse": ("scale",),
    "people_not_spread": ("points", "ground"),
    "ground_by_hips": ("ground",),
    "people_on_levels": ("ground",),
    "ground_uneven": ("ground",),
    "few_observations": ("points", "ground"),
    "boxes_noisy": ("points", "ground", "scale"),
})  # fmt: skip
"""Codes of notices, and what each makes uncertain; the most specific comes first."""
UNKNOWN = "people_not_spread", "boxes_noisy"
"""Codes of notices beside which the sigmas say too little. With people on one line they were 2 to 7 times too small (seeds 4711
to 4713); why is not known. Boxes off by 0.3 of their height bias the scale by 15 to 50 % and turn cameras by 1 to 5 degrees."""
WITHOUT_SIGMAS = ("adjustment_not_converged", "people_not_spread", "few_inliers", "near_reference", "pairs_disagree")
"""Codes of notices that make a rig too uncertain by a method that has no sigmas of what it measures."""
_WORLD: Mapping[str, Quantity] = MappingProxyType({"scale": "scale", "vertical": "ground", "height of the ground": "ground"})
MISSING = "camera_without_pose"
EXPLAINS_MISSING = (
    "start_unknown", "clock_unknown", "nobody_seen_whole", "few_walkers", "camera_unregistered", "cameras_share_nobody",
    "pair_failed", "cameras_disconnected",
)  # fmt: skip
"""Codes of notices that explain a missing camera; the most specific comes first."""


@dataclass(frozen=True)
class _Sigma:
    """What one camera, or the rig, measures too vaguely."""

    quantity: Quantity
    cameras: tuple[str, ...]
    size: float | None
    """Millimetres, or per cent of all lengths; None where nothing fixes it."""
    lacks: tuple[str, ...] = ()
    """Parts of the world that nothing fixes."""


def doubts_of_uncertainty(rig: Rig, figures: SolverFigures, findings: Sequence[Finding]) -> list[Finding]:
    """What is too uncertain to use, each with what explains it.

    Args:
        rig: in the world of the adjustment, metres.
        figures: of the solver.
        findings: notices that may explain it (`EXPLAINS`, `WITHOUT_SIGMAS`), among others.
    """
    if not isinstance(figures, AdjustedFigures):
        given = [one for one in findings if one.code in WITHOUT_SIGMAS]
        return [doubt(CODE, *one.cameras, what="points", sigma=None, lacks=[], why=one.as_value()) for one in given]
    if not rig.posed():
        return []
    causes = [one for code in EXPLAINS for one in findings if one.code == code]
    out = []
    unknown = [_Sigma("points", (), None)] if any(one.code in UNKNOWN for one in causes) else []
    for sigma in (*unknown, *_find_unbounded(rig, figures), *_find_vague_cameras(rig, figures), *_find_vague_scale(figures)):
        fitting = (one for one in causes if sigma.quantity in EXPLAINS[one.code])
        cause = next(
            (one for one in fitting if not one.cameras or not sigma.cameras or set(one.cameras) & set(sigma.cameras)), None
        )
        values = {"what": sigma.quantity, "sigma": sigma.size, "lacks": list(sigma.lacks)}
        out.append(doubt(CODE, *sigma.cameras, **values, why=None if cause is None else cause.as_value()))
    return out


def add_uncertainty_doubts(rig: Rig, figures: SolverFigures, findings: Sequence[Finding]) -> list[Finding]:
    """The findings with these doubts as the figures have them now; notices that a doubt names are not said twice."""
    others = [one for one in findings if one.code != CODE]
    doubts = doubts_of_uncertainty(rig, figures, others)
    said = [one.values["why"] for one in doubts]
    return [*(one for one in others if one.code not in (*EXPLAINS, *WITHOUT_SIGMAS) or one.as_value() not in said), *doubts]


def find_usable_m(rig: Rig) -> float:
    """What points have to be known to in a rig, one sigma, metres."""
    centres = np.array([camera.pose.centre for camera in rig if camera.pose is not None])
    extent = float(np.max(np.linalg.norm(centres - centres.mean(axis=0), axis=1))) + 1.0
    return min(SMALL_SHARE * extent, max(USABLE_M, LARGE_SHARE * extent))


def _find_unbounded(rig: Rig, figures: AdjustedFigures) -> list[_Sigma]:
    """What no evidence fixes, and everything where the adjustment ended before its optimum."""
    out = []
    if figures.rounds and not figures.rounds[-1].converged:
        out.append(_Sigma("points", (), None))
    free = figures.undetermined or ()
    lacks = tuple(one for one in free if one in _WORLD)
    if lacks:
        of = {_WORLD[one] for one in lacks}
        out.append(_Sigma("world" if len(of) > 1 else of.pop(), (), None, lacks))
    return [*out, *(_Sigma("points", (name,), None) for name in rig.names if f"camera {name}" in free)]


def _find_vague_cameras(rig: Rig, figures: AdjustedFigures) -> list[_Sigma]:
    """The cameras that measure points, or else positions on the ground, too vaguely."""
    most_mm, free = 1000 * find_usable_m(rig), figures.undetermined or ()
    on_ground_mm = ON_GROUND * max(most_mm, 1000 * USABLE_M)  # bodies are no smaller where a rig is
    grounded = not any(_WORLD.get(one) == "ground" for one in free)
    out = []
    for camera in figures.cameras:
        own = None if figures.measuring is None else figures.measuring.cameras.get(camera.name)
        beside = (camera.shape_position_sigma_mm or 0.0) if own is None else own.across.median_mm
        if f"camera {camera.name}" in free:
            continue
        if beside > most_mm:
            out.append(_Sigma("points", (camera.name,), beside))
        elif grounded and own is not None and own.ground is not None and (own.height_mm or 0.0) > on_ground_mm:
            out.append(_Sigma("ground", (camera.name,), own.ground.median_mm))
    return out


def _find_vague_scale(figures: AdjustedFigures) -> list[_Sigma]:
    sigma = figures.scale.relative_sigma
    return [] if sigma is None or sigma <= USABLE_SCALE else [_Sigma("scale", (), 100 * sigma)]


def doubt_missing_pose(cause: Finding, names: Sequence[str] | None = None) -> Finding:
    """The doubt about cameras that a cause leaves without a pose: these, or all that it is about."""
    return doubt(MISSING, *(cause.cameras if names is None else names), why=cause.as_value())


def add_missing_camera_doubts(rig: Rig, findings: Sequence[Finding]) -> list[Finding]:
    """The findings, first a doubt for each cause that leaves cameras without a pose, in place of what explains these cameras.

    Args:
        rig: at least one camera has a pose.
        findings: those that explain (`EXPLAINS_MISSING`) or earlier doubts of this kind, among others. Of several causes
            about a camera the most specific one is kept.
    """
    before = [Finding.of_value(one.values["why"]) for one in findings if one.code == MISSING and one.values["why"]]
    findings = [*before, *(one for one in findings if one.code != MISSING)]
    missing = [camera.name for camera in rig if camera.pose is None]
    left, doubts = missing, list[Finding]()
    for cause in (one for code in EXPLAINS_MISSING for one in findings if one.code == code):
        if names := [name for name in left if name in cause.cameras]:
            doubts.append(doubt_missing_pose(cause, names))
            left = [name for name in left if name not in names]
    doubts += [doubt(MISSING, name, why=None) for name in left]
    others = [one for one in findings if one.code not in EXPLAINS_MISSING or not set(missing) & set(one.cameras)]
    return [*doubts, *others]
