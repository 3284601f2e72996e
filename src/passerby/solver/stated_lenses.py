"""Refinement of stated lenses on request: they are freed in a rig that holds them, and kept only where that is better.

A refinement is dropped where its adjustment does not converge, where a lens differs from the stated one more than wrong ones
do, or where it does not predict held-out people better than the stated lenses. A principal point and a rotation, a focal length
and a distance compensate each other. Where people do not separate them, the stated lenses are as accurate and have fewer
unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.core.lens_figures import LensRefinement
from passerby.solver.adjustment_problem import rig_of
from passerby.solver.block_prediction import Prediction, compare_predictions, held_out_blocks, predicted_costs
from passerby.solver.initialisation import PeopleOptions
from passerby.solver.lens_unknowns import FAR_SIGMAS, LensPart
from passerby.solver.refinement import Fit, refine_rig

LEAST_GAIN, LEAST_SIGMAS = 3.0, 3.0
"""Gain above which a refinement predicts held-out people better: in nats (odds of 20 to 1), and in its standard errors.
Simulated scenes of the three presets, four cameras, 60 s (seeds 820 and 821): with right lenses at most 6.4 nats and 1.4
standard errors; with one lens or all lenses wrong by 5 to 15 % of the focal length and 3 to 8 % of the width, 75 nats and 5.0
standard errors or more. A part that people barely constrain gains less than a nat, equally in all blocks."""


def refine_stated_lenses(
    fit: Fit, parts: Sequence[LensPart], options: PeopleOptions, rng: np.random.Generator, fps: float
) -> tuple[Fit, LensRefinement]:  # fmt: skip
    """Refine stated lenses: return the optimum with refined lenses or, where that is dropped, `fit`; and a report.

    Where more than one part is to be refined and this is dropped, the first part alone is refined: the focal lengths.

    Args:
        fit: the optimum that holds all lenses.
        parts: parts of the lenses to refine.
        options: options of the solver.
        rng: draws a sample where there are too many observations.
        fps: time steps a second.
    """
    dropped: LensRefinement | None = None
    for tried in (parts, parts[:1]) if len(parts) > 1 else (parts,):
        start = fit.start.with_unknowns(tried)
        refined = refine_rig(start, replace(rig_of(fit.result.state), lens=start.lens), options, rng)
        found = _outcome(fit, refined, parts, tried, fps)
        if found.kept:
            return refined, found if dropped is None else replace(dropped, kept=found.kept)
        dropped = dropped or found
    assert dropped is not None
    return fit, dropped


def _outcome(fit: Fit, refined: Fit, asked: Sequence[LensPart], tried: Sequence[LensPart], fps: float) -> LensRefinement:
    """Return whether a refinement is kept, and if not, the reason."""
    asked = tuple(asked)
    if not refined.result.converged:
        return LensRefinement(asked=asked, why="diverged")
    start = refined.start
    if (np.abs(refined.result.state.lens) > FAR_SIGMAS * start.unknowns.uncalibrated_sd(start.stated)).any():
        return LensRefinement(asked=asked, why="implausible")
    gain = _predicted(fit, refined, fps)
    kept = tuple(tried) if gain.gain > max(LEAST_GAIN, LEAST_SIGMAS * gain.sigma) else ()
    return LensRefinement(asked=asked, kept=kept, why=None if kept else "prediction", gain=gain.gain, gain_sigma=gain.sigma)


def _predicted(fit: Fit, refined: Fit, fps: float) -> Prediction:
    """Return the gain of the refined lenses over the stated ones in the prediction of held-out people."""
    blocks = held_out_blocks(fit.start.evidence, (fit, refined), fps)
    before, after = (predicted_costs(one, blocks, fit) for one in (fit, refined))
    return compare_predictions(before, after)
