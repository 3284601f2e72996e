"""Would a camera's people fit the others' as well elsewhere, or at another time?

People who all move alike look the same after a turn, a shift or a wait: guards who pace around a square together, a
crowd on a moving walkway, teams that mirror each other. Then every pair of cameras has a second registration that fits about as
well as the first, third cameras confirm the one as well as the other, and the rig that comes out fits all observations,
right or wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.association.graph import ViewGraph
from passerby.common.arrays import Floats
from passerby.findings.finding import Finding, doubt

AMBIGUOUS = 0.75
"""Share of the score of a camera's registrations that their runners-up have together, above which it may stand
elsewhere. In 30 ordinary simulated scenes (seeds 940002 to 940058, identities found) it is 0.51 at most, and where
people move alike 0.80 to 1.1 (hostile cases, seed 106000)."""


def ambiguity(graph: ViewGraph, n_cameras: int) -> Floats:
    """(C,) what the runners-up of a camera's used registrations score together, as a share of these; NaN without any."""
    best, second = np.zeros(n_cameras), np.zeros(n_cameras)
    for edge in graph.edges:
        if edge.used and edge.guess is not None:
            for c in (edge.a, edge.b):
                best[c] += edge.guess.score
                second[c] += edge.runner_up * edge.guess.score
    return np.where(best > 0, second / np.where(best > 0, best, 1.0), np.nan)


def ambiguous_cameras(graph: ViewGraph, names: Sequence[str], limit: float = AMBIGUOUS) -> list[Finding]:
    """A doubt about the cameras that might as well stand elsewhere or show another time; none where there is no such camera."""
    shares = dict(zip(names, ambiguity(graph, len(names)).tolist(), strict=True))
    alike = [name for name, share in shares.items() if share > limit]
    return [doubt("arrangement_ambiguous", *alike, runner_up=max(shares[name] for name in alike))] if alike else []
