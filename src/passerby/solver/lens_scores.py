"""How much better people would fit if a part of the stated lenses were free: score tests at an optimum that holds them.

One Gauss-Newton step of the reduced system, widened by columns for the lenses, says for every hypothesis "this part of this
camera's lens is wrong, and nothing else" where it would go and by how much the cost would fall (Rao 1948). That is a fall of
the log likelihood, so that hypotheses can be compared, and it costs as much as one iteration. A step with all lenses free
instead spreads one wrong lens over all cameras, with sigmas several times as large. Focal lengths with a stated standard
deviation are nuisance parameters of all hypotheses: a change that this deviation explains contradicts nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.symmetric import inverse_of, pseudo_inverse
from passerby.core.cameras import Lens, Rig
from passerby.solver.lens_columns import (
    WidenedLayout,
    by_focal,
    by_principal_point,
    lens_columns,
)
from passerby.solver.lens_unknowns import LensPart, by_distortion
from passerby.solver.optimizer.least_squares import NormalEquations
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.systematic import StatedFocals
from passerby.solver.uncertainty import downweight

_DERIVATIVES = {"focal": by_focal, "principal_point": by_principal_point, "distortion": by_distortion}

MOST_CHANGE: Mapping[LensPart, float] = MappingProxyType({"focal": 1.0, "principal_point": 0.4, "distortion": 0.5})
"""What a stated lens is off by at most: the logarithm of the focal length, or what it moves points of the image by as a share
of the width. Where a step goes farther, the rig is in pieces, or its people say nothing of the lens."""


@dataclass(frozen=True)
class LensHypothesis:
    """That a part of some cameras' lenses is stated wrongly: of one camera, or of all alike."""

    part: LensPart
    cameras: tuple[int, ...]
    """Indices."""
    axis: int | None = None
    """Of a principal point that is wrong along one axis of the image alone: 0 or 1."""


@dataclass(frozen=True)
class LensScore:
    """What the score test says of a hypothesis."""

    hypothesis: LensHypothesis
    change: tuple[float, ...]
    """Where the part would go: the logarithm of the focal length, pixels in x and y, or the first distortion coefficient."""
    sd: tuple[float, ...]
    """One standard deviation of each, by the observations' random noise alone."""
    gain: float
    """By how much twice the log likelihood would grow."""


@dataclass(frozen=True, eq=False)
class _FreeLenses:
    """The reduced system of u numbers of every lens, all else eliminated."""

    H: Floats
    """(C u, C u) its normal matrix."""
    step: Floats
    """(C u,) where all of them would go together."""

    def along(self, hypothesis: LensHypothesis, columns: Floats) -> LensScore:
        """The step along some directions alone, (C u, k); no sigma is finite where one of them is unknown."""
        gradient, information = columns.T @ self.H @ self.step, columns.T @ self.H @ columns
        covariance = np.linalg.pinv(information, hermitian=True)
        known = np.linalg.matrix_rank(information, hermitian=True) == len(information) and (np.diag(covariance) > 0).all()
        change = covariance @ gradient
        sd = np.sqrt(np.diag(covariance)) if known else np.full(len(change), np.inf)
        return LensScore(hypothesis, tuple(change.tolist()), tuple(sd.tolist()), float(gradient @ change))


def score_lenses(
    rig: Rig, problem: PeopleProblem, state: AdjustmentState, inflation: float,
    parts: Iterable[LensPart] = ("focal", "principal_point", "distortion"),
) -> list[LensScore]:  # fmt: skip
    """The scores of all hypotheses, the likeliest first.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model, in which no lens is free.
        state: its optimum.
        inflation: how many times less the observations say than as many independent ones would.
        parts: of lenses, of which one may be wrong in one camera; focal lengths and distortions also in all cameras alike, and
            a principal point along one axis as well.
    """
    n, scores = problem.n_cameras, []
    guessed = StatedFocals.of(rig, problem, state)
    for part in parts:
        columns = lens_columns(rig, problem, state, _DERIVATIVES[part])
        lenses = _free_lenses(problem, state, inflation, columns, guessed)
        own = np.eye(len(lenses.H)).reshape(n, -1, len(lenses.H))
        scores += [lenses.along(LensHypothesis(part, (c,)), own[c].T) for c in range(n)]
        if part == "principal_point":
            scores += [lenses.along(LensHypothesis(part, (c,), k), own[c, k : k + 1].T) for c in range(n) for k in range(2)]
        if part != "principal_point":
            scores.append(lenses.along(LensHypothesis(part, tuple(range(n))), np.ones((n, 1))))
    return sorted(scores, key=lambda score: -score.gain)


def _free_lenses(
    problem: PeopleProblem, state: AdjustmentState, inflation: float, columns: Mapping[str, Floats],
    guessed: StatedFocals | None,
) -> _FreeLenses:  # fmt: skip
    """The system of u numbers of every lens; `columns` as of `lens_columns`. Errors of guessed focal lengths are eliminated."""
    own = dict(columns)
    u = next(iter(own.values())).shape[2]
    if guessed is not None:
        own = {kind: np.concatenate([own[kind], guessed.columns[kind]], axis=2) for kind in own}
    wide = WidenedLayout.of(problem, next(iter(own.values())).shape[2])
    terms = [downweight(wide.widen(term, own), inflation) for term in problem.terms(state, jacobians=True)]
    reduced = NormalEquations(wide.layout, terms).reduce()
    H, kept = reduced.H, np.arange(len(reduced.H))
    if guessed is not None:
        errors, known = wide.places[:, u], np.diag(guessed.covariance) == 0.0
        uncertain = errors[~known]
        H[np.ix_(uncertain, uncertain)] += inverse_of(guessed.covariance[np.ix_(~known, ~known)])
        kept = np.setdiff1d(kept, errors[known])
    inverse = inverse_of(H[np.ix_(kept, kept)])
    at: Ints = np.searchsorted(kept, wide.places[:, :u].ravel())
    return _FreeLenses(pseudo_inverse(inverse[np.ix_(at, at)], 1e-15), -(inverse @ reduced.gradient[kept])[at])


def plausible(rig: Rig, hypothesis: LensHypothesis, change: Sequence[float] | Floats) -> bool:
    """Whether a change of the lens goes no farther than lenses are stated wrongly."""
    return bool(np.isfinite(change).all()) and farthest(rig, hypothesis, change) < MOST_CHANGE[hypothesis.part]


def farthest(rig: Rig, hypothesis: LensHypothesis, change: Sequence[float] | Floats) -> float:
    """How far a change goes in the camera where it goes farthest: a share of the focal length, or of the image's width."""
    return max(_moved(rig.cameras[c].lens, hypothesis.part, change) for c in hypothesis.cameras)


def _moved(lens: Lens, part: LensPart, change: Sequence[float] | Floats) -> float:
    """The same in one camera; a distortion moves the middles of the left and the right edge."""
    width = lens.size[0]
    if part == "focal":
        return abs(float(change[0]))
    if part == "principal_point":
        return float(np.linalg.norm(change)) / width
    edge = lens.bearings(np.array([[0.0, lens.size[1] / 2], [width - 1.0, lens.size[1] / 2]]))
    return float(abs(change[0]) * np.nanmax(np.abs(by_distortion(lens, edge)), initial=0.0)) / width
