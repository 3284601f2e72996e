"""Stated lenses that people contradict: corrected where that is clear, and the rig estimated again; else a doubt.

The test is that of `hypotheses`; it runs on finished estimates only. A correction stands where the new estimate keeps all
cameras and predicts held-out people no worse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.calibration.estimation import Estimate
from passerby.calibration.readings import findings_of_readings
from passerby.calibration.repairs import Repaired
from passerby.core.figures import AdjustedFigures
from passerby.findings.finding import Finding
from passerby.hypotheses.alternatives import Alternative
from passerby.hypotheses.findings import lens_corrected, lens_differs, lens_doubtful
from passerby.hypotheses.lenses import FoundLenses, LensResult, examine_lenses
from passerby.scene.inputs import SceneInputs
from passerby.solver.people import PeopleSolution

MOST_CORRECTIONS = 3
"""Lenses that are corrected at most: where more are wrong, the rig is."""


@dataclass(frozen=True, eq=False)
class LensOutcome:
    """The estimate that stands, and what is reported of its lenses."""

    repaired: Repaired
    findings: tuple[Finding, ...]
    result: LensResult
    """Of the estimate that stands."""

    def of(self, severity: str) -> tuple[Finding, ...]:
        """The findings of one severity."""
        return tuple(finding for finding in self.findings if finding.severity == severity)


def correct_lenses(
    repaired: Repaired, again: Callable[[SceneInputs], Repaired], disagreement: Callable[[Estimate], float | None]
) -> LensOutcome:
    """Examine the lenses of an estimate; while one is clearly wrong, correct it and estimate again.

    Args:
        repaired: an estimate by the lenses as stated.
        again: estimates from other inputs.
        disagreement: by how much people who were held out disagree with an estimate; None where that is unknown.
    """
    made: list[FoundLenses] = []
    adopted: list[Alternative] = []
    while True:
        solution = repaired.estimate.solution
        if not isinstance(solution, PeopleSolution) or solution.verdict == "refused":
            return LensOutcome(repaired, (), LensResult("nothing"))
        misread = findings_of_readings(repaired.inputs, repaired.estimate)
        if any(one.severity != "notice" for one in misread):  # lenses would be blamed for what they did not do
            return LensOutcome(repaired, (*misread, *_corrections(made)), LensResult("nothing"))
        result = examine_lenses(solution, corrected=adopted)
        found = result.found
        if found is None or result.decision == "nothing":
            return LensOutcome(repaired, (*misread, *_corrections(made)), result)
        if result.decision != "correct" or len(made) == MOST_CORRECTIONS:
            one = lens_differs(found) if result.decision == "notice" else lens_doubtful(result)
            return LensOutcome(repaired, (one, *misread, *_corrections(made)), result)
        after = again(replace(repaired.inputs, rig=found.corrected(repaired.inputs.rig)))
        if is_worse(after.estimate, repaired.estimate, disagreement):
            return LensOutcome(repaired, (lens_doubtful(result, "not_better"), *misread, *_corrections(made)), result)
        repaired = replace(after, corrections=(*repaired.corrections, *after.corrections))
        made.append(found)
        adopted += [one.alternative for one in result.suspects]


def with_focal_changes(figures: AdjustedFigures, result: LensResult) -> AdjustedFigures:
    """The figures with where each stated focal length would go if it alone were wrong."""
    steps = {one.cameras[0]: one for one in result.screened if one.alternative.code == "focal" and not one.alternative.alike}
    cameras = tuple(
        replace(camera, focal_change=steps[camera.name].change, focal_change_sigma=steps[camera.name].sigma)
        if camera.name in steps
        else camera
        for camera in figures.cameras
    )
    return replace(figures, cameras=cameras)


def with_unsettled_lenses(figures: AdjustedFigures, result: LensResult) -> AdjustedFigures:
    """The figures with how differently the rig measures by the most likely of explanations that fit about as well."""
    found = result.found if result.decision == "unsettled" else None
    if found is None or found.moved is None or figures.measuring is None:
        return figures
    ground_mm = {name: one.median_mm for name, one in found.moved.cameras.items()}
    return replace(figures, measuring=figures.measuring.with_errors(found.moved.points.median_mm, ground_mm))


def _corrections(made: Sequence[FoundLenses]) -> tuple[Finding, ...]:
    """What is reported of corrections: each from the lens as the scene states it to what it became in the end."""
    if not made:
        return ()
    change = np.sum([one.change for one in made], axis=0)
    return tuple(lens_corrected(replace(one, stated=made[0].stated, change=change, sigma=made[-1].sigma)) for one in made)


def is_worse(after: Estimate, before: Estimate, disagreement: Callable[[Estimate], float | None]) -> bool:
    """Whether an estimate lost cameras, or disagrees more with people who were held out."""
    if after.solution.verdict == "refused" or after.solution.rig.posed().names != before.solution.rig.posed().names:
        return True
    new, old = disagreement(after), disagreement(before)
    return new is not None and old is not None and new > old
