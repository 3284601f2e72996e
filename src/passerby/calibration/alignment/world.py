"""Alignment of a rig with the user's world frame, which a camera, known points or known positions of cameras define."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from passerby.calibration.alignment.places import CLICK_SD_PX, angle_sd, camera_of, local_places, position_sds, visible_points
from passerby.calibration.alignment.residuals import (
    WEAK_SCALE,
    doubts,
    gross_points,
    ground_note,
    point_residuals,
    position_residuals,
)
from passerby.calibration.alignment.sigmas import in_known_world
from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Pose, Rig
from passerby.core.scale_cues import KnownPoint, KnownPosition, find_wrong_unit
from passerby.findings.finding import Finding, notice
from passerby.findings.texts import texts_of
from passerby.geometry.alignment import KnownPositions, Places, SeenPoints, WorldFit, fit_world, fits_mirrored
from passerby.geometry.rotations import Similarity, exp_rotation, log_rotation

STRAIGHT_DOWN = 0.1
"""Sine of 6 degrees: a camera whose axis is nearer to the vertical has no usable direction on the ground."""
RIG_SCALE_SD = 0.05
"""Relative standard deviation of the scale of a rig by people's heights. It decides whether a unit is wrong, and which of three
placements is wrong."""
WEAK_TURN_DEG = 15.0
"""Standard deviation of the heading above which it counts as unknown."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """A rig in its new frame."""

    rig: Rig
    motion: Similarity
    """Similarity from the old world to the new one."""
    figures: dict[str, Any]
    """JSON-ready figures: the source of the frame, the motion, its sigmas, the residuals."""
    diagnostics: tuple[Finding, ...] = ()
    """Findings about the known places and the fit."""

    def __repr__(self) -> str:
        left = f", {self.figures['left_out']} left out" if self.figures.get("left_out") else ""
        return f"Aligned(by {self.figures['by']}, {len(self.rig)} cameras{left})"

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings as sentences, with the remedies."""
        return texts_of(self.diagnostics)

    @property
    def residuals(self) -> list[dict[str, Any]]:
        """One row for each sighting of a point or each camera with a known position; empty where a camera sets the frame."""
        rows: list[dict[str, Any]] = self.figures.get("residuals", [])
        return rows


def align_to_camera(rig: Rig, name: str, towards: str | None = None, *, turn: bool = True) -> Aligned:
    """Move the origin of a rig to the ground below a camera, and turn x to its viewing direction or towards another camera.

    Without `turn` the rig keeps its heading.

    Raises:
        InputError: the rig does not have the camera.
        EvidenceError: the camera has no pose, or no direction on the ground.
    """
    pose = _posed(rig, name)
    if not turn:
        shift = Similarity(1.0, np.eye(3), -np.array([*pose.centre[:2], 0.0]))
        return aligned_by(rig, shift, f"camera {name}", {})
    if towards is None:
        along, remedy = pose.R_cw[2, :2], "name another camera as `towards`"
        if np.linalg.norm(along) < STRAIGHT_DOWN:
            raise EvidenceError(f"camera {name} looks straight down, so it has no heading on the ground: {remedy}")
    else:
        along = _posed(rig, towards).centre[:2] - pose.centre[:2]
        if np.linalg.norm(along) < 0.01:
            raise EvidenceError(f"camera {towards} is where camera {name} is: name one at another position")
    R = exp_rotation(np.array([0.0, 0.0, -np.arctan2(along[1], along[0])]))
    motion = Similarity(1.0, R, -R @ np.array([*pose.centre[:2], 0.0]))
    how = f"camera {name}" + ("" if towards is None else f" towards {towards}")
    return aligned_by(rig, motion, how, {})


def align_to_points(
    rig: Rig, points: Sequence[KnownPoint], *, with_scale: bool = False, tilt: bool = False, source: str = "points"
) -> Aligned:
    """Align a rig with points of known coordinates.

    The ground and the vertical stay as they are, unless `tilt`. Lengths are kept, unless `with_scale`. The z of a point
    gives the end of the ray to it. Sightings by cameras without a pose are left out and reported.

    Raises:
        InputError: the rig lacks a camera, a pixel is outside its picture, or the coordinates are left-handed.
        EvidenceError: the points are too few, or too close together, to determine the fit.
    """
    rows, notes = visible_points(rig, points)
    names = [(point.name, camera.name) for point, camera, _ in rows]
    known = list(dict.fromkeys(point.name for point, _, _ in rows))
    _enough(len(known), [point.xyz for point, _, _ in rows], with_scale, tilt, "point", notes)
    own = position_sds(rig, with_scale, tilt)
    places = SeenPoints(
        centre=np.array([camera.centre for _, camera, _ in rows]),
        ray=np.array([ray for _, _, ray in rows]),
        target=np.array([point.xyz for point, _, _ in rows]),
        group=np.array([known.index(name) for name, _ in names], dtype=np.int64),
        sd=np.array([np.hypot(point.sd_m, own[camera.name]) for point, camera, _ in rows]),
        angle_sd=np.array([np.hypot(CLICK_SD_PX / camera.lens.focal, angle_sd(camera)) for _, camera, _ in rows]),
    )
    _refuse_wrong_unit(rig, places, tilt, "points", source)
    fit = _fitted(places, with_scale, tilt, "points")
    aligned = _in_world(
        aligned_by(rig, fit.motion, source, _fit_figures(fit, with_scale, tilt), tilt=tilt), fit, with_scale, tilt
    )
    residuals = point_residuals(aligned.rig, rows, places, fit)
    notes += gross_points(residuals) + doubts(places, fit, with_scale, tilt, "points", len(known))
    return with_residuals(aligned, residuals, notes)


