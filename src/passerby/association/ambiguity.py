"""Test whether a camera's people fit the others' as well for another pose of the camera, or another time offset.

Where all people move alike, their tracks look the same after a turn, a shift or a delay: guards who pace around a square
together, a crowd on a moving walkway, teams that mirror each other. Then every pair of cameras has a second registration that
fits about as well as the first. Third cameras confirm the second as well as the first. The resulting rig fits all observations,
right or wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.association.graph import ViewGraph
from passerby.common.arrays import Floats
from passerby.findings.finding import Finding, doubt

AMBIGUOUS = 0.75
"""Ratio of the summed scores of the runners-up to those of a camera's registrations, above which the camera's pose is
ambiguous. In 30 ordinary simulated scenes (seeds 940002 to 940058, identities found) it is 0.51 at most, and where people move
alike 0.80 to 1.1 (hostile cases, seed 106000)."""


def ambiguity(graph: ViewGraph, n_cameras: int) -> Floats:
    """Compute (C,) the summed score of the runners-up of each camera's used registrations, as a share; NaN without any."""
    best, second = np.zeros(n_cameras), np.zeros(n_cameras)
    for edge in graph.edges:
        if edge.used and edge.guess is not None:
            for c in (edge.a, edge.b):
                best[c] += edge.guess.score
                second[c] += edge.runner_up * edge.guess.score
    return np.where(best > 0, second / np.where(best > 0, best, 1.0), np.nan)


def ambiguous_cameras(graph: ViewGraph, names: Sequence[str], limit: float = AMBIGUOUS) -> list[Finding]:
    """Return a doubt about the cameras whose pose or time offset is ambiguous; an empty list where there are none."""
    shares = dict(zip(names, ambiguity(graph, len(names)).tolist(), strict=True))
    alike = [name for name, share in shares.items() if share > limit]
    return [doubt("arrangement_ambiguous", *alike, runner_up=max(shares[name] for name in alike))] if alike else []
