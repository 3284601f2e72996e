"""Do the stated heights of single people agree with each other?

In the adjustment a wrong height bends the rig a little and makes its person's boxes outliers, so that its residual stays
small. Seen by one and the same rig, though, people's heights are to each other as they are: whoever's stated height is to the
height of the boxes as nobody else's is has been given somebody else's height.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.scale_cues import PersonHeight
from passerby.findings.finding import Finding, doubt
from passerby.people.box_heights import BOX_SD, heights_by_boxes

MOST_SIGMAS = 4.0
"""As of a scale cue that contradicts the rest."""


def contradicted_heights(rig: Rig, observations: Observations, known: Sequence[PersonHeight]) -> list[Finding]:
    """A doubt for each stated height that contradicts the other stated ones; of two that differ, for both.

    Args:
        rig: cameras with poses, z up, the ground at z = 0.
        observations: people with their identities.
        known: one height for each person.
    """
    seen = heights_by_boxes(rig, observations)
    known = [one for one in known if one.identity in seen]
    if len(known) < 2:
        return []
    ratio = np.log([one.metres / seen[one.identity] for one in known])
    sd = np.array([np.hypot(one.sd_m / one.metres, BOX_SD) for one in known])
    findings = []
    for i, one in enumerate(known):
        others = np.delete(ratio, i)
        spread = float(np.hypot(sd[i], np.mean(np.delete(sd, i)) / np.sqrt(len(others))))
        sigmas = abs(float(ratio[i] - np.median(others))) / spread
        if sigmas > MOST_SIGMAS:
            cue = f"height of person {one.identity}{f', {one.place}' if one.place else ''}"
            measured = seen[one.identity] * float(np.exp(np.median(others)))
            findings.append(doubt("scale_cue_contradicted", cue=cue, stated_m=one.metres, measured_m=measured, sigmas=sigmas))
    return findings
