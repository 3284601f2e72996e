"""Alternatives compared by prediction: how much better people who were held out fit, block by block.

Likelihood ratios that count every box are far too certain, since a person errs alike from one instant to the next. The scatter
of the gains between blocks holds that, whatever the observations are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.measuring import MeasuringErrors, MeasuringFigures
from passerby.hypotheses.alternatives import LENS, Alternative
from passerby.hypotheses.case import Case, prior_precision

FOLDS = 5
LOG_ODDS = float(np.log(10.0))
"""An explanation counts that is ten times as probable as the one it is compared with, its prior odds included: strong evidence
(Jeffreys, *Theory of Probability*, 1961). A sound site then raises an alternative about once in a hundred times."""


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted to all blocks, and what each block costs where it was held out."""

    case: Case
    predicted: Floats
    """(B,) nats."""

    @classmethod
    def of(cls, case: Case, *, fitted: bool = False) -> Refit:
        """Fit a case, and predict each fifth of its blocks from the others."""
        case = case if fitted else case.fitted()
        predicted = np.zeros(case.n_blocks)
        for fold in range(min(FOLDS, case.n_blocks)):
            held_out = np.arange(case.n_blocks) % FOLDS == fold
            predicted += case.predicted(case.without(held_out), held_out)
        return cls(case, predicted)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Held-out gain of one model over another."""

    gain: float
    """Sum over all blocks, nats."""
    z: float
    """Mean over its standard error between blocks."""
    log_evidence: float
    """Logarithm of the odds that the better model is right, before priors: the gain, or less where its scatter says so."""

    @classmethod
    def of(cls, better: Floats, worse: Floats) -> Comparison:
        """From (B,) costs of the held-out blocks, nats.

        A gain of h / 2 is what a right alternative has where a wrong one has -h / 2. So a mean gain z standard errors above 0
        is 2 z above what it would be by chance, and the scatter grants a log likelihood ratio of 2 z^2 for normal gains; with
        few blocks less, by Student's distribution.
        """
        gains = worse - better
        n, total = len(gains), float(gains.sum())
        if n < 2 or not (scatter := float(gains.std(ddof=1))) > 0:
            return cls(total, 0.0, min(total, 0.0))
        z = float(gains.mean() / (scatter / np.sqrt(n)))
        return cls(total, z, min(total, 0.5 * n * float(np.log1p(4 * z**2 / (n - 1)))))


def may_convince(fitted: Floats, base: Floats, log_prior: float) -> bool:
    """Whether an alternative is worth predicting held-out blocks: it explains those that it was fitted to convincingly.

    Blocks that were held out gain less than those that were fitted. The scatter of few blocks is uncertain itself: nothing is
    taken off for that here.

    Args:
        fitted: (B,) costs of the blocks by the alternative, fitted to all of them, nats.
        base: (B,) and by the base model.
        log_prior: logarithm of the alternative's prior odds.
    """
    found = Comparison.of(fitted, base)
    return min(found.gain, 2 * max(found.z, 0.0) ** 2) + log_prior > LOG_ODDS


@dataclass(frozen=True)
class Screened:
    """What one linearisation says of an alternative."""

    alternative: Alternative
    cameras: tuple[str, ...]
    """Names."""
    gain: float
    """By how much the cost of observations and priors would fall, nats."""
    change: float
    """Where its first unknown would go, as an unknown of `LensUnknowns`."""
    sigma: float
    """One standard deviation of it."""


def screen(base: Case, alternatives: list[Alternative]) -> list[Screened]:
    """Score tests of alternatives (Rao 1948): one linearisation for all.

    Args:
        base: at its optimum.
        alternatives: those to test.
    """
    P, covariance, lens = prior_precision(base.problem), base.lens_covariance(), base.state.lens.ravel()
    weight = float(np.mean(base.problem.lens_weight))
    out = []
    for alternative in alternatives:
        less = P - prior_precision(alternative.apply(base.problem, base.stated))
        free = alternative.cameras[0] * LENS.size + alternative.columns  # where its prior is as wide already
        at = np.flatnonzero(less.any(axis=0)) if less.any() else free
        E, C, stated = less[np.ix_(at, at)], covariance[np.ix_(at, at)], lens[at]
        # Without the prior E the optimum moves by d with (C^-1 - E) d = E l, and the cost falls by l' E (l + d) / 2.
        wider = np.linalg.solve(np.eye(len(at)) - C @ E, C)
        moved = stated + wider @ E @ stated
        names, sigma = tuple(base.stated.names[c] for c in alternative.cameras), np.sqrt(max(weight * wider[0, 0], 0.0))
        out.append(Screened(alternative, names, float(0.5 * stated @ E @ moved), float(moved[0]), float(sigma)))
    return out


def effect(change: MeasuringErrors, measuring: MeasuringFigures) -> float:
    """The change of what a rig measures, in its standard deviations: of points, or of one camera's ground if that is more."""
    ground = [
        one.median_mm / max(own.median_mm, 1e-9)
        for name, one in change.cameras.items()
        if name in measuring.cameras and (own := measuring.cameras[name].ground) is not None
    ]
    return max(change.points.median_mm / max(measuring.points.median_mm, 1e-9), *ground, 0.0)
