"""The table of cameras: where each stands and looks, how certain that is, and what it saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from passerby.core.cameras import Camera
from passerby.core.colours import camera_colour
from passerby.interchange.calibration_json import CameraEntry
from passerby.report.contents import Contents
from passerby.report.html import Html, Section, element, join
from passerby.report.recommendations import Reported, reported_doubts
from passerby.report.seen import Seen
from passerby.report.tables import Cell, Column, data_table, number, text
from passerby.report.values import figure
from passerby.report.weak_points import RESIDUAL_PX, outstanding, own_sigmas_mm, residuals_px

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
"""Where nothing says more."""
LEAD = (
    "Metres; z is up, the ground is at z = 0. Heading: counter-clockwise from the x axis, seen from above. Tilt: below the "
    "horizon. Roll: clockwise, seen from behind the camera. Bold: stands out from the other cameras."
)


def camera_section(contents: Contents, seen: Seen) -> Section:
    """The table, one row a camera, in the rig's order."""
    columns, rows = camera_rows(contents, seen, weak_cameras(contents))
    return Section("cameras", "Cameras", LEAD, data_table("cameras-table", "Cameras", columns, rows))


def weak_cameras(contents: Contents) -> dict[str, frozenset[str]]:
    """By column, the cameras whose figure stands out there."""
    positions, residuals = outstanding(own_sigmas_mm(contents)), residuals_px(contents)
    return {
        "Position std": frozenset(positions),
        "Residual": frozenset(name for name in outstanding(residuals) if (residuals[name] or 0.0) > RESIDUAL_PX),
    }


def camera_rows(contents: Contents, seen: Seen, weak: Mapping[str, frozenset[str]]) -> tuple[list[Column], list[list[Cell]]]:
    """The columns that have anything to tell, and a row for each camera of the rig."""
    keys = [index for index, column in enumerate(COLUMNS) if _told(contents, column.title)]
    residuals, entries, rows = residuals_px(contents), contents.cameras, []
    doubts = reported_doubts(contents.document)
    for place, camera in enumerate(contents.rig):
        name = join(swatch(place), element("span", camera.name, class_="name"), _why(doubts, camera))
        cells = _row(seen, name, camera, weak, residuals[camera.name], entries[camera.name])
        rows.append([cells[index] for index in keys])
    return [COLUMNS[index] for index in keys], rows


def _told(contents: Contents, column: str) -> bool:
    """Whether a column has anything to tell: boxes, joints and clocks are not always there."""
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
    seen: Seen, head: Html, camera: Camera, weak: Mapping[str, frozenset[str]], residual_px: float | None, entry: CameraEntry
) -> list[Cell]:
    """All cells of one camera, the first with its name and more; dashes where it has no pose."""
    name = camera.name
    pose = camera.pose
    x, y, z = (None, None, None) if pose is None else entry.centre_m or pose.centre.tolist()
    heading, tilt, roll = (None, None, None) if pose is None else (pose.heading_deg, pose.tilt_deg, pose.roll_deg)
    return [
        text(head, name),
        number(x, 3),
        number(y, 3),
        number(z, 3),
        number(_first(entry.heading_deg, heading)),
        number(_first(entry.tilt_deg, tilt)),
        number(_first(entry.roll_deg, roll)),
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


def _first(written: float | None, otherwise: float | None) -> float | None:
    """What is written, or else what the pose makes it, for folders that an older Passerby wrote."""
    return otherwise if written is None else written


def _clock(entry: CameraEntry) -> Cell:
    """Offset and sigma of a camera's clock."""
    offset, sigma = entry.time_offset_s, entry.time_offset_sigma_s
    if offset is None:
        return number(None)
    near = element("small", f" ± {figure(sigma, 3)}") if sigma else None
    return Cell(join(figure(offset, 3), near), offset, numeric=True)


def swatch(place: int) -> Html:
    """A dot in the camera's colour."""
    return element("span", class_="swatch", style=f"background:{camera_colour(place)}", aria_hidden="true")


def _why(doubts: Sequence[Reported], camera: Camera) -> Html | None:
    """Why a camera has no pose; nothing for one that has."""
    if camera.pose is not None:
        return None
    about = (doubt.point.problem for doubt in doubts if camera.name in doubt.cameras)
    why = next(about, NO_POSE)
    return element("small", f"no pose: {why}", class_="why")
