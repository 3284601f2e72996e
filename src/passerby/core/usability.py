"""Doubts about a rig whose measurements are too uncertain to use, and about cameras without a pose, each with a reason.

A rig is used for points, positions on the ground and lengths. Each has one sigma, at the places where people walked, and one
limit. The reason for a large sigma (few observations, uneven ground, noisy boxes) is a notice of the stage that finds it. Here
this notice becomes a part of the doubt, and is no doubt of its own.

The reason why a camera could not be registered is also a notice of the stage that finds it, and becomes a part of the doubt.
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
"""`world` is scale and ground together."""
CODE = "rig_uncertain"
USABLE_M = 0.25
"""Largest usable sigma, metres: a camera whose rays pass points by more than this is not calibrated. Of the accepted cameras,
95 % are then within half a metre. The effect of other limits is in docs/results/limits.md."""
LARGE_SHARE, SMALL_SHARE = 0.005, 0.05
"""Limits as shares of a rig's extent. Where `USABLE_M` is less than the first share, as in large rigs, the first share is the
limit. Where it is more than the second, as in small rigs, the second share is."""
ON_GROUND = 0.4
"""Largest sigma of the height of the ground at people's feet, as a share of the limit for points: 0.1 m except in large rigs.
The resulting error along the ground depends on how flat a camera looks. In ordinary scenes (seeds 4711 to 4718) this sigma is
0.04 m, most of it from the lower edges of boxes."""
USABLE_SCALE = 0.15
"""Largest relative sigma of all lengths: lengths that are off by 30 %, two sigmas, are not metric. With adults as the only cue
the sigma is 0.05, and 0.11 beside a cue that contradicts them."""
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
"""Codes of notices, and the quantities that each makes uncertain; the most specific comes first."""
UNKNOWN = "people_not_spread", "boxes_noisy"
"""Codes of notices beside which the sigmas are too small. With people on one line they were 2 to 7 times too small (seeds 4711
to 4713); the reason is not known. Boxes off by 0.3 of their height bias the scale by 15 to 50 % and turn cameras by 1 to 5
degrees."""
WITHOUT_SIGMAS = ("adjustment_not_converged", "people_not_spread", "few_inliers", "near_reference", "pairs_disagree")
"""Codes of notices that make a rig too uncertain where the method computes no sigmas of its measurements."""
_WORLD: Mapping[str, Quantity] = MappingProxyType({"scale": "scale", "vertical": "ground", "height of the ground": "ground"})
MISSING = "camera_without_pose"
EXPLAINS_MISSING = (
    "start_unknown", "clock_unknown", "nobody_seen_whole", "few_walkers", "camera_unregistered", "cameras_share_nobody",
    "pair_failed", "cameras_disconnected",
)  # fmt: skip
"""Codes of notices that explain a missing camera; the most specific comes first."""


@dataclass(frozen=True)
class _Sigma:
    """A quantity that one camera, or the rig, measures with too large a sigma."""

    quantity: Quantity
    cameras: tuple[str, ...]
    size: float | None
    """Millimetres, or per cent of all lengths; None where no evidence determines the quantity."""
    lacks: tuple[str, ...] = ()
    """Parts of the world that no evidence determines."""


def doubts_of_uncertainty(rig: Rig, figures: SolverFigures, findings: Sequence[Finding]) -> list[Finding]:
    """Return a doubt for each quantity that is too uncertain to use, with the notice that explains it.

    Args:
        rig: in the world of the adjustment, metres.
        figures: figures of the solver.
        findings: notices that may explain a doubt (`EXPLAINS`, `WITHOUT_SIGMAS`), among other findings.
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
    """Return the findings with these doubts computed from the figures, and without the notices that a doubt contains."""
    others = [one for one in findings if one.code != CODE]
    doubts = doubts_of_uncertainty(rig, figures, others)
    said = [one.values["why"] for one in doubts]
    return [*(one for one in others if one.code not in (*EXPLAINS, *WITHOUT_SIGMAS) or one.as_value() not in said), *doubts]


def find_usable_m(rig: Rig) -> float:
    """Return the largest usable sigma of points in a rig, metres."""
    centres = np.array([camera.pose.centre for camera in rig if camera.pose is not None])
    extent = float(np.max(np.linalg.norm(centres - centres.mean(axis=0), axis=1))) + 1.0
    return min(SMALL_SHARE * extent, max(USABLE_M, LARGE_SHARE * extent))


def _find_unbounded(rig: Rig, figures: AdjustedFigures) -> list[_Sigma]:
    """Find the quantities that no evidence determines, and all points where the adjustment ended before its optimum."""
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
    """Find the cameras that measure points, or else positions on the ground, with too large a sigma."""
    most_mm, free = 1000 * find_usable_m(rig), figures.undetermined or ()
    on_ground_mm = ON_GROUND * max(most_mm, 1000 * USABLE_M)  # no less in a small rig, as bodies are not smaller there
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
    """Return the doubt about cameras that a cause leaves without a pose: the cameras `names`; None: all that it is about."""
    return doubt(MISSING, *(cause.cameras if names is None else names), why=cause.as_value())


def add_missing_camera_doubts(rig: Rig, findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings, first a doubt for each cause of missing poses, in place of the findings that explain these.

    Args:
        rig: the solved rig; at least one camera has a pose.
        findings: among others, those that explain a missing pose (`EXPLAINS_MISSING`), and earlier doubts of this kind. Of
            several causes about a camera the most specific one is kept.
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
