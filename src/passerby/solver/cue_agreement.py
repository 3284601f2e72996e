"""Joint evaluation of all scale cues: the probability that each is wrong, and whether the scale is in doubt.

Each cue is either correct within its stated sigma, or wrong. The people may be of another population than the assumed one: then
their heights and widths are wrong by one common factor, which only other cues show. The posterior of the scale is a mixture of
these explanations. The scale is in doubt where another scale, beyond the stated uncertainty, is about as likely as the one that
was found. A wrong cue that does not change the scale is a notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from passerby.common.arrays import Floats
from passerby.core.figures import CueFigures
from passerby.findings.finding import Finding, doubt, notice

WRONG, WRONG_SD = 0.05, 0.4
"""Prior probability that a cue is wrong, equal to `WRONG_SITES` for lenses; and one sigma of its error as a logarithm: between
a tenth and a factor of two. Feet for metres, boxes of the upper body or a wrong frame rate exceed it."""
OTHERS, OTHERS_M, OTHERS_SD = 0.05, 1.25, 0.25
"""Prior probability that the people are not adults (schools, kindergartens); their mean stature, metres, and one sigma of its
logarithm: children of 1 to 12 years are 0.76 to 1.50 m tall (medians of the WHO growth references of 2006 and 2007)."""
ASSUMED_SD = 0.04
"""Sigma from which a mean stature counts as assumed (`POPULATION_BIAS`); one with a smaller sigma was stated with it."""
AS_LIKELY = 10**-0.5
"""Odds from which an explanation counts as about as likely as another: evidence below a factor of the root of ten is "barely
worth mentioning" (Jeffreys 1961, *Theory of Probability*, appendix B)."""
MOST_SIGMAS = 3.0
"""Distance from the stated scale, in sigmas, beyond which a scale counts as another one."""
RIG_SD = 0.005
"""Relative sigma of a rig's measurement between any two of its parts, from its shape on simulated scenes with boxes."""
STEP = 0.001
"""Step of the grid of logarithms of scales, a fifth of the sigma of the most certain cue."""
CODE = "scale_cues_disagree"
_STATURES = ("population", "segments")
_OF_PEOPLE = (*_STATURES, "body_width")
"""Cues that are wrong by the same factor where the people are of another population."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Result of the joint evaluation of N cues."""

    wrong: Floats
    """(N,) probability that each cue is wrong."""
    off: float
    """Probability that the error of the scale exceeds `MOST_SIGMAS` of its stated uncertainty."""
    more_variance: float
    """Variance that another population adds to the logarithm of the scale, if all cues are correct within their sigmas."""

    @property
    def is_doubtful(self) -> bool:
        """Whether another scale is about as likely as the one that was found."""
        return self.off > AS_LIKELY * (1 - self.off)

    @property
    def suspects(self) -> list[int]:
        """The cue that is most probably wrong, and the next one if it is about as probable; empty where no cue is suspect."""
        if not len(self.wrong):
            return []
        least = AS_LIKELY * (self.wrong.max() if self.is_doubtful else 1 / (1 + AS_LIKELY))
        return [i for i in np.argsort(-self.wrong, kind="stable")[:2].tolist() if self.wrong[i] >= least]


def weigh_cues(cues: Sequence[CueFigures]) -> Agreement:
    """Compute the posterior of the scale, on a grid, and from it the probability that each cue is wrong.

    Args:
        cues: N cues with a scale of their own, as from `known_cues`.
    """
    if not cues:
        return Agreement(np.zeros(0), 0.0, 0.0)
    at, sd = log_scales(cues)
    grid = np.arange(at.min() - 1.0, at.max() + 1.0, STEP)
    residual = at[:, None] - grid
    sound, wrong = np.log(1 - WRONG) + _log_normal(residual, sd), np.log(WRONG) + _log_wrong(residual, sd, cues)
    either = np.logaddexp(sound, wrong)
    assumed = next((cue for cue in cues if cue.kind == "population" and (cue.own_sigma or 0.0) >= ASSUMED_SD), None)
    people = np.array([assumed is not None and cue.kind in _OF_PEOPLE for cue in cues])
    shifted = np.full(len(grid), -np.inf)
    if assumed is not None:
        prior, shift = np.log(OTHERS / (1 - OTHERS)), float(np.log(assumed.stated_m / OTHERS_M))
        shifted = prior + _log_shifted(residual[people], sd[people], shift)
    by_usual, by_others = _posterior(either, people, shifted)
    share = np.exp(wrong - either)
    statures = np.array([assumed is not None and cue.kind in _STATURES for cue in cues])
    p_wrong = share @ by_usual + np.where(people, 0.0, share @ by_others) + statures * by_others.sum()
    middle, sigma = _stated(cues, at, sd)
    off = float((by_usual + by_others)[np.abs(grid - middle) > MOST_SIGMAS * sigma].sum())
    by_usual, by_others = _posterior(sound, people, shifted)
    return Agreement(p_wrong, off, max(_variance(grid, by_usual + by_others) - _variance(grid, by_usual), 0.0))


