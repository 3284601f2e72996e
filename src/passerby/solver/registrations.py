"""Comparison of registrations of pairs of cameras with a rig, to find those that it contradicts.

A registration comes from the ground tracks of two cameras over the whole recording, before any person is identified in both,
and was tested against alternatives. Identities follow from registrations. Some people of distant cameras are joined by chance.
Where two parts of a rig share few people, as on both sides of a door, these may outnumber the people who really pass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.findings.finding import Finding, doubt
from passerby.geometry.rotations import angle_between
from passerby.geometry.two_view import PairHypothesis

MOST_TURNED = np.deg2rad(25.0)
MOST_SHIFTED_M, MOST_SHIFTED = 2.0, 0.3
"""A rig contradicts a registration if their relative rotations differ by more than `MOST_TURNED`, or their translations by more
than these metres plus this share of the cameras' distance. 64 registrations of simulated corridors and halls (50 cameras, seed
801) were wrong by at most 9 degrees, 1.5 m and a share of 0.14; rigs that contradict them are wrong by tens of degrees or
metres."""


def contradicted(hypotheses: Sequence[PairHypothesis], R: Floats, centre: Floats) -> list[PairHypothesis]:
    """Return the registrations by tracks that a rig contradicts, independent of its scale.

    Args:
        hypotheses: hypotheses of pairs of cameras; only those of route `tracks` are used.
        R: (C, 3, 3) orientations, world to camera.
        centre: (C, 3) positions of the cameras.
    """
    known = [h for h in hypotheses if h.route == "tracks"]
    if not known:
        return []
    a, b = np.array([h.a for h in known]), np.array([h.b for h in known])
    R_ba, t_ba = np.array([h.R_ba for h in known]), np.array([h.t_ba for h in known])
    R_here = R[b] @ R[a].transpose(0, 2, 1)
    t_here = (R[b] @ (centre[a] - centre[b])[:, :, None])[:, :, 0]
    apart = np.linalg.norm(t_ba, axis=1)
    scale = float(np.median(np.linalg.norm(t_here, axis=1) / np.maximum(apart, 1e-9)))
    shifted = np.linalg.norm(t_here / max(scale, 1e-9) - t_ba, axis=1)
    wrong = (angle_between(R_here, R_ba) > MOST_TURNED) | (shifted > MOST_SHIFTED_M + MOST_SHIFTED * apart)
    return [known[k] for k in np.flatnonzero(wrong)]


def doubts_about_registrations(rig: Rig, hypotheses: Sequence[PairHypothesis], R: Floats, centre: Floats) -> list[Finding]:
    """Return a doubt for each pair whose registration a rig contradicts, for cameras with stated lenses only.

    With a first guess of a lens, a registration may be more wrong than a rig that contradicts it.
    """
    found = [(rig.cameras[h.a], rig.cameras[h.b]) for h in contradicted(hypotheses, R, centre)]
    return [
        doubt("arrangement_ambiguous", a.name, b.name) for a, b in found if not (a.lens.uncalibrated or b.lens.uncalibrated)
    ]
