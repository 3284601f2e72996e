"""The world frame that a scene's `[world]` table asks for, set at the end of a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from passerby.calibration.alignment.lines import MarkedLine, align_to_lines
from passerby.calibration.alignment.plan import PlanRefusedError, align_to_plan
from passerby.calibration.alignment.world import Aligned, align_to_camera, align_to_points, align_to_positions
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.figures import AdjustedFigures, SolvedCamera, SolverFigures
from passerby.core.solution import Solution
from passerby.findings.finding import Finding, notice
from passerby.interchange.plan_picture import read_plan_picture
from passerby.interchange.world_files import read_known_points, read_known_positions
from passerby.scene.scene import Scene
from passerby.scene.world_files import world_file_paths
from passerby.scene.world_tables import WorldTable, floor_plan

LINE_FIGURES = ("lines", "tilt_deg", "vertical_sigma_deg", "heading_sigma_deg")


@dataclass(frozen=True, eq=False)
class AlignedSolution:
    """A solution in the frame that the scene asks for."""

    rig: Rig
    figures: SolverFigures
    world: dict[str, Any] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()


def align_rig(rig: Rig, wanted: WorldTable, shown: Path | None = None) -> Aligned:
    """Move a rig into the wanted frame.

    Args:
        rig: in the frame of its calibration.
        wanted: the frame; its paths can be opened from here.
        shown: path of the plan's picture as the scene file has it; None: its absolute path is used.

    Raises:
        InputError: a file cannot be read, or does not fit the rig.
        EvidenceError: no camera has a pose, or the known places do not fix the frame.
    """
    if not len(rig.posed()):
        raise EvidenceError(f"none of the {len(rig)} cameras has a pose: there is nothing to align")
    if wanted.points is not None:
        points = read_known_points(wanted.points)
        how = f"points {wanted.points.name}"
        return align_to_points(rig, points, with_scale=wanted.scale, tilt=wanted.tilt, source=how)
    if wanted.positions is not None:
        positions, geodetic = read_known_positions(wanted.positions)
        how, free = f"positions {wanted.positions.name}", {"with_scale": wanted.scale, "tilt": wanted.tilt}
        return align_to_positions(rig, positions, geodetic=geodetic, source=how, **free)
    if wanted.plan is not None:
        image = wanted.plan.image
        height, width = read_plan_picture(image).shape[:2]
        return align_to_plan(rig, floor_plan(wanted.plan, (width, height)), shown or image.resolve(), with_scale=wanted.scale)
    assert wanted.camera is not None
    return align_to_camera(rig, wanted.camera, wanted.towards, turn=not wanted.heading_by_lines)


def align_to_scene(scene: Scene, solution: Solution, elsewhere: Sequence[Camera] = ()) -> AlignedSolution:
    """Move a solution into the frame that the scene asks for; if this fails, keep its own frame and add a finding.

    Cameras `elsewhere` belong to other groups of the scene: their known places give no evidence on this group.
    """
    table = scene.world
    if table is None or not len(solution.rig.posed()):
        return AlignedSolution(solution.rig, solution.figures)
    paths: dict[str, Any] = {
        key: None if path is None else scene.resolve(path) for key, path in world_file_paths(scene).items()
    }
    if table.plan is not None:
        paths["plan"] = table.plan.model_copy(update={"image": scene.resolve(table.plan.image)})
    wanted = table.model_copy(update=paths)
    place = f"{scene.place}: [world]"
    try:
        everywhere = replace(solution.rig, cameras=(*solution.rig.cameras, *elsewhere))
        aligned = _aligned(everywhere, wanted, solution, None if table.plan is None else table.plan.image)
    except PlanRefusedError as error:
        told = replace(error.finding, values={"place": place, **error.finding.values})
        return AlignedSolution(solution.rig, solution.figures, findings=(told,))
    except (InputError, EvidenceError) as error:
        return AlignedSolution(solution.rig, solution.figures, findings=(notice("world_not_set", place=place, why=str(error)),))
    others = {camera.name for camera in elsewhere}
    findings = tuple(
        replace(one, values={"place": place, **one.values})
        for one in aligned.diagnostics
        if not one.cameras or not others.issuperset(one.cameras)
    )
    own = replace(aligned.rig, cameras=tuple(camera for camera in aligned.rig if camera.name not in others))
    return AlignedSolution(own, scaled_figures(solution.figures, aligned.motion.scale), aligned.figures, findings)


def _aligned(rig: Rig, wanted: WorldTable, solution: Solution, shown: Path | None) -> Aligned:
    """Align a rig with the marked lines (vertical and heading), then with the wanted frame. Raises as `align_rig`."""
    if not wanted.lines:
        return align_rig(rig, wanted, shown)
    figures = solution.figures
    sigma_deg = figures.vertical_sigma_deg if isinstance(figures, AdjustedFigures) else None
    levelled = align_to_lines(rig, [MarkedLine(one.direction, one.points) for one in wanted.lines], sigma_deg)
    if not wanted.placed_by:
        return levelled
    aligned = align_rig(levelled.rig, wanted, shown)
    how = f"{levelled.figures['by']} and {aligned.figures['by']}"
    lines = {key: value for key, value in levelled.figures.items() if key in LINE_FIGURES}
    rig = replace(aligned.rig, metadata=dict(aligned.rig.metadata) | {"world": how})
    diagnostics = (*levelled.diagnostics, *aligned.diagnostics)
    return Aligned(rig, aligned.motion, {**aligned.figures, **lines, "by": how}, diagnostics)


def scaled_figures(figures: SolverFigures, scale: float) -> SolverFigures:
    """Multiply the lengths in a solver's figures by a scale; the figures of the scale cues stay as they are."""
    if scale == 1.0 or not isinstance(figures, AdjustedFigures):
        return figures
    people = figures.people
    if people is not None:
        people = replace(people, heights_m={who: scale * height for who, height in people.heights_m.items()})
    measuring = None if figures.measuring is None else figures.measuring.scaled(scale)
    cameras = tuple(_scaled_camera(camera, scale) for camera in figures.cameras)
    return replace(figures, people=people, cameras=cameras, measuring=measuring)


def _scaled_camera(camera: SolvedCamera, scale: float) -> SolvedCamera:
    level, sigma = camera.own_level, camera.shape_position_sigma_mm
    return replace(
        camera,
        shape_position_sigma_mm=None if sigma is None else scale * sigma,
        own_level=None if level is None else replace(level, height_m=scale * level.height_m),
    )
