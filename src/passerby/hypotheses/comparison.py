"""Comparison of alternatives by prediction: the gain in the fit of people who were held out, block by block.

Likelihood ratios that count every box as independent are far too certain, since a person's errors are nearly the same from one
instant to the next. The scatter of the gains between blocks includes this correlation, for any kind of observation.
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
"""An explanation is significant if it is ten times as probable as the one it is compared with, prior odds included: strong
evidence (Jeffreys, *Theory of Probability*, 1961). For a sound site, an alternative is then significant about once in a hundred
times."""


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted to all blocks, and the cost of each block when it was held out."""

    case: Case
    predicted: Floats
    """(B,) costs of the held-out blocks, nats."""

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
    """Mean gain of a block, in its standard errors."""
    log_evidence: float
    """Logarithm of the odds that the better model is right, before priors: the gain, or less if its scatter is large."""

    @classmethod
    def of(cls, better: Floats, worse: Floats) -> Comparison:
        """Compare two models by the costs (B,) of the held-out blocks, nats.

        If the mean gain of a right alternative is h / 2, that of a wrong one is -h / 2. So a mean gain z standard errors above
        0 is 2 z above the gain of a wrong one. For normal gains, this allows a log likelihood ratio of 2 z^2 at most; with few
        blocks less, by Student's distribution.
        """
        gains = worse - better
        n, total = len(gains), float(gains.sum())
        if n < 2 or not (scatter := float(gains.std(ddof=1))) > 0:
            return cls(total, 0.0, min(total, 0.0))
        z = float(gains.mean() / (scatter / np.sqrt(n)))
        return cls(total, z, min(total, 0.5 * n * float(np.log1p(4 * z**2 / (n - 1)))))


def may_convince(fitted: Floats, base: Floats, log_prior: float) -> bool:
    """Check whether an alternative is significant on the blocks that it was fitted to; only then held-out blocks are predicted.

    Held-out blocks gain less than fitted ones. The uncertainty of the scatter with few blocks is not considered here.

    Args:
        fitted: (B,) costs of the blocks by the alternative, fitted to all of them, nats.
        base: (B,) costs of the blocks by the base model, nats.
        log_prior: logarithm of the alternative's prior odds.
    """
    found = Comparison.of(fitted, base)
    return min(found.gain, 2 * max(found.z, 0.0) ** 2) + log_prior > LOG_ODDS


@dataclass(frozen=True)
class Screened:
    """Result of the score test of an alternative, from one linearisation."""

    alternative: Alternative
    cameras: tuple[str, ...]
    """Names of the cameras."""
    gain: float
    """Predicted decrease of the cost of observations and priors, nats."""
    change: float
    """Predicted value of its first free unknown, as an unknown of `LensUnknowns`."""
    sigma: float
    """One standard deviation of `change`."""


def screen(base: Case, alternatives: list[Alternative]) -> list[Screened]:
    """Compute the score tests of alternatives (Rao 1948), with one linearisation for all.

    Args:
        base: the base model at its optimum.
        alternatives: the alternatives to test.
    """
    P, covariance, lens = prior_precision(base.problem), base.lens_covariance(), base.state.lens.ravel()
    weight = float(np.mean(base.problem.lens_weight))
    out = []
    for alternative in alternatives:
        less = P - prior_precision(alternative.apply(base.problem, base.stated))
        free = alternative.cameras[0] * LENS.size + alternative.columns  # used if the base prior is already as wide
        at = np.flatnonzero(less.any(axis=0)) if less.any() else free
        E, C, stated = less[np.ix_(at, at)], covariance[np.ix_(at, at)], lens[at]
        # Without the prior E the optimum moves by d with (C^-1 - E) d = E l, and the cost falls by l' E (l + d) / 2.
        wider = np.linalg.solve(np.eye(len(at)) - C @ E, C)
        moved = stated + wider @ E @ stated
        names, sigma = tuple(base.stated.names[c] for c in alternative.cameras), np.sqrt(max(weight * wider[0, 0], 0.0))
        out.append(Screened(alternative, names, float(0.5 * stated @ E @ moved), float(moved[0]), float(sigma)))
    return out


def effect(change: MeasuringErrors, measuring: MeasuringFigures) -> float:
    """Return the larger change of a rig's measurements, of points or of one camera's ground, in their standard deviations."""
    ground = [
        one.median_mm / max(own.median_mm, 1e-9)
        for name, one in change.cameras.items()
        if name in measuring.cameras and (own := measuring.cameras[name].ground) is not None
    ]
    return max(change.points.median_mm / max(measuring.points.median_mm, 1e-9), *ground, 0.0)
