"""Correction of stated lenses that people contradict, if the evidence is clear, with a new estimate of the rig; else a doubt.

The test is that of `hypotheses`; it runs on finished estimates only. A correction is kept under three conditions: the new
estimate keeps all cameras, it predicts held-out people no worse, and people's ground is even before or after. A step in the
ground looks like a wrong principal point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from passerby.calibration.diagnostics.ground_planarity import shape_of
from passerby.calibration.run import Correction, Corrections, Estimate
from passerby.core.figures import AdjustedFigures
from passerby.findings.finding import Finding
from passerby.hypotheses.alternatives import Alternative
from passerby.hypotheses.findings import lens_corrected, lens_differs, lens_doubtful
from passerby.hypotheses.lenses import FoundLenses, LensResult, examine_lenses
from passerby.scene.inputs import SceneInputs
from passerby.solver.people import PeopleSolution

MOST_CORRECTIONS = 3
"""Largest number of corrections of lenses: if more seem wrong, the rig is wrong."""


@dataclass(frozen=True, eq=False)
class LensCorrection(Correction):
    """Inputs with a corrected lens."""

    found: FoundLenses
    suspects: tuple[Alternative, ...]
    """The explanations that the correction corrects."""
    tentative: ClassVar[bool] = True

    def explains(self, after: Estimate, before: Estimate, person_height_m: float) -> bool:
        """Check whether the ground is even with the new lens, or was even before."""
        return not all(_is_uneven(one, person_height_m) for one in (after, before))


@dataclass(frozen=True, eq=False)
class LensExamination:
    """Findings on the lenses of an estimate, and the test that they come from."""

    findings: tuple[Finding, ...] = ()
    result: LensResult = field(default_factory=lambda: LensResult("nothing"))

    def of(self, severity: str) -> tuple[Finding, ...]:
        """Return the findings of one severity."""
        return tuple(finding for finding in self.findings if finding.severity == severity)


def examine_stated_lenses(
    inputs: SceneInputs, estimate: Estimate, corrections: Corrections, person_height_m: float, misread: Sequence[Finding]
) -> tuple[LensCorrection | None, LensExamination]:
    """Test whether people contradict a lens; return a correction if this is clear, and the findings if there is none.

    Args:
        inputs: inputs of the estimate.
        estimate: the estimate, in which no other fault of the input is found.
        corrections: the corrections so far.
        person_height_m: typical standing height.
        misread: findings on cameras whose observations another reading explains better.
    """
    solution = estimate.solution
    if not isinstance(solution, PeopleSolution) or solution.verdict == "refused":
        return None, LensExamination()
    made = corrections.of(LensCorrection)
    known = (*misread, *_findings_of_corrections([one.found for one in made]))
    if any(one.severity != "notice" for one in misread):  # the misread observations would be taken for faults of lenses
        return None, LensExamination(known)
    result = examine_lenses(solution, corrected=[one for correction in made for one in correction.suspects])
    found = result.found
    if found is None or result.decision == "nothing":
        return None, LensExamination(known, result)
    if result.decision != "correct" or len(made) == MOST_CORRECTIONS:
        one = lens_differs(found) if result.decision == "notice" else lens_doubtful(result)
        return None, LensExamination((one, *known), result)
    if not corrections.allows(LensCorrection, MOST_CORRECTIONS):  # tried, and the estimate was worse
        if _is_uneven(estimate, person_height_m):  # the ground, which is reported, or the lens: sigmas include the difference
            return None, LensExamination(known, replace(result, decision="unsettled"))
        return None, LensExamination((lens_doubtful(result, "not_better"), *known), result)
    corrected = replace(inputs, rig=found.corrected(inputs.rig))
    suspects = tuple(one.alternative for one in result.suspects)
    return LensCorrection(corrected, found, suspects), LensExamination(known, result)


def _is_uneven(estimate: Estimate, person_height_m: float) -> bool:
    """Check whether the ground that people walk on differs from a plane, by this estimate."""
    shape = shape_of(estimate.solution, estimate.association.instants, person_height_m)
    return shape is not None and shape.sure


def with_focal_changes(figures: AdjustedFigures, result: LensResult) -> AdjustedFigures:
    """Add to the figures how much each stated focal length would change if it alone were wrong."""
    steps = {one.cameras[0]: one for one in result.screened if one.alternative.code == "focal" and not one.alternative.alike}
    cameras = tuple(
        replace(camera, focal_change=steps[camera.name].change, focal_change_sigma=steps[camera.name].sigma)
        if camera.name in steps
        else camera
        for camera in figures.cameras
    )
    return replace(figures, cameras=cameras)


def with_unsettled_lenses(figures: AdjustedFigures, result: LensResult) -> AdjustedFigures:
    """Add to the figures the change of the rig's measurements by the most likely of several equally good explanations."""
    found = result.found if result.decision == "unsettled" else None
    if found is None or found.moved is None or figures.measuring is None:
        return figures
    ground_mm = {name: one.median_mm for name, one in found.moved.cameras.items()}
    return replace(figures, measuring=figures.measuring.with_errors(found.moved.points.median_mm, ground_mm))


def _findings_of_corrections(made: Sequence[FoundLenses]) -> tuple[Finding, ...]:
    """Return the findings on corrections, with the total change from the lens that the scene states to the final one."""
    if not made:
        return ()
    change = np.sum([one.change for one in made], axis=0)
    return tuple(lens_corrected(replace(one, stated=made[0].stated, change=change, sigma=made[-1].sigma)) for one in made)
