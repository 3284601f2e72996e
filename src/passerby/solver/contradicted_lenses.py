"""Which stated lenses do people contradict? A camera is named where its lens, freed, goes far and all else fits then.

Score tests of every hypothesis (`lens_scores`) say which are worth a refit (`freed_lenses`): none in a sound rig. Among the
likely ones that is taken which leaves least for another lens to explain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.core.cameras import Rig
from passerby.findings.finding import Finding, doubt
from passerby.solver.freed_lenses import FreedLens, refit_freed
from passerby.solver.initialisation import Fit, Initialisation
from passerby.solver.lens_scores import LensHypothesis, LensScore, farthest, plausible, score_lenses
from passerby.solver.lens_sigmas import BOXES_MISLEAD

LEAST_GAIN, LEAST_GAIN_OF_JOINTS = 20.0, 30.0
"""Of twice the log likelihood, for a lens to be worth a refit: by boxes alone, and where there are joints, which err alike so
that more of them average nothing out (`docs/results/limits.md`)."""
RIVAL_SHARE, MOST_RIVALS = 0.75, 3
"""Hypotheses with this share of the largest gain may be the right one: so many are tried."""
LEAST_SIGMAS = 2.0
"""How far a freed lens is from the stated one, in sigmas that hold what boxes mislead by (`BOXES_MISLEAD`)."""
LEAST_CHANGE = {"focal": 0.03, "principal_point": 0.02, "distortion": 0.01}
"""How far it is at least: a share of the focal length; what the change moves, as a share of the width."""
MOST_LEFT = BOXES_MISLEAD**2
"""A freed lens is where people put it if another step would gain less than one of one sigma."""
MIN_INSTANTS = 100
"""People, each instant counted, that agree in a camera that is named: fewer see too little of its image."""
LEAST_AGREEING = 0.71
"""Share of a camera's observations that agree with the rig once its lens is freed: 73 % and more with the right one."""
MOST_LENSES = 3
"""Lenses named at most: where more are wrong, the rig is."""
_CROPPED = 0.03
"""A principal point that is off by this share of the width comes from a cropped image."""


@dataclass(frozen=True)
class ContradictedLens:
    """A part of a lens, and where people put it."""

    hypothesis: LensHypothesis
    change: tuple[float, ...]
    """As `LensScore.change`."""
    sigma: tuple[float, ...]
    """One sigma of it."""


def contradicted_lenses(
    start: Initialisation, fit: Fit, inflation: float, least_gain: float | None = None
) -> list[ContradictedLens]:
    """The parts of stated lenses that people contradict; none where lenses are refined, which go where people put them.

    Args:
        start: what the optimum was computed from.
        fit: the optimum.
        inflation: how many times less the observations say than as many independent ones would.
        least_gain: below which nothing is tried; by default the limit for what was seen.
    """
    if start.unknowns.parts:
        return []
    if least_gain is None:
        least_gain = LEAST_GAIN_OF_JOINTS if start.evidence.n_joints else LEAST_GAIN
    first: Sequence[LensScore] = score_lenses(start.rig, fit.model.problem, fit.result.state, inflation)
    scores = first
    best: FreedLens | None = None
    while best is None or len(best.changes) < MOST_LENSES:
        known: Mapping[LensHypothesis, tuple[float, ...]] = {} if best is None else best.changes
        likely = _likely(start.rig, scores, known, least_gain)
        if best is not None and likely:  # what was likely at first and is not explained yet, beside what is likely now
            rivals = [best.score_of(score.hypothesis) for score in _likely(start.rig, first, known, least_gain)]
            likely += [score for score in rivals if score not in likely and score.gain > least_gain]
        surest = [_along_surest(scores, score, least_gain) for score in likely]
        tried = [refit_freed(start, fit, score, known) for score in (*likely, *surest) if score is not None]
        sound = [freed for freed in tried if _holds(start.rig, freed)]
        if not sound:
            break
        best = min(sound, key=lambda freed: freed.scores[0].gain)
        scores = best.scores
    # Where one of two wrong lenses is freed, the other shows the more; in the end little must be left, and less for the lenses
    # that stay as stated than before: a change that makes these doubtful is no explanation.
    if best is None or best.scores[0].gain > min(RIVAL_SHARE * first[0].gain, _of_others(first, best.changes)):
        return []
    return [_contradicted(best, hypothesis) for hypothesis in best.changes]


