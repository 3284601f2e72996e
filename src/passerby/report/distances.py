"""Distances between the cameras, for checking with a tape, and their uncertainty.

The module also finds the weakest points of a calibration and their remedies, even if the calibration has no problem.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist

from passerby.core.cameras import Camera
from passerby.report.contents import Contents
from passerby.report.recommendations import Point, reported_doubts
from passerby.report.rendering import Section, section
from passerby.report.seen import Seen
from passerby.report.tables import Cell, Column, Table, number, text

CAPTION = "Distances between cameras in metres"
MATRIX_CAMERAS = 8
"""Most cameras of a matrix. More cameras give a list of pairs: a wider matrix cannot be read on a laptop."""
TAPE_M = 30.0
"""Range of tapes and cheap laser meters."""
MOST_TO_MEASURE, MOST_NEAREST = 100, 8
"""Most pairs of a site's cameras that are listed, and most neighbours that are listed with one camera."""
SURE_SCALE = 0.01
"""Relative sigma of the scale above which measuring one distance with a tape is the cheapest improvement."""
STANDS_OUT = 1.5
"""A camera whose figure exceeds this multiple of the median is reported; faultless cameras of one rig differ by a third."""
RESIDUAL_PX = 2.0
"""Residuals below this value are normal for good boxes."""
VERTICAL_DEG = 1.0
FEW_SHARED = 0.25
"""A camera shares few observations if their number is at most this share of the rig's median."""


@dataclass(frozen=True)
class Distance:
    """Distance between the centres of two cameras."""

    first: str
    second: str
    metres: float
    sigma_m: float | None
    """One sigma; None if the solver gives none."""


def distances_of(contents: Contents) -> list[Distance]:
    """Return the distances of all pairs of cameras with poses, in the rig's order.

    The sigmas are those of the solver, from the joint covariance of all poses including the scale. If the rig was scaled
    afterwards, they are scaled by the same factor.
    """
    cameras, solved = list(contents.rig.posed()), read_solved_distances(contents)
    return [_distance(a, b, solved) for index, a in enumerate(cameras) for b in cameras[index + 1 :]]


Solved = Mapping[tuple[str, str], tuple[float, float]]
"""By pair of cameras, the solver's distance and its sigma, metres."""


def read_solved_distances(contents: Contents) -> Solved:
    """Return the solver's distances that have sigmas, with their sigmas."""
    return {
        one.cameras: (one.metres, one.sigma_m)
        for one in contents.figures.distances
        if one.metres > 0 and one.sigma_m is not None
    }


def _distance(a: Camera, b: Camera, solved: Solved) -> Distance:
    """Return the distance between two cameras with poses."""
    metres = float(np.linalg.norm(a.centre - b.centre))
    told = solved.get((a.name, b.name)) or solved.get((b.name, a.name))
    return Distance(a.name, b.name, metres, None if told is None else told[1] * metres / told[0])


def best_to_measure(distances: list[Distance]) -> Distance:
    """Choose the pair whose measured distance constrains the scale best: the longest within the range of a tape.

    A tape has an error of centimetres at any length. If no pair is within its range, the shortest is chosen.
    """
    within = [one for one in distances if one.metres <= TAPE_M]
    return max(within, key=lambda one: one.metres) if within else min(distances, key=lambda one: one.metres)


def distances_to_measure(contents: Contents, most: int = MOST_TO_MEASURE) -> list[Distance]:
    """Return the pairs of a site's cameras whose measured distances constrain the scale best, as in `best_to_measure`."""
    cameras = list(contents.rig.posed())
    first, second = np.triu_indices(len(cameras), 1)
    metres = pdist(np.array([camera.centre for camera in cameras]).reshape(-1, 3))
    # Pairs beyond the tape's range follow those within it, the shortest first.
    best = np.argsort(np.where(metres <= TAPE_M, -metres, metres), kind="stable")[:most]
    solved = read_solved_distances(contents)
    return [_distance(cameras[a], cameras[b], solved) for a, b in zip(first[best].tolist(), second[best].tolist(), strict=True)]


def distances_from(own: Camera, others: Sequence[Camera], solved: Solved, most: int = MOST_NEAREST) -> list[Distance]:
    """Return the distances from a camera with a pose to its nearest neighbours."""
    others = [camera for camera in others if camera.name != own.name]
    away = np.linalg.norm(np.array([camera.centre for camera in others]).reshape(-1, 3) - own.centre, axis=1)
    return [_distance(own, others[row], solved) for row in np.argsort(away, kind="stable")[:most].tolist()]


def distances_section(contents: Contents) -> Section:
    """Return the section with all distances and an example of how to state a measured one."""
    found = distances_of(contents)
    matrix = len(contents.rig.posed()) <= MATRIX_CAMERAS
    return _section(found, _matrix(contents, found) if matrix else distances_table("distances-table", found), site=False)


def _section(found: list[Distance], table: Table, *, site: bool) -> Section:
    """Return the section with a table of distances and an example of how to state a measured one."""
    return section("distances", "Distances", table=table if found else None, example=_advice(found) if found else "", site=site)


def _advice(found: list[Distance]) -> str:
    """Write the lines of a scene file that state a measured distance."""
    longest = best_to_measure(found)
    # Names are quoted as TOML requires; the user enters the measured value.
    names = ", ".join('"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"' for name in (longest.first, longest.second))
    return (
        f"[[scale.distances]]\nbetween = [{names}]\nmetres = {longest.metres:.2f}  # replace by your measurement\nsd_m = 0.02"
    )


