"""The table of cameras: pose, uncertainty, and observations of each camera.

The module also makes the tables of estimated lenses: each parameter with its sigma, its prior, and the evidence that
determined it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from passerby.core.cameras import Camera
from passerby.core.colours import camera_colour
from passerby.core.lens_figures import LensFigures, LensParameter, field_of_view_deg, lens_parameters, names_in_words
from passerby.interchange.calibration_json import CameraEntry
from passerby.report.contents import Contents
from passerby.report.distances import RESIDUAL_PX, choose_sigmas_mm, outstanding, residuals_px
from passerby.report.recommendations import Reported, reported_doubts
from passerby.report.rendering import Section, section
from passerby.report.seen import Seen
from passerby.report.tables import MISSING, Cell, Column, Table, figure, list_names, number, share_cell, text
from passerby.solver.refined_lenses import KNOWN_FOCAL

COLUMNS = (
    Column("Camera", numeric=False),
    Column("x", "m"),
    Column("y", "m"),
    Column("Height", "m", hint="z of the camera centre above the ground"),
    Column("Heading", "°", hint="viewing direction, counter-clockwise from the x axis, seen from above"),
    Column("Tilt", "°", hint="below the horizon"),
    Column("Roll", "°", hint="about the viewing direction, clockwise as seen from behind the camera"),
    Column("Points std", "mm", hint="1 sigma of points that it and other cameras see where people walked, scale apart"),
    Column("Ground std", "mm", hint="1 sigma of positions on the ground by this camera alone, scale apart"),
    Column("Position std", "mm", hint="standard deviation (1 sigma)"),
    Column("Rotation std", "°", hint="standard deviation (1 sigma)"),
    Column("Residual", "px", hint="median reprojection error of its people"),
    Column("People", hint="different people seen"),
    Column("Boxes", hint="observations of whole people"),
    Column("Keypoints", hint="observations with keypoints"),
    Column("Time offset", "s", hint="its time at frame 1 on the clock of the rig, ± 1 sigma"),
)
NO_POSE = "Could not be connected to other cameras."
"""Reason for a missing pose if no problem concerns the camera."""
LENS_COLUMNS = (
    Column("Camera", numeric=False),
    Column("Focal length", "px"),
    Column("Field of view", "° across"),
    Column("Field of view", "° down"),
    Column("Principal point", "x, px"),
    Column("Principal point", "y, px"),
    Column("Distortion", "k1"),
    Column("From people", numeric=False, hint="numbers that depend on the people more than on what was known before"),
    Column("From the prior", numeric=False, hint="numbers that depend on what was known before more than on the people"),
)
DETAILS = (
    Column("Camera", numeric=False),
    Column("Parameter", numeric=False),
    Column("Estimate"),
    Column("Std", hint="standard deviation (1 sigma)"),
    Column("Prior", hint="what was known before anybody was seen"),
    Column("Prior std", hint="standard deviation (1 sigma)"),
    Column("Std by people alone", hint="standard deviation without the prior"),
    Column("From people", "%", hint="share of what is known that comes from the people rather than from the prior"),
    Column("Determined by", numeric=False),
)


def camera_section(contents: Contents, seen: Seen) -> Section:
    """Return the section with the table of cameras, one row per camera, in the rig's order."""
    columns, rows = camera_rows(contents, seen, weak_cameras(contents))
    table = Table(identifier="cameras-table", caption="Cameras", columns=columns, rows=rows)
    return section("cameras", "Cameras", table=table, site=False)


def weak_cameras(contents: Contents) -> dict[str, frozenset[str]]:
    """Return, by column, the cameras whose figure is conspicuously large."""
    positions, residuals = outstanding(choose_sigmas_mm(contents)), residuals_px(contents)
    return {
        "Position std": frozenset(positions),
        "Residual": frozenset(name for name in outstanding(residuals) if (residuals[name] or 0.0) > RESIDUAL_PX),
    }