def _of_others(scores: Sequence[LensScore], freed: Mapping[LensHypothesis, object]) -> float:
    """The largest gain of a hypothesis about other parts or cameras than those that were freed."""
    explained = {(hypothesis.part, hypothesis.cameras) for hypothesis in freed}
    others = (one.gain for one in scores if (one.hypothesis.part, one.hypothesis.cameras) not in explained)
    return max(others, default=np.inf)


def contradictions_of(rig: Rig, found: Sequence[ContradictedLens]) -> list[Finding]:
    """The findings about lenses that people contradict."""
    return [_finding(rig, lens) for lens in found]


def _likely(
    rig: Rig, scores: Sequence[LensScore], known: Mapping[LensHypothesis, object], least_gain: float
) -> list[LensScore]:
    """The hypotheses that may be right, beside those that are known to be."""
    least = max(least_gain, RIVAL_SHARE * scores[0].gain)
    explained = {(hypothesis.part, hypothesis.cameras) for hypothesis in known}
    likely = [
        score for score in scores
        if score.gain >= least and score.hypothesis.axis is None
        and (score.hypothesis.part, score.hypothesis.cameras) not in explained
    ]  # fmt: skip
    return [score for score in likely if plausible(rig, score.hypothesis, score.change)][:MOST_RIVALS]


def _along_surest(scores: Sequence[LensScore], score: LensScore, least_gain: float) -> LensScore | None:
    """The score of a principal point along the axis that people know best, where that is worth a refit.

    By boxes, its height turns with the camera's tilt, and whatever else is wrong drives it on and on.
    """
    if score.hypothesis.part != "principal_point" or len(score.change) < 2:
        return None
    axis = int(np.argmax(np.abs(score.change) / np.array(score.sd)))
    hypothesis = replace(score.hypothesis, axis=axis)
    alone = next(one for one in scores if one.hypothesis == hypothesis)
    return alone if alone.gain >= least_gain else None


def _holds(rig: Rig, freed: FreedLens) -> bool:
    """Whether people put the freed lenses far from the stated ones, and agree with them there."""
    for hypothesis in freed.changes:
        cameras = list(hypothesis.cameras)
        lens = _contradicted(freed, hypothesis)
        far = max(abs(change) / sigma for change, sigma in zip(lens.change, lens.sigma, strict=True)) > LEAST_SIGMAS
        moved = farthest(rig, hypothesis, lens.change)
        agree = (freed.agreeing[cameras] >= LEAST_AGREEING).all() and (freed.people[cameras] >= MIN_INSTANTS).all()
        settled = freed.score_of(hypothesis).gain < MOST_LEFT
        if not (
            far and moved > LEAST_CHANGE[hypothesis.part] and plausible(rig, hypothesis, lens.change) and agree and settled
        ):
            return False
    return True


def _contradicted(freed: FreedLens, hypothesis: LensHypothesis) -> ContradictedLens:
    """Where people put a freed part, and how surely."""
    sigma = BOXES_MISLEAD * np.array(freed.score_of(hypothesis).sd)
    return ContradictedLens(hypothesis, freed.changes[hypothesis], tuple(sigma.tolist()))


def _finding(rig: Rig, found: ContradictedLens) -> Finding:
    """What is said of one lens, or of all."""
    part, cameras = found.hypothesis.part, found.hypothesis.cameras
    if part == "focal":
        change = float(np.expm1(found.change[0]))
        if len(cameras) > 1:
            return doubt("all_focals_contradicted", change=change)
        return doubt("focal_contradicted", rig.names[cameras[0]], change=change)
    camera = rig.cameras[cameras[0]]
    if part == "principal_point":
        # The direction that people know best: by boxes, the other one turns with the vertical.
        best = int(np.argmax(np.abs(found.change) / np.array(found.sigma)))
        axis, moved = best if found.hypothesis.axis is None else found.hypothesis.axis, found.change[best]
        if abs(moved) > _CROPPED * camera.lens.size[0]:
            side = ("left", "right") if axis == 0 else ("top", "bottom")
            return doubt("image_seems_cropped", camera.name, side=side[int(moved > 0)], moved_px=abs(moved))
        return doubt("lens_part_contradicted", camera.name, part="principal point")
    return doubt("lens_part_contradicted", *(rig.names[c] for c in cameras), part="distortion")
