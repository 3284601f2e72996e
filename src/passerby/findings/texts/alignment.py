"""Findings about the world coordinate frame: known points and positions against the rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from passerby.findings.texts.kinds import DOUBT, NOTICE, Kind


def _placements(values: Mapping[str, Any]) -> str:
    """Cameras and points on a plan, in words."""
    cameras, points = values["on_plan"], values["points"]
    named = [f"camera{'s' if len(cameras) > 1 else ''} {', '.join(cameras)}"] if cameras else []
    named += [f"point{'s' if len(points) > 1 else ''} {', '.join(points)}"] if points else []
    return " and ".join(named)


ALIGNMENT: Mapping[str, Kind] = {
    "world_not_set": Kind(
        NOTICE, "The world frame that `[world]` asks for could not be set; `why` is the text of the error.",
        "the rig stays in its own frame: {why}",
    ),
    "point_off_everywhere": Kind(
        NOTICE, "A known point contradicts the others in all cameras that see it, and was left out.",
        "point {point} has a residual of {off_m:.1f} m in all {count} cameras: check its coordinates; it was left out",
    ),
    "point_off": Kind(
        NOTICE, "A known point contradicts the others in one camera, and was left out there.",
        "point {point} in camera {camera} has a residual of {off_m:.1f} m: check it; it was left out",
    ),
    "position_off": Kind(
        NOTICE, "The known position of the camera contradicts the others, and was left out.",
        "the position of camera {camera} has a residual of {off_m:.1f} m: check it; it was left out",
    ),
    "line_off": Kind(
        NOTICE, "A line that is marked as vertical or horizontal contradicts the others and the people, and was left out.",
        "[[world.lines]] {number} is off by {off_deg:.1f} degrees in {cameras}: it was left out",
        "check that both pixels are on one straight line, and that it is vertical or horizontal as stated",
    ),
    "points_without_pose": Kind(
        NOTICE, "The camera has no pose, so that its known points are left out.",
        lambda v: f"camera {v['camera']} has no pose: its {v['count']} point{'s are' if v['count'] > 1 else ' is'} left out",
    ),
    "position_without_pose": Kind(
        NOTICE, "The camera has no pose, so that its known position is left out.",
        "camera {camera} has no pose: its position is left out",
    ),
    "point_above_horizon": Kind(
        NOTICE, "A point of the plan does not lie on the ground by its pixel in the camera, and was left out there.",
        "point {point} of the plan is above the horizon of camera {camera}: check its pixel; it was left out",
    ),
    "plan_contradicts_itself": Kind(
        DOUBT, "Cameras (`on_plan`) and points placed on the plan contradict each other; which of them is wrong is not known.",
        lambda v: f"{_placements(v)} contradict each other on the plan, by {v['off_m']:.2f} m",
        "check them, or place more cameras or points on it, by which the wrong one is found", subjects=("scale",),
    ),
    "plan_mirrored": Kind(
        DOUBT, "What was placed on the plan agrees on the plan's mirror image, and on the plan itself it does not.",
        "the plan is mirrored: its cameras and points fit its mirror image only",
        "give a picture of the plan as it is seen from above", subjects=("scale",),
    ),
    "plan_unit_wrong": Kind(
        DOUBT, "The plan is several times too large or too small for people; it was not used.",
        "according to people's heights a pixel of the plan is about {by_people:.2g} m wide, not {metres_per_pixel:g} m",
        lambda v: "check metres_per_pixel, or the metres of distance"
        + (f", which seems to be in {v['unit']}" if "unit" in v else "") + "; the plan was not used",
        subjects=("scale",), rank="input",
    ),
    "places_fit_poorly": Kind(
        NOTICE, "The known points or positions fit worse than their stated accuracy.",
        "the residual of the {what} is {off_m:.2f} m, {times:.1f} times their stated accuracy",
        "check them, or state a larger sd_m",
    ),
    "places_want_scale": Kind(
        NOTICE, "The known points or positions imply another scale; rescaling was not requested.",
        lambda v: f"according to the {v['what']} all lengths should be {v['percent']:.1f} % "
        f"{'larger' if v['larger'] else 'smaller'} (1 sigma {v['sigma_percent']:.1f} %): `scale` rescales them",
    ),
    "ground_elsewhere": Kind(
        NOTICE, "In the requested world frame the people's ground is tilted, or is not at z = 0.",
        "the ground that people walked on is now tilted by {lean_deg:.2f} degrees and lies at z = {height_m:.2f} m below the "
        "cameras: trajectories assume the ground at z = 0",
    ),
}  # fmt: skip
