"""Faults of the input that an estimate shows: they are corrected, and the rig is estimated again."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from passerby.calibration.camera_motion import Motion, MotionCorrection, MotionSearch, correct_motion, measure_motions
from passerby.calibration.clock_skew import MOST_CORRECTIONS as MOST_RATE_CORRECTIONS
from passerby.calibration.clock_skew import ClockRateCorrection, correct_clock_rates
from passerby.calibration.estimate import estimate_rig
from passerby.calibration.held_out import is_worse
from passerby.calibration.lens_corrections import LensExamination, examine_stated_lenses
from passerby.calibration.readings import MOST_CORRECTIONS as MOST_CLOCK_CORRECTIONS
from passerby.calibration.readings import ClockCorrection, correct_late_clock
from passerby.calibration.run import CalibrationRun, Correction, Corrections, Estimate
from passerby.core.cameras import Rig
from passerby.scene.inputs import SceneInputs


@dataclass(frozen=True, eq=False)
class CorrectedEstimate:
    """An estimate of the inputs after the corrections that it asked for."""

    stated: SceneInputs
    """As they were read."""
    inputs: SceneInputs
    estimate: Estimate
    corrections: Corrections
    lenses: LensExamination
    moved: tuple[Motion, ...]
    """The motions of cameras, measured by the final rig."""
    seconds: float
    """Wall time."""

    @property
    def rig(self) -> Rig:
        """Names, lenses, and the poses that were found."""
        return self.estimate.solution.rig


def correct_inputs(run: CalibrationRun, inputs: SceneInputs) -> CorrectedEstimate:
    """Estimate a rig. While the estimate shows a fault of the input, correct the fault and estimate again.

    An estimate is six solves at most. There is one estimate, and one more for each correction: as many as there are cameras
    (motion), three of clock offsets, three of lenses, and six of clock rates where these are refined. The check of image sizes
    adds one solve for each camera whose people stay in a part of the image, and one.
    """
    height_m, stated = run.scene.scale.person_height_m, inputs
    motions = MotionSearch(stated, run.scene.association.given, height_m)
    began = time.perf_counter()
    # The systems are small: more BLAS threads only wait for each other, and the number of them would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        estimate, corrections = estimate_rig(run, inputs), Corrections()
        while True:
            correction, lenses = find_correction(run, motions, inputs, estimate, corrections)
            if correction is None:
                break
            after = estimate_rig(run, correction.inputs)
            if not correction.explains(after, estimate, height_m) or (
                correction.tentative and is_worse(after, estimate, height_m, run.seed)
            ):
                corrections = replace(corrections, dropped=(*corrections.dropped, correction))
                continue
            corrections = replace(corrections, made=(*corrections.made, correction))
            inputs, estimate = correction.inputs, after
        moved = measure_motions(motions, corrections, estimate)
    return CorrectedEstimate(stated, inputs, estimate, corrections, lenses, moved, time.perf_counter() - began)


def find_correction(
    run: CalibrationRun, motions: MotionSearch, inputs: SceneInputs, estimate: Estimate, corrections: Corrections
) -> tuple[Correction | None, LensExamination]:
    """The first fault of the input that an estimate shows, corrected; and what is found of the lenses where there is none.

    Faults are looked for in this order, so that a lens is not blamed for a clock or a motion.
    """
    if "clock_rate" in run.scene.solver.refine and corrections.allows(ClockRateCorrection, MOST_RATE_CORRECTIONS):
        rates = correct_clock_rates(inputs, estimate)
        if rates is not None:
            return rates, LensExamination()
    if corrections.allows(ClockCorrection, MOST_CLOCK_CORRECTIONS):
        clock = correct_late_clock(inputs, estimate)
        if clock is not None:
            return clock, LensExamination()
    if corrections.allows(MotionCorrection, len(inputs.rig)):
        motion = correct_motion(motions, inputs, estimate)
        if motion is not None:
            return motion, LensExamination()
    return examine_stated_lenses(inputs, estimate, corrections, run.scene.scale.person_height_m)
