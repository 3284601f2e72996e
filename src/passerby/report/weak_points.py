"""Where a calibration is weakest, and what would make it better: also where it has no problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.report.contents import Contents
from passerby.report.distances import distances_to_measure
from passerby.report.recommendations import Point, reported_doubts
from passerby.report.seen import Seen

SURE_SCALE = 0.01
"""Above a percent, measuring one distance with a tape is the cheapest gain there is."""
STANDS_OUT = 1.5
"""A camera whose figure is so many times the median is reported; cameras of one rig differ by a third without any fault."""
RESIDUAL_PX = 2.0
"""Residuals below are those of good boxes."""
VERTICAL_DEG = 1.0
FEW_SHARED = 0.25
"""Of what the rig's cameras share in the median."""


def weak_points(contents: Contents, seen: Seen) -> list[Point]:
    """What is weakest, the most important first; empty where nothing stands out or no camera has a pose.

    What the calibration's doubts are about already is left out.
    """
    if len(contents.rig.posed()) < 2:
        return []
    found = [*_scale(contents), *_vertical(contents), *_uncertain(contents), *_residual(contents), *_lonely(contents, seen)]
    known = {about for doubt in reported_doubts(contents.document) for about in (*doubt.cameras, *doubt.subjects)}
    return [Point(one.problem, one.remedy) for one in found if one.about not in known]


@dataclass(frozen=True)
class _Weak(Point):
    """A weak point, and the camera or the subject (as of `Kind`) that a doubt may be about already."""

    about: str


def outstanding(values: Mapping[str, float | None]) -> list[str]:
    """The cameras whose figure is `STANDS_OUT` times the median or more, the worst first."""
    known = {name: value for name, value in values.items() if value is not None}
    if len(known) < 3:
        return []
    limit = STANDS_OUT * float(np.median(list(known.values())))
    return sorted((name for name, value in known.items() if value > limit), key=lambda name: -known[name])


def own_sigmas_mm(contents: Contents) -> dict[str, float | None]:
    """By camera, its position's sigma within the rig where the solver tells it, else that in the world, millimetres."""
    shape = {one.name: one.shape_position_sigma_mm for one in contents.figures.cameras}
    posed = contents.rig.posed().names
    if all(shape.get(name) is not None for name in posed):
        return {name: shape[name] for name in posed}
    return {name: contents.cameras[name].position_sigma_mm for name in posed}


def residuals_px(contents: Contents) -> dict[str, float | None]:
    """By camera, how far its people are from where the rig has them, in the median, pixels."""
    solved = {one.name: one.median_residual_px for one in contents.figures.cameras}
    written = {name: entry.median_residual_px for name, entry in contents.cameras.items()}
    return {name: solved.get(name) if residual is None else residual for name, residual in written.items()}


def residual_px(contents: Contents, name: str) -> float | None:
    """The same of one camera."""
    written = contents.document.entry(name).median_residual_px
    solved = (one.median_residual_px for one in contents.figures.cameras if one.name == name)
    return next(solved, None) if written is None else written


def _scale(contents: Contents) -> list[_Weak]:
    """All lengths, where they are uncertain."""
    sigma = contents.figures.scale.relative_sigma
    if sigma is None or sigma < SURE_SCALE:
        return []
    best = distances_to_measure(contents, 1)[0]
    which = f"{best.first} to {best.second} ({best.metres:.1f} m)"
    told, state = (
        f"The scale is known to {100 * sigma:.1f} % only",
        "state it in the scene file: a table [[scale.distances]], as shown below the distances.",
    )
    if _by_people_alone(contents):
        remedy = f"Measure one distance with a tape, preferably {which}, and {state}"
        return [_Weak(f"{told}: it depends on the assumed height of people.", remedy, "scale")]
    return [_Weak(f"{told}.", f"Measure another long distance between two cameras, such as {which}, and {state}", "scale")]


def _by_people_alone(contents: Contents) -> bool:
    """Whether people's heights alone determined the scale."""
    return all(cue.kind in ("population", "segments") for cue in contents.figures.scale.cues if cue.share > 0)


def _vertical(contents: Contents) -> list[_Weak]:
    """The direction of up, where it is uncertain."""
    sigma = contents.figures.vertical_sigma_deg
    if sigma is None or sigma < VERTICAL_DEG:
        return []
    what = f"The up direction is known to {sigma:.1f}° only."
    return [_Weak(what, "Record people walking about, seen from head to feet.", "vertical")]


def _uncertain(contents: Contents) -> list[_Weak]:
    """The least certain camera, where one stands out."""
    sigmas = own_sigmas_mm(contents)
    worst = outstanding(sigmas)
    if not worst:
        return []
    usual = float(np.median([value for value in sigmas.values() if value is not None]))
    return [
        _Weak(
            f"{worst[0]} is the least certain camera: {sigmas[worst[0]]:.0f} mm within the rig; {usual:.0f} mm is typical "
            f"here.",
            f"Record more people in the view of {worst[0]}, nearer to it and where other cameras see them too.",
            worst[0],
        )
    ]


def _residual(contents: Contents) -> list[_Weak]:
    """The camera that the people fit worst, where one stands out."""
    found = {name: value for name, value in residuals_px(contents).items() if contents.rig[name].pose is not None}
    worst = [name for name in outstanding(found) if (found[name] or 0.0) > RESIDUAL_PX]
    if not worst:
        return []
    usual = float(np.median([value for value in found.values() if value is not None]))
    return [
        _Weak(
            f"{worst[0]} has the largest residuals: {found[worst[0]]:.1f} px (median); {usual:.1f} px is typical here.",
            f"See its residuals below; if they grow towards the border, check the intrinsics of {worst[0]}.",
            worst[0],
        )
    ]


def _lonely(contents: Contents, seen: Seen) -> list[_Weak]:
    """The camera that shares fewest sightings, where it hangs by a thread."""
    total: dict[str, int] = dict.fromkeys(contents.rig.posed().names, 0)
    for (first, second), shared in seen.shared.items():
        if first in total and second in total:
            total[first] += shared.sightings
            total[second] += shared.sightings
    usual, least = float(np.median(list(total.values()))), min(total, key=lambda name: total[name])
    if len(total) < 3 or usual == 0 or total[least] > FEW_SHARED * usual:
        return []
    return [
        _Weak(
            f"{least} shares few observations with other cameras: {total[least]}; {usual:.0f} is typical here.",
            f"Record people walking where the view of {least} overlaps with others.",
            least,
        )
    ]
