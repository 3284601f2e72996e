"""Cameras whose observations were misread, for example with a late clock: late clocks are corrected, other faults are reported.

The test is that of `hypotheses.observations`. Images that are mirrored, turned or of another size are not corrected: a rig for
the corrected images would not fit the images that the user has.
"""

from __future__ import annotations

from collections.abc import Sequence
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
"""Largest number of clocks that are corrected: if more are wrong, there is no evidence which ones are right."""


@dataclass(frozen=True, eq=False)
class ClockCorrection(Correction):
    """Inputs with the clock of one camera corrected by people."""

    found: ReadCamera
    tentative: ClassVar[bool] = True


def read_cameras(inputs: SceneInputs, estimate: Estimate) -> list[ReadCamera]:
    """Find the cameras whose observations another reading explains better.

    The list is empty if people walk on one line: there an image and its mirror image are the same.
    """
    seen = inputs.observations
    rig, instants = estimate.solution.rig, estimate.association.instants
    if estimate.solution.verdict == "refused" or people_not_spread(rig, instants) is not None:
        return []
    return examine_readings(estimate.solution, instants, clocks=bool(seen.clocks) or seen.fps is not None)


def correct_late_clock(inputs: SceneInputs, read: Sequence[ReadCamera]) -> ClockCorrection | None:
    """Correct the clock offset that the people of the other cameras contradict most; None if they contradict none.

    Args:
        inputs: inputs of the estimate.
        read: result of `read_cameras`.
    """
    one = next((one for one in read if one.decision == "correct"), None)
    if one is None or one.reading.late_s is None:
        return None
    seen = inputs.observations
    clocks = clocks_of(seen, inputs.rig.names)
    clocks[one.name] = replace(clocks[one.name], offset_s=clocks[one.name].offset_s - one.reading.late_s)
    return ClockCorrection(replace(inputs, observations=replace(seen, clocks=clocks)), one)


def findings_of_readings(estimate: Estimate, read: Sequence[ReadCamera]) -> tuple[Finding, ...]:
    """Return the findings on cameras whose observations another reading explains better, in a final estimate.

    Args:
        estimate: the estimate, in which no other fault of the input is found.
        read: result of `read_cameras`.
    """
    found, solution = tuple(misread(one) for one in read), estimate.solution
    if not isinstance(solution, PeopleSolution) or solution.verdict == "refused":
        return found
    shifted = find_shifted_boxes(solution)
    return found if shifted is None else (*found, boxes_in_other_format(shifted))


def findings_of_corrected_clocks(corrections: Corrections) -> tuple[Finding, ...]:
    """Return a notice about each clock that was corrected."""
    return tuple(misread(one.found, corrected=True) for one in corrections.of(ClockCorrection))