def align_to_positions(
    rig: Rig, positions: Sequence[KnownPosition], *, geodetic: bool = False, with_scale: bool = False, tilt: bool = False,
    source: str = "positions",
) -> Aligned:  # fmt: skip
    """Align a rig with known positions of its cameras.

    Geodetic positions become metres east (x), north (y) and up (z) of their mean. The rig's metadata gets the geodetic origin,
    with the altitude of the ground. All else is as in `align_to_points`.
    """
    notes, rows = list[Finding](), []
    for known in positions:
        camera_of(rig, known.camera)
        if rig[known.camera].pose is None:
            notes.append(notice("position_without_pose", known.camera))
        else:
            rows.append(known)
    cameras = [rig[known.camera] for known in rows]
    place = np.array([known.place for known in rows]).reshape(-1, 3)
    if tilt and np.isnan(place[:, 2]).any():
        lacking = rows[int(np.flatnonzero(np.isnan(place[:, 2]))[0])].camera
        raise InputError(f"{source}: camera {lacking} has no height: `tilt` needs all of them; add it, or leave `tilt` out")
    origin = None
    target = np.where(np.isfinite(place), place, 0.0)
    if geodetic and len(rows):
        target, origin = local_places(place, cameras)
    _enough(len(rows), list(target), with_scale, tilt, "camera with a known position", notes)
    own = position_sds(rig, with_scale, tilt)
    places = KnownPositions(
        centre=np.array([camera.centre for camera in cameras]),
        target=target,
        sd=np.array([np.hypot(known.sd_m, own[known.camera]) for known in rows]),
        heights=tilt,
    )
    if not geodetic:
        _refuse_wrong_unit(rig, places, tilt, "positions", source)
    fit = _fitted(places, with_scale, tilt, "positions")
    metadata = {} if origin is None else {"geodetic_origin": f"{origin[0]:.9f} {origin[1]:.9f} {origin[2]:.3f}"}
    told = _fit_figures(fit, with_scale, tilt) | ({} if origin is None else {"geodetic_origin": origin.tolist()})
    aligned = _in_world(aligned_by(rig, fit.motion, source, told, metadata, tilt=tilt), fit, with_scale, tilt)
    residuals = position_residuals(aligned.rig, rows, target, np.isfinite(place[:, 2]), fit)
    notes += [notice("position_off", row["camera"], off_m=row["off_m"]) for row in residuals if not row["used"]]
    return with_residuals(aligned, residuals, notes + doubts(places, fit, with_scale, tilt, "positions", len(rows)))


def _in_world(aligned: Aligned, fit: WorldFit, with_scale: bool, tilt: bool) -> Aligned:
    """Replace the sigmas of the cameras by those in the world of the known places."""
    return replace(aligned, rig=in_known_world(aligned.rig, fit.covariance, fit.centre, with_scale=with_scale, tilt=tilt))


def _posed(rig: Rig, name: str) -> Pose:
    """Return a camera's pose. Raises `InputError` without such a camera, `EvidenceError` if it has no pose."""
    pose = camera_of(rig, name).pose
    if pose is None:
        others = ", ".join(rig.posed().names)
        raise EvidenceError(f"camera {name} has no pose: " + (f"choose one of {others}" if others else "nor has any other"))
    return pose


def _enough(count: int, targets: Sequence[Floats], with_scale: bool, tilt: bool, what: str, notes: Sequence[Finding]) -> None:
    """Raise `EvidenceError` for too few places, or places on one spot."""
    least = 3 if tilt else 2
    why = f" ({'; '.join(texts_of(notes))})" if notes else ""
    if count < least:
        wanted = "the up direction" if tilt else "the heading and the scale" if with_scale else "the heading"
        some = what.replace("camera ", "cameras ").replace("position", "positions") if what != "point" else "points"
        raise EvidenceError(f"{count} {what if count == 1 else some} cannot fix {wanted}{why}: give {least} or more")
    spread = float(np.ptp(np.array(targets)[:, : 3 if tilt else 2], axis=0).max())
    if spread < 0.01:
        raise EvidenceError(
            f"all known coordinates lie within {1000 * spread:.0f} mm: give points or positions that are metres apart"
        )


