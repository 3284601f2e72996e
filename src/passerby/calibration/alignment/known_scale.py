"""Known places as a scale cue: if `[world]` enlarges a rig, its people become taller, faster and wider."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.calibration.alignment.scene_world import AlignedSolution
from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, CueFigures
from passerby.core.solution import Solution, decide_verdict
from passerby.solver.cue_agreement import CODE, check_cue_consistency


def check_known_scale(solution: Solution, aligned: AlignedSolution) -> tuple[Solution, AlignedSolution]:
    """Add the scale of the known places to the scale cues of both, and find the contradictions between all cues.

    Both stay unchanged if `[world]` sets no scale, or if its plan is already a cue of the adjustment.
    """
    figures, placed = solution.figures, aligned.figures
    if not isinstance(figures, AdjustedFigures) or not isinstance(placed, AdjustedFigures):
        return solution, aligned
    known = _known_places(solution.rig, aligned)
    if known is None or any(cue.kind == "plan" for cue in figures.scale.cues):
        return solution, aligned
    cues, contradictions = check_cue_consistency((*figures.scale.cues, known))
    scale = replace(figures.scale, cues=tuple(cues))
    findings = (*(one for one in solution.findings if one.code != CODE), *contradictions)
    verdict = decide_verdict(solution.rig, findings)
    solution = replace(solution, figures=replace(figures, scale=scale), findings=findings, verdict=verdict)
    return solution, replace(aligned, figures=replace(placed, scale=scale))


def _known_places(rig: Rig, aligned: AlignedSolution) -> CueFigures | None:
    """Return the cue of the known places; its lengths are the size of the rig in their world and before."""
    if not aligned.world.get("scale_fitted"):
        return None
    factor, sigma = float(aligned.world["scale"]), float(aligned.world["scale_sigma"])
    centres = np.array([camera.centre for camera in rig.posed()])
    size = float(np.linalg.norm(centres - centres.mean(axis=0)))
    sd = factor * size * sigma
    return CueFigures(
        cue=str(aligned.world["by"]), kind="world", stated_m=factor * size, measured_m=size, sd_m=sd,
        residual_sigmas=(1 - factor) * size / sd, share=0.0, own_scale=factor, own_sigma=sigma,
    )  # fmt: skip