def camera_rows(contents: Contents, seen: Seen, weak: Mapping[str, frozenset[str]]) -> tuple[list[Column], list[list[Cell]]]:
    """Return the columns that have values, and a row for each camera of the rig."""
    keys = [index for index, column in enumerate(COLUMNS) if _has_values(contents, column.title)]
    residuals, entries, rows = residuals_px(contents), contents.cameras, []
    doubts = reported_doubts(contents.document)
    for place, camera in enumerate(contents.rig):
        why = _explain_missing_pose(doubts, camera)
        head = text(camera.name, inner="name", colour=camera_colour(place), note=why, why=True)
        cells = _row(seen, head, camera, weak, residuals[camera.name], entries[camera.name])
        rows.append([cells[index] for index in keys])
    return [COLUMNS[index] for index in keys], rows


def _has_values(contents: Contents, column: str) -> bool:
    """Check whether a column has values: boxes, joints and clocks may be missing."""
    entries = contents.cameras.values()
    if column == "Keypoints":
        return any(entry.keypoints for entry in entries)
    if column == "Boxes":
        return any(entry.boxes for entry in entries) or not any(entry.keypoints for entry in entries)
    if column == "Points std":
        return any(entry.points_sigma_mm is not None for entry in entries)
    if column == "Ground std":
        return any(entry.ground_sigma_mm is not None for entry in entries)
    if column == "Time offset":
        return any(entry.time_offset_s is not None for entry in entries)
    return True


def _row(
    seen: Seen, head: Cell, camera: Camera, weak: Mapping[str, frozenset[str]], residual_px: float | None, entry: CameraEntry
) -> list[Cell]:
    """Return all cells of one camera, after `head` with its name; dashes if it has no pose."""
    name = camera.name
    pose = camera.pose
    x, y, z = (None, None, None) if pose is None else entry.centre_m or pose.centre.tolist()
    heading, tilt, roll = (None, None, None) if pose is None else (pose.heading_deg, pose.tilt_deg, pose.roll_deg)
    return [
        head,
        number(x, 3),
        number(y, 3),
        number(z, 3),
        number(_find_value(entry.heading_deg, heading)),
        number(_find_value(entry.tilt_deg, tilt)),
        number(_find_value(entry.roll_deg, roll)),
        number(entry.points_sigma_mm, 0),
        number(entry.ground_sigma_mm, 0),
        number(entry.position_sigma_mm, 0, kind="stands-out" if name in weak["Position std"] else ""),
        number(entry.orientation_sigma_deg, 2),
        number(residual_px, 1, kind="stands-out" if name in weak["Residual"] else ""),
        number(seen.people[name] if entry.people is None else entry.people, 0),
        number(entry.boxes, 0),
        number(entry.keypoints, 0),
        _clock(entry),
    ]


def _find_value(written: float | None, otherwise: float | None) -> float | None:
    """Return the written value, or else the one from the pose, for folders that an older version of Passerby wrote."""
    return otherwise if written is None else written


def _clock(entry: CameraEntry) -> Cell:
    """Return a cell with the offset and sigma of a camera's clock."""
    offset, sigma = entry.time_offset_s, entry.time_offset_sigma_s
    if offset is None:
        return number(None)
    return number(offset, 3, note=f" ± {figure(sigma, 3)}" if sigma else "")


def _explain_missing_pose(doubts: Sequence[Reported], camera: Camera) -> str:
    """Explain why a camera has no pose; empty for a camera with a pose."""
    if camera.pose is not None:
        return ""
    about = (doubt.point.problem for doubt in doubts if camera.name in doubt.cameras)
    return f"no pose: {next(about, NO_POSE)}"


def lens_section(contents: Contents) -> Section | None:
    """Return the section of estimated lenses, with a table by camera and one by parameter; None if no lens was estimated."""
    lenses = {name: parts for name, parts in contents.figures.lenses.items() if name in contents.rig.names}
    if not lenses:
        return None
    numbers = [(name, one) for name, parts in lenses.items() for one in lens_parameters(parts)]
    return section(
        "lenses", "Lenses", notes=_describe_weak_cameras(lenses),
        table=Table(
            identifier="lenses-table", caption="Lenses", columns=LENS_COLUMNS,
            rows=[_write_lens_row(contents, name, parts) for name, parts in lenses.items()],
        ),
        parameters=Table(
            identifier="lens-priors-table", caption="Parameters of the lenses", columns=DETAILS,
            rows=[_detail(name, one) for name, one in numbers],
        ),
    )  # fmt: skip