def check_cue_consistency(cues: Sequence[CueFigures]) -> tuple[list[CueFigures], list[Finding]]:
    """Return the cues, each with those it contradicts, and the finding: a doubt where the scale is in doubt, else a notice."""
    known = known_cues(cues)
    agreement = weigh_cues(known)
    suspects = agreement.suspects if len(known) > 1 else []
    if not suspects:
        return list(cues), []
    at, sd = log_scales(known)
    first = suspects[0]
    if len(known) == 2:
        suspects = [0, 1]
    suspects = sorted(suspects, key=lambda i: sd[i])
    rest = np.array([i for i in range(len(known)) if i != first])
    if len(suspects) == 2:
        off, sigma = float(at[suspects[0]] - at[suspects[1]]), float(np.hypot(*sd[suspects]))
        values = {"percent": 100 * float(np.expm1(abs(off))), "sigmas_percent": (100 * sd[suspects]).tolist()}
        names = {known[i].cue: (known[j].cue,) for i, j in (suspects, suspects[::-1])}
    else:
        weight = sd[rest] ** -2.0
        off, sigma = float(at[first] - np.average(at[rest], weights=weight)), float(np.hypot(sd[first], weight.sum() ** -0.5))
        stated_m = known[first].stated_m
        values = {"stated_m": stated_m, "measured_m": stated_m * float(np.exp(-off))}
        names = {known[first].cue: tuple(known[i].cue for i in rest)}
    report = doubt if agreement.is_doubtful else notice
    cues_said = [known[i].cue for i in suspects], [known[i].kind for i in suspects]
    finding = report(CODE, cues=cues_said[0], kinds=cues_said[1], sigmas=abs(off) / sigma, **values)
    return [replace(cue, disagrees_with=names.get(cue.cue)) for cue in cues], [finding]


def known_cues(cues: Sequence[CueFigures]) -> list[CueFigures]:
    """Return the cues that determine a scale of their own."""
    return [cue for cue in cues if cue.own_scale is not None and cue.own_sigma is not None]


def log_scales(cues: Sequence[CueFigures]) -> tuple[Floats, Floats]:
    """Return the logarithm (N,) of the scale by each cue alone, and one sigma (N,) of it, the rig's shape included."""
    at = np.log([cue.own_scale for cue in cues if cue.own_scale is not None])
    return at, np.hypot([cue.own_sigma for cue in cues if cue.own_sigma is not None], RIG_SD)


def _stated(cues: Sequence[CueFigures], at: Floats, sd: Floats) -> tuple[float, float]:
    """Return the logarithm of the rig's scale and one sigma: from known places that set it, else from the weighted cues."""
    rests = np.array([cue.kind == "world" for cue in cues])
    rests = rests if rests.any() else np.array([cue.share > 0 for cue in cues])
    weight = sd**-2.0 * (rests if rests.any() else 1.0)
    return float(np.average(at, weights=weight)), float(weight.sum() ** -0.5)


def _posterior(density: Floats, people: NDArray[np.bool_], shifted: Floats) -> tuple[Floats, Floats]:
    """Return the probabilities (G,) of the grid's scales with people as assumed, and (G,) with people of another population.

    Args:
        density: (N, G) logarithm of the density of each cue.
        people: (N,) whether another population changes the cue.
        shifted: (G,) logarithm of the joint density of these cues with another population, with its prior odds.
    """
    usual, others = density.sum(axis=0), density[~people].sum(axis=0) + shifted
    top = max(usual.max(), others.max())
    by_usual, by_others = np.exp(usual - top), np.exp(others - top)
    total = (by_usual + by_others).sum()
    return by_usual / total, by_others / total


def _log_normal(residual: Floats, sd: Floats) -> Floats:
    """Return the log density (N, G) of residuals (N, G) with sigmas (N,), without its constant."""
    return np.asarray(-0.5 * (residual / sd[:, None]) ** 2 - np.log(sd)[:, None])


def _log_wrong(residual: Floats, sd: Floats, cues: Sequence[CueFigures]) -> Floats:
    """Return the same (N, G) for cues that are wrong by `WRONG_SD` in either direction; cues of boxes err in one direction.

    Boxes whose shape differs from people's are narrower. Wider boxes end within the body: then the stature is wrong, and the
    rig is too large. This is taken to be half of the cases of a wrong stature; in the other half its mean is wrong, in either
    direction. An error in one direction has a skew normal density (Azzalini 1985, *A class of distributions which includes the
    normal ones*).
    """
    share = np.array([{"body_width": 1.0, "population": 0.5}.get(cue.kind or "", 0.0) for cue in cues])[:, None]
    wide = np.hypot(sd, WRONG_SD)
    one_way = 2 * ndtr(residual * (WRONG_SD / (sd * wide))[:, None])
    return _log_normal(residual, wide) + np.log(np.maximum(1 - share + share * one_way, np.finfo(np.float64).tiny))


def _log_shifted(residual: Floats, sd: Floats, shift: float) -> Floats:
    """Return the joint log density (G,) of residuals (N, G) with one common shift of mean `shift` and sigma `OTHERS_SD`."""
    weight = sd**-2.0
    total = weight.sum()
    mean = weight @ residual / total
    spread = weight @ residual**2 - total * mean**2
    variance = OTHERS_SD**2 + 1 / total
    log_norm = -np.log(sd).sum() - 0.5 * np.log(total * variance)
    return np.asarray(-0.5 * (spread + (mean - shift) ** 2 / variance) + log_norm)


def _variance(grid: Floats, weight: Floats) -> float:
    """Return the variance of a density on the grid (G,)."""
    mean = np.average(grid, weights=weight)
    return float(np.average((grid - mean) ** 2, weights=weight))
