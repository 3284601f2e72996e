"""Where each camera's focal length would go, all of them free: the figures `focal_change` of a camera that holds its own.

One unknown a camera is added, the logarithm of its focal length, and one Gauss-Newton step of the reduced system says where
it would go, and how surely with what people's apparent size does over depth. What contradicts a stated lens is decided
elsewhere (`contradicted_lenses`): a step of all lenses together spreads one that is wrong over all. What no lens explains,
since it goes too far, contradicts the camera's place (`sizes_contradicted`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.symmetric import inverse_of
from passerby.core.cameras import Rig
from passerby.findings.finding import Finding, doubt
from passerby.solver.lens_columns import WidenedLayout, by_focal, lens_columns
from passerby.solver.lens_sigmas import by_boxes
from passerby.solver.optimizer.least_squares import NormalEquations
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import downweight

# People do not look equally tall at all distances: hidden feet, slopes and a detector's habits change with depth by
# a few percent, which a focal length would explain as well: docs/results/limits.md.
SIZE_DRIFT = 0.04
# Joints are off by what no more of them averages out: a detector puts each kind of joint beside the true one, by as much as
# pose and view make it. Steps of right lenses, over their random sigmas: 1.1 root mean square, 3.4 at the 99th percentile, in
# 78 simulated scenes whose joints are off by 1 to 3 % of the body, most of it constant by kind, camera and heading.
JOINTS_MISLEAD = 1.5
# A detector leaves a margin around people, some of it constant in pixels, so that those far off seem larger. Steps of right
# lenses over sigmas that do not know of it: 1.3, 1.4 and 1.6 root mean square where each edge of a camera's boxes is off by
# 0, 2 and 4 pixels throughout (27 simulated scenes of a minute, three presets, seeds 300 to 302).
MARGINS_MISLEAD = 1.5

FAR_CHANGE, FAR_SIGMAS = 0.3, 4.0
"""A focal length that would go so far, as a logarithm, and so many of its sigmas, is no matter of chance; if no wrong lens
explains it, the camera's place is wrong (`docs/results/limits.md`). Where one sigma of it is more than `FAR_CHANGE`, people
tell next to nothing of the focal length: a linear step says nothing so far from where it was made."""


@dataclass(frozen=True)
class FocalCheck:
    """Where one camera's focal length would go."""

    camera: str
    change: float
    """Change of its logarithm."""
    sigma: float
    """One sigma of it, with what the people's apparent size may drift over depth."""


def check_focals(rig: Rig, problem: PeopleProblem, state: AdjustmentState, inflation: float) -> list[FocalCheck]:
    """The step of each camera's focal length at the optimum.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
    """
    step, sd, misled = _score(
        problem, state, inflation, lens_columns(rig, problem, state, by_focal), _by_size_drift(problem, state)
    )
    boxes = by_boxes(problem)
    random, margins = np.where(boxes, 1.0, JOINTS_MISLEAD) * sd[:, 0], np.where(boxes, MARGINS_MISLEAD, 1.0)
    sigma = margins * np.hypot(random, misled[:, 0])
    columns = zip(rig.names, step[:, 0].tolist(), sigma.tolist(), strict=True)
    return [FocalCheck(*row) for row in columns]


def sizes_contradicted(focals: Sequence[FocalCheck]) -> list[Finding]:
    """Doubts about cameras whose people are too large or too small for where the camera stands, by more than a lens is wrong.

    Such a camera is not where it seems to be: its people are others than those it was registered by. Where the steps of all
    cameras are the same within one sigma, none is placed by other people: cameras side by side on a wall can trade all focal
    lengths for all distances, and whatever boxes mislead by decides where a linear step goes (-90 % and 12 sigmas in simulated
    rigs that are right to 1 cm). Whether all focal lengths are wrong is a hypothesis of `contradicted_lenses`.
    """
    found = [
        doubt("size_contradicted", one.camera, change=float(np.expm1(one.change)), sigmas=abs(one.change) / one.sigma)
        for one in focals
        if one.sigma < FAR_CHANGE and abs(one.change) > max(FAR_CHANGE, FAR_SIGMAS * one.sigma)
    ]
    alike = len(found) == len(focals) > 1 and np.ptp([one.change for one in focals]) < min(one.sigma for one in focals)
    return [] if alike else found


def _score(
    problem: PeopleProblem, state: AdjustmentState, inflation: float, columns: dict[str, Floats], biases: dict[str, Floats]
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Gauss-Newton steps of u more unknowns of each camera, all (C, u): steps, their standard deviations, and one sigma of what
    biases of the observations do to them.

    Args:
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
        columns: (M, k, u) whitened derivatives by the own camera's unknowns, for each kind of residual.
        biases: (M, k, 1) by one bias of each camera, in its sigmas: no unknown, but considered in the sigma (`systematic`).
    """
    n, u = problem.n_cameras, next(iter(columns.values())).shape[2]
    both = {k: np.concatenate([columns[k], biases[k]], axis=2) for k in columns}
    wide = WidenedLayout.of(problem, next(iter(both.values())).shape[2])
    terms = [downweight(wide.widen(term, both), inflation) for term in problem.terms(state, jacobians=True)]
    reduced = NormalEquations(wide.layout, terms).reduce()
    own, considered = wide.places[:, :u], wide.places[:, u:].ravel()
    kept = np.setdiff1d(np.arange(len(reduced.H)), considered)
    inverse = inverse_of(reduced.H[np.ix_(kept, kept)])
    at = np.searchsorted(kept, own)
    step = -inverse @ reduced.gradient[kept]
    biased = (inverse @ reduced.H[np.ix_(kept, considered)])[at].reshape(n, u, -1)
    return step[at], np.sqrt(np.maximum(np.diag(inverse)[at], 1e-18)), np.sqrt((biased**2).sum(axis=2))


def _by_size_drift(problem: PeopleProblem, state: AdjustmentState) -> dict[str, Floats]:
    """Whitened derivatives (M, k, 1) by people who seem to grow by `SIZE_DRIFT` for a distance that is larger by a factor e."""
    s, n = problem.sightings, problem.n_cameras
    away = np.log(np.maximum(np.linalg.norm(state.people[s.block, :2] - state.centre[s.camera, :2], axis=1), 0.1))
    mean = np.bincount(s.camera, away, n) / np.maximum(np.bincount(s.camera, minlength=n), 1)
    return {
        "centres": np.zeros((len(s), 2, 1)),
        "heights": (SIZE_DRIFT * (away - mean[s.camera]) / problem.height_sigma())[:, None, None],
        "joints": np.zeros((len(problem.joints.camera), 2, 1)),
    }