def _write_lens_row(contents: Contents, name: str, parts: LensFigures) -> list[Cell]:
    """Return the row of one camera. Parameters that were not estimated come from its intrinsics, without a sigma."""
    lens = contents.rig[name].lens
    across, down = field_of_view_deg(lens)
    by_name = {one.name: one for one in lens_parameters(parts)}
    k1 = float(lens.distortions[0]) if len(lens.distortions) else 0.0
    return [
        text(name, inner="name", colour=camera_colour(contents.rig.names.index(name))),
        _focal(by_name.get("focal length"), lens.focal),
        number(across, 0),
        number(down, 0),
        _estimate(by_name.get("principal point x"), float(lens.matrix[0, 2]), 0),
        _estimate(by_name.get("principal point y"), float(lens.matrix[1, 2]), 0),
        _estimate(by_name.get("distortion k1"), k1, 3),
        text(names_in_words([one for one in by_name.values() if one.people_share is not None and not one.by_prior]) or MISSING),
        text(names_in_words([one for one in by_name.values() if one.by_prior]) or MISSING),
    ]


def _focal(one: LensParameter | None, otherwise: float) -> Cell:
    """Return a cell with the focal length and its sigma in per cent; it stands out if the sigma exceeds `KNOWN_FOCAL`."""
    if one is None:
        return number(otherwise, 0, kind="faint")
    share = one.sigma / one.estimate
    return number(one.estimate, 0, kind="stands-out" if share > KNOWN_FOCAL else "", note=f" ± {100 * share:.1f} %")


def _estimate(one: LensParameter | None, otherwise: float, digits: int) -> Cell:
    """Return a cell with a parameter and its sigma; faint if it depends on its prior or was not estimated."""
    if one is None:
        return number(otherwise, digits, kind="faint")
    return number(one.estimate, digits, kind="faint" if one.by_prior else "", note=f" ± {figure(one.sigma, digits)}")


def _detail(name: str, one: LensParameter) -> list[Cell]:
    """Return the row of one parameter of one camera."""
    digits = 1 if one.unit else 3
    return [
        text(name),
        text(f"{one.name}, {one.unit}" if one.unit else one.name),
        number(one.estimate, digits),
        number(one.sigma, digits),
        number(one.prior_value, digits),
        number(one.prior_sigma, digits),
        number(one.people_sigma, digits),
        number(None) if one.people_share is None else share_cell(100 * one.people_share, 0),
        text(one.determined_by or MISSING),
    ]


def _describe_weak_cameras(lenses: dict[str, LensFigures]) -> list[str]:
    """Describe the weakly determined parameters, and the groups of cameras that share one lens."""
    out, numbers = [], {name: lens_parameters(parts) for name, parts in lenses.items()}
    poor = [name for name, all_of in numbers.items() if any(_is_weak_focal(one) for one in all_of)]
    if poor:
        out.append(
            f"Bold: the focal length of {list_names(poor)} is uncertain by more than {100 * KNOWN_FOCAL:.0f} %. State the "
            "field of view (hfov_deg), or record more people, near and far."
        )
    if any(one.by_prior for all_of in numbers.values() for one in all_of):
        out.append("Grey: people barely determine this number; it is close to what was known before.")
    groups: dict[str, list[str]] = {}
    for name, parts in lenses.items():
        if parts.group is not None:
            groups.setdefault(parts.group, []).append(name)
    out += [f"{list_names(names)} have one lens, as the scene file states." for names in groups.values() if len(names) > 1]
    return out


def _is_weak_focal(one: LensParameter) -> bool:
    """Check whether a parameter is a focal length whose sigma exceeds the share `KNOWN_FOCAL`."""
    return one.name == "focal length" and one.sigma > KNOWN_FOCAL * one.estimate