def _refuse_wrong_unit(rig: Rig, places: Places, tilt: bool, what: str, source: str) -> None:
    """Raise `InputError` if people's heights show that the coordinates are not in metres.

    A rig without a verdict does not come from people: its scale is not checked.
    """
    if rig.verdict is None:
        return
    try:
        free = fit_world(places, with_scale=True, tilt=tilt)
    except EvidenceError:
        return
    if free.scale_sigma > WEAK_SCALE:
        return
    wrong = find_wrong_unit(float(np.log(free.motion.scale)), float(np.hypot(RIG_SCALE_SD, free.scale_sigma)))
    if wrong is not None:
        raise InputError(f"{source}: the distances between the {what} are {wrong.in_words}")


def _fitted(places: Places, with_scale: bool, tilt: bool, what: str) -> WorldFit:
    """Fit the motion. Raises `InputError` for left-handed coordinates, `EvidenceError` if the places do not determine it."""
    try:
        fit = fit_world(places, with_scale=with_scale, tilt=tilt)
    except EvidenceError:
        if tilt:
            raise EvidenceError(_on_a_line(what)) from None
        raise EvidenceError(
            f"no two of the {what} are apart in the rig: check that each belongs to its camera, and that points lie "
            "below the horizon"
        ) from None
    if fits_mirrored(places, fit, with_scale=with_scale, tilt=tilt):
        raise InputError(
            f"the {what} fit only as a mirror image: the coordinates are left-handed (seen from above, y must be 90 degrees "
            "counter-clockwise of x): exchange x and y, or change the sign of one"
        )
    turn = float(np.degrees(fit.turn_sigma))
    if turn > WEAK_TURN_DEG and tilt:
        raise EvidenceError(_on_a_line(what))
    if turn > WEAK_TURN_DEG:
        known = f"the heading to {turn:.0f} degrees only" if turn < 90 else "no heading"
        raise EvidenceError(f"the {what} fix {known}: give {what} that are further apart, or more accurate")
    if fit.scale_sigma > WEAK_SCALE:
        known = f"the scale to {100 * fit.scale_sigma:.0f} % only" if fit.scale_sigma < 1 else "no scale"
        remedy = f"give {what} that are further apart" + (", in two cameras or more" if what == "points" else "")
        raise EvidenceError(f"the {what} fix {known}: {remedy}, or leave `scale` out")
    return fit


def _on_a_line(what: str) -> str:
    """Return the error message for places on one line, which do not determine the turn about it."""
    return (
        f"the {what} lie on one line within their accuracy, so the tilt about this line is not determined: give "
        f"{what} off the line, or leave `tilt` out"
    )


def _fit_figures(fit: WorldFit, with_scale: bool, tilt: bool) -> dict[str, Any]:
    """Return the figures of a fit, JSON-ready."""
    return {
        "scale_fitted": with_scale,
        "tilt_fitted": tilt,
        "used": int(np.count_nonzero(fit.used)),
        "left_out": int(np.count_nonzero(~fit.used)),
        "turn_sigma_deg": float(np.degrees(fit.turn_sigma)),
        "place_sigma_mm": 1000 * fit.place_sigma,
        "scale_sigma": fit.scale_sigma if with_scale else None,
        "residuals_over_stated": fit.noise,
    }


def aligned_by(
    rig: Rig, motion: Similarity, how: str, figures: dict[str, Any], metadata: Mapping[str, str] | None = None, *,
    tilt: bool = False,
) -> Aligned:  # fmt: skip
    """Move a rig, and return it with its metadata and the figures of the motion."""
    replaced = {"world", "geodetic_origin"} | ({"up"} if tilt else set())
    kept = {key: value for key, value in rig.metadata.items() if key not in replaced}
    moved = rig.moved(motion.rotation, motion.translation, motion.scale)
    moved = replace(moved, metadata=kept | {"world": how} | dict(metadata or {}))
    told = {
        "by": how, "scale": motion.scale, "rotation": log_rotation(motion.rotation).tolist(),
        "translation_m": motion.translation.tolist(), **figures,
    }  # fmt: skip
    notes: list[Finding] = []
    if tilt:
        up = [-pose.R_cw[1, 2] for camera in moved if (pose := camera.pose) is not None]
        if sum(up) < 0:
            raise InputError(
                "the known coordinates would turn the cameras upside down: they are left-handed, or their z points down: "
                "exchange x and y, or change a sign"
            )
        notes += ground_note(rig, motion)
    return Aligned(moved, motion, told, tuple(notes))


def with_residuals(aligned: Aligned, residuals: list[dict[str, Any]], notes: Sequence[Finding]) -> Aligned:
    """Add residuals and further findings."""
    everything = (*notes, *aligned.diagnostics)
    told = {"residuals": residuals, "notes": list(texts_of(everything))}
    return replace(aligned, figures=aligned.figures | told, diagnostics=everything)
