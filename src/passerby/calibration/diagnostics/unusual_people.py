"""People who are far taller or shorter than most: the scale does not use them, and a notice says so."""

from __future__ import annotations

import numpy as np

from passerby.core.figures import PeopleFigures
from passerby.findings.finding import Finding, notice


def told_of_unusual(people: PeopleFigures | None) -> tuple[Finding, ...]:
    """A notice where the solver left people out of the scale: who they are, and how tall they and the others are by the rig."""
    if people is None or not people.unusual:
        return ()
    low, high = (float(one) for one in np.percentile([people.heights_m[str(who)] for who in people.unusual], (0, 100)))
    usual = float(np.median(list(people.heights_m.values())))
    identities = list(people.unusual)
    return (notice("people_unusual", identities=identities, low_m=low, high_m=high, usual_m=usual),)
