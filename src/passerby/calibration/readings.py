"""Cameras that show other things than their observations are taken for: late clocks are corrected, the rest is reported.

The test is that of `hypotheses.observations`. Images that are mirrored, turned or of another size are not corrected: a rig for
them would not be one for the images that there are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from passerby.calibration.diagnostics.verdict import people_not_spread
from passerby.calibration.run import Correction, Corrections, Estimate
from passerby.core.synchronisation import clocks_of
from passerby.findings.finding import Finding
from passerby.hypotheses.box_formats import find_shifted_boxes
from passerby.hypotheses.findings import boxes_in_other_format, misread
from passerby.hypotheses.observations import ReadCamera, examine_readings
from passerby.scene.inputs import SceneInputs
from passerby.solver.people import PeopleSolution

MOST_CORRECTIONS = 3
"""Clocks that are corrected at most: where more are wrong, nothing says which are right."""


@dataclass(frozen=True, eq=False)
class ClockCorrection(Correction):
    """Inputs with the clock of one camera as people fit it."""

    found: ReadCamera
    tentative: ClassVar[bool] = True


def correct_late_clock(inputs: SceneInputs, estimate: Estimate) -> ClockCorrection | None:
    """Correct the clock offset that the people of the other cameras contradict most; None where they contradict none."""
    found = _examined(inputs, estimate, only_clocks=True)
    one = next((one for one in found if one.decision == "correct"), None)
    if one is None or one.reading.late_s is None:
        return None
    seen = inputs.observations
    clocks = clocks_of(seen, inputs.rig.names)
    clocks[one.name] = replace(clocks[one.name], offset_s=clocks[one.name].offset_s - one.reading.late_s)
    return ClockCorrection(replace(inputs, observations=replace(seen, clocks=clocks)), one)


def findings_of_readings(inputs: SceneInputs, estimate: Estimate) -> tuple[Finding, ...]:
    """What is found of cameras whose observations another reading explains better, in an estimate that stands."""
    found = tuple(misread(one) for one in _examined(inputs, estimate))
    solution = estimate.solution
    shifted = find_shifted_boxes(solution) if isinstance(solution, PeopleSolution) else None
    return found if shifted is None else (*found, boxes_in_other_format(shifted))


def findings_of_corrected_clocks(corrections: Corrections) -> tuple[Finding, ...]:
    """A notice about each clock that was corrected."""
    return tuple(misread(one.found, corrected=True) for one in corrections.of(ClockCorrection))


def _examined(inputs: SceneInputs, estimate: Estimate, *, only_clocks: bool = False) -> list[ReadCamera]:
    seen = inputs.observations
    rig, instants = estimate.solution.rig, estimate.association.instants
    # From people on one line, an image and its mirror image are the same.
    if estimate.solution.verdict == "refused" or people_not_spread(rig, instants) is not None:
        return []
    known = bool(seen.clocks) or seen.fps is not None
    return examine_readings(estimate.solution, instants, clocks=known, only_clocks=only_clocks)