def _matrix(contents: Contents, found: list[Distance]) -> Table:
    """Return the matrix of distances between all cameras."""
    names = contents.rig.posed().names
    by_pair = {(one.first, one.second): one for one in found} | {(one.second, one.first): one for one in found}
    columns = [Column("Camera", numeric=False), *(Column(name, "m") for name in names)]
    rows = [[text(row), *(_matrix_cell(by_pair.get((row, column))) for column in names)] for row in names]
    return Table(identifier="distances-table", caption=CAPTION, columns=columns, rows=rows, sortable=False)


def _matrix_cell(one: Distance | None) -> Cell:
    """Return a cell with a distance and its sigma; a dot on the diagonal."""
    if one is None:
        return text("·", "", kind="faint")
    return number(one.metres, 2, note="" if one.sigma_m is None else f" ± {_sigma(one.sigma_m)}")


def _sigma(metres: float) -> str:
    """Write a sigma to the centimetre; below one centimetre, to the millimetre."""
    return f"{metres:.2f}" if metres >= 0.01 else f"{metres:.3f}"


def site_distances_section(contents: Contents) -> Section:
    """Return the section with the distances of a site that are worth measuring."""
    found = distances_to_measure(contents)
    return _section(found, distances_table("distances-table", found), site=True)


def distances_table(identifier: str, found: Sequence[Distance], *, copy: bool = True) -> Table:
    """Return a table with a row for each pair."""
    columns = [
        Column("Camera", numeric=False),
        Column("to", numeric=False),
        Column("Distance", "m"),
        Column("1 sigma", "m"),
    ]
    rows = [[text(one.first), text(one.second), number(one.metres, 2), number(one.sigma_m, 3)] for one in found]
    return Table(identifier=identifier, caption=CAPTION, columns=columns, rows=rows, copy=copy)


def weak_points(contents: Contents, seen: Seen) -> list[Point]:
    """Return the weakest points, the most important first; empty if none stands out or fewer than two cameras have a pose.

    Points about cameras or subjects of the calibration's doubts are left out.
    """
    if len(contents.rig.posed()) < 2:
        return []
    found = [
        *_scale(contents),
        *_vertical(contents),
        *_find_uncertain_camera(contents),
        *_residual(contents),
        *_lonely(contents, seen),
    ]
    known = {about for doubt in reported_doubts(contents.document) for about in (*doubt.cameras, *doubt.subjects)}
    return [Point(one.problem, one.remedy) for one in found if one.about not in known]


@dataclass(frozen=True)
class _Weak(Point):
    """A weak point, and its camera or subject (as in `Kind`), which a doubt may already concern."""

    about: str


def outstanding(values: Mapping[str, float | None]) -> list[str]:
    """Return the cameras whose figure exceeds `STANDS_OUT` times the median, the worst first."""
    known = {name: value for name, value in values.items() if value is not None}
    if len(known) < 3:
        return []
    limit = STANDS_OUT * float(np.median(list(known.values())))
    return sorted((name for name, value in known.items() if value > limit), key=lambda name: -known[name])


def choose_sigmas_mm(contents: Contents) -> dict[str, float | None]:
    """Return, by camera, the sigma of its position within the rig if the solver gives it, else in the world, millimetres."""
    shape = {one.name: one.shape_position_sigma_mm for one in contents.figures.cameras}
    posed = contents.rig.posed().names
    if all(shape.get(name) is not None for name in posed):
        return {name: shape[name] for name in posed}
    return {name: contents.cameras[name].position_sigma_mm for name in posed}


def residuals_px(contents: Contents) -> dict[str, float | None]:
    """Return, by camera, the median residual of its people, pixels."""
    solved = {one.name: one.median_residual_px for one in contents.figures.cameras}
    written = {name: entry.median_residual_px for name, entry in contents.cameras.items()}
    return {name: solved.get(name) if residual is None else residual for name, residual in written.items()}


def residual_px(contents: Contents, name: str) -> float | None:
    """Return the median residual of the people in one camera, pixels."""
    written = contents.document.entry(name).median_residual_px
    solved = (one.median_residual_px for one in contents.figures.cameras if one.name == name)
    return next(solved, None) if written is None else written


def _scale(contents: Contents) -> list[_Weak]:
    """Return the scale as a weak point if it is uncertain."""
    sigma = contents.figures.scale.relative_sigma
    if sigma is None or sigma < SURE_SCALE:
        return []
    best = distances_to_measure(contents, 1)[0]
    which = f"{best.first} to {best.second} ({best.metres:.1f} m)"
    told, state = (
        f"The scale is known to {100 * sigma:.1f} % only",
        "state it in the scene file: a table [[scale.distances]], as shown below the distances.",
    )
    if _uses_heights_only(contents):
        remedy = f"Measure one distance with a tape, preferably {which}, and {state}"
        return [_Weak(f"{told}: it depends on the assumed height of people.", remedy, "scale")]
    return [_Weak(f"{told}.", f"Measure another long distance between two cameras, such as {which}, and {state}", "scale")]


def _uses_heights_only(contents: Contents) -> bool:
    """Check whether people's heights alone determined the scale."""
    return all(cue.kind in ("population", "segments") for cue in contents.figures.scale.cues if cue.share > 0)


def _vertical(contents: Contents) -> list[_Weak]:
    """Return the up direction as a weak point if it is uncertain."""
    sigma = contents.figures.vertical_sigma_deg
    if sigma is None or sigma < VERTICAL_DEG:
        return []
    what = f"The up direction is known to {sigma:.1f}° only."
    return [_Weak(what, "Record people walking about, seen from head to feet.", "vertical")]


def _find_uncertain_camera(contents: Contents) -> list[_Weak]:
    """Return the least certain camera as a weak point if it stands out."""
    sigmas = choose_sigmas_mm(contents)
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
    """Return the camera with the largest residuals as a weak point if it stands out."""
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
    """Return the camera that shares the fewest sightings as a weak point if it shares few."""
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
