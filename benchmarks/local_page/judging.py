"""Which pictures are clicked in, and how far a rig is from the truth in scale and heading."""

from __future__ import annotations

import numpy as np

from passerby.calibration.alignment.lengths import measure_length
from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.page.geometry import measure_axis

ENDS_M = ((-2.0, -2.5, 0.0), (2.0, 2.5, 0.0))
"""Of the length, from the middle of the cameras, on the ground: both are in all pictures of the terrace."""


def ends_of(truth: Rig) -> Floats:
    """(2, 3) the two points of the world that are clicked."""
    middle = np.mean([camera.centre for camera in truth], axis=0) * [1, 1, 0]
    return np.asarray(middle + np.array(ENDS_M))


def best_views(rig: Rig, truth: Rig, ends: Floats) -> tuple[tuple[str, str], str]:
    """The two pictures for a length and the one for an axis with the smallest sigmas that the page states."""
    names = [camera.name for camera in rig.posed()]
    pairs = [(one, two) for one in names for two in names if one < two]

    def sigma(pair: tuple[str, str]) -> float:
        return measure_length(rig, {name: truth[name].project(ends) for name in pair}).sigma_m

    def heading(name: str) -> float:
        return measure_axis(rig, [(name, (float(u), float(v))) for u, v in truth[name].project(ends)]).heading_sigma_deg

    return min(pairs, key=sigma), min(names, key=heading)


def against(truth: Rig, ends: Floats, found: Rig) -> tuple[float, float]:
    """Scale (found over true, less one) and heading error in degrees, by the positions of the cameras.

    The world's origin is the first end, and its x axis runs through the second.
    """
    along = (ends[1] - ends[0])[:2] / np.linalg.norm(ends[1] - ends[0])
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]])
    names = [camera.name for camera in found.posed()]
    right = np.array([turn @ (truth[name].centre - ends[0])[:2] for name in names])
    ours = np.array([found[name].centre[:2] for name in names])
    a, b = right - right.mean(axis=0), ours - ours.mean(axis=0)
    angle = np.degrees(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return float(np.sqrt((b**2).sum() / (a**2).sum()) - 1), float(angle)
