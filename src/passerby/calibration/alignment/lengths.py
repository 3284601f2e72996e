"""Measurement of lengths that are marked in cameras of a rig, and their comparison with known lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.calibration.alignment.places import CLICK_SD_PX, position_sds
from passerby.common.arrays import Floats
from passerby.common.errors import PasserbyError
from passerby.core.cameras import Rig
from passerby.core.figures import CheckedLength
from passerby.findings.finding import Finding, doubt, notice
from passerby.scene.scale_tables import CheckTable

OFF_SIGMAS = 3.0
"""A check length that is off by more sigmas is a doubt, so that the rig is not accepted: one in 370 by chance."""

Pixel = tuple[float, float]


@dataclass(frozen=True)
class Measured:
    """A length that is marked in two or more cameras, as the rig measures it."""

    metres: float
    sigma_m: float
    """One sigma by the clicks alone, without the uncertainty of the rig's scale."""
    residual_px: float
    """Largest distance between a mark and the projection of the triangulated end, pixels."""


def measure_length(rig: Rig, points: Mapping[str, Sequence[Pixel]]) -> Measured:
    """Measure the length between two ends, each marked in the same two or more cameras.

    Raises `InputError` if the marks cannot be triangulated: fewer than two cameras, parallel rays, points behind a camera.
    """
    marks = {name: np.asarray(ends, dtype=np.float64).reshape(2, 2) for name, ends in points.items()}
    ends = rig.triangulate(marks)
    metres = float(np.linalg.norm(ends[1] - ends[0]))
    variance = 0.0
    for name in marks:
        for row in range(2):
            for axis in range(2):
                moved = {one: values.copy() for one, values in marks.items()}
                moved[name][row, axis] += 0.5
                there = rig.triangulate(moved)
                slope = (float(np.linalg.norm(there[1] - there[0])) - metres) / 0.5
                variance += (slope * CLICK_SD_PX) ** 2
    residual = max(float(np.linalg.norm(rig[name].project(ends) - values, axis=1).max()) for name, values in marks.items())
    return Measured(metres, float(np.sqrt(variance)), residual)


def check_lengths(checks: Sequence[CheckTable], rig: Rig, scale_sigma: float | None) -> tuple[CheckedLength, ...]:
    """Measure known lengths by a finished rig.

    Args:
        checks: the check lengths of the scene file.
        rig: the rig, in the frame and the scale in which it is written.
        scale_sigma: relative one sigma of all its lengths; None if nothing fixes the scale.
    """
    own = position_sds(rig, True)
    found = []
    for number, check in enumerate(checks, start=1):
        cameras = tuple(check.points or check.between or ())
        posed = [name for name in cameras if name in own]
        entry = CheckedLength(number=number, cameras=cameras, stated_m=check.metres, measured_m=None)
        try:
            measured = _measured(check, rig, posed)
        except PasserbyError:
            measured = None
        if measured is not None:
            cameras_m = float(np.sqrt(np.mean([own[name] ** 2 for name in posed])))
            entry = replace(entry, measured_m=measured.metres)
            if scale_sigma is not None:
                parts = (check.sd_m, measured.sigma_m, np.sqrt(2.0) * cameras_m, scale_sigma * measured.metres)
                entry = replace(entry, sigma_m=float(np.linalg.norm(parts)))
        found.append(entry)
    return tuple(found)


def findings_of_checks(checks: Sequence[CheckedLength] | None) -> tuple[Finding, ...]:
    """Return a doubt for each check length that is off by more than `OFF_SIGMAS`, and a notice for each unmeasurable one."""
    found = []
    for one in checks or ():
        if one.measured_m is None:
            found.append(notice("check_length_unmeasured", *one.cameras, number=one.number))
        elif one.sigma_m is not None and abs(one.measured_m - one.stated_m) > OFF_SIGMAS * one.sigma_m:
            values = {"number": one.number, "stated_m": one.stated_m, "measured_m": one.measured_m, "sigma_m": one.sigma_m}
            found.append(doubt("check_length_off", *one.cameras, **values))
    return tuple(found)


def _measured(check: CheckTable, rig: Rig, posed: Sequence[str]) -> Measured | None:
    """Measure a check length by the cameras with poses; None for fewer than two of them."""
    if len(posed) < 2:
        return None
    if check.points is not None:
        return measure_length(rig, {name: check.points[name] for name in posed})
    centres: list[Floats] = [rig[name].centre for name in posed]
    return Measured(float(np.linalg.norm(centres[1] - centres[0])), 0.0, 0.0)
