"""Which scale cues contradict each other, each by the scale that it would give alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.figures import CueFigures
from passerby.findings.finding import Finding, doubt

MOST_SIGMAS = 3.0
"""Cues whose scales are farther apart contradict each other: two of 2 % that differ by 10 %, with room for the logarithm."""
CODES = ("scale_cue_contradicted", "scale_cues_disagree")
RIG_SD = 0.005
"""Relative, of what a rig measures between any two of its parts: its shape on simulated scenes with boxes."""


@dataclass(frozen=True)
class Dispute:
    """A cue that contradicts all others, or two of which one must be wrong."""

    cue: int
    """The wrong one; of two the one that is known better."""
    other: int | None
    """None: `cue` contradicts the rest, which agrees."""
    off: float
    """By how much the cue's scale is larger than that of the rest, or of the other one, as a logarithm."""
    sigmas: float


def find_disputes(log_scale: Floats, sd: Floats) -> list[Dispute]:
    """Cues that contradict each other.

    A cue without which the others agree is wrong. Where that is true of two cues, or only two are left, nobody can tell which.

    Args:
        log_scale: (N,) logarithm of the scale by each cue alone.
        sd: (N,) one sigma of it.
    """
    left = np.arange(len(sd))
    sd = np.hypot(sd, RIG_SD)
    found = []
    while len(left) > 1 and np.abs(_against_rest(log_scale[left], sd[left])).max() > MOST_SIGMAS:
        without = [_spread(log_scale[np.delete(left, k)], sd[np.delete(left, k)]) for k in range(len(left))]
        first, second = np.argsort(without, kind="stable")[:2]
        explains_too = without[second] - without[first] < MOST_SIGMAS**2 and _agree(np.delete(left, second), log_scale, sd)
        if len(left) == 2 or explains_too:
            a, b = sorted((int(left[first]), int(left[second])), key=lambda cue: sd[cue])
            off = float(log_scale[a] - log_scale[b])
            found.append(Dispute(a, b, off, abs(off) / float(np.hypot(sd[a], sd[b]))))
            left = np.delete(left, [first, second])
            continue
        rest = np.delete(left, first)
        weight = sd[rest] ** -2.0
        off = float(log_scale[left[first]] - np.average(log_scale[rest], weights=weight))
        sigma = float(np.sqrt(sd[left[first]] ** 2 + 1 / weight.sum()))
        found.append(Dispute(int(left[first]), None, off, abs(off) / sigma))
        left = rest
    return found


def argue(cues: Sequence[CueFigures]) -> tuple[list[CueFigures], list[Finding]]:
    """The cues, each with those that it contradicts; and a doubt for each contradiction."""
    known = {
        number: (cue.own_scale, cue.own_sigma)
        for number, cue in enumerate(cues)
        if cue.own_scale is not None and cue.own_sigma is not None
    }
    telling = list(known)
    log_scale = np.log([known[number][0] for number in telling])
    sd = np.array([known[number][1] for number in telling])
    against: dict[int, list[int]] = {}
    findings = []
    disputes = find_disputes(log_scale, sd)
    accused = {telling[one] for dispute in disputes for one in (dispute.cue, dispute.other) if one is not None}
    for dispute in disputes:
        cue = telling[dispute.cue]
        if dispute.other is None:
            against[cue] = [number for number in telling if number not in accused]
            measured = cues[cue].stated_m * float(np.exp(-dispute.off))
            findings.append(doubt("scale_cue_contradicted", cue=cues[cue].cue, kind=cues[cue].kind,
                                  stated_m=cues[cue].stated_m, measured_m=measured, sigmas=dispute.sigmas))  # fmt: skip
            continue
        other = telling[dispute.other]
        against[cue], against[other] = [other], [cue]
        sigmas_percent = [float(100 * sd[number]) for number in (dispute.cue, dispute.other)]
        findings.append(doubt("scale_cues_disagree", cues=[cues[cue].cue, cues[other].cue],
                              kinds=[cues[cue].kind, cues[other].kind], sigmas=dispute.sigmas,
                              percent=100 * float(np.expm1(abs(dispute.off))), sigmas_percent=sigmas_percent))  # fmt: skip
    return [
        replace(cue, disagrees_with=tuple(cues[other].cue for other in against[number]) if number in against else None)
        for number, cue in enumerate(cues)
    ], findings


def _against_rest(log_scale: Floats, sd: Floats) -> Floats:
    """(N,) sigmas between each cue and the weighted mean of the others."""
    weight = sd**-2.0
    others = weight.sum() - weight
    mean = ((weight * log_scale).sum() - weight * log_scale) / others
    return np.asarray((log_scale - mean) / np.sqrt(sd**2 + 1 / others))


def _spread(log_scale: Floats, sd: Floats) -> float:
    """Chi-squared about the weighted mean."""
    weight = sd**-2.0
    return float((weight * (log_scale - np.average(log_scale, weights=weight)) ** 2).sum())


def _agree(rows: Ints, log_scale: Floats, sd: Floats) -> bool:
    """Whether these cues contradict nothing among them."""
    return len(rows) < 2 or bool(np.abs(_against_rest(log_scale[rows], sd[rows])).max() <= MOST_SIGMAS)
