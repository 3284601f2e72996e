"""Findings about the frame of the world: known points and positions against the rig."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import NOTICE, Kind

ALIGNMENT: Mapping[str, Kind] = {
    "world_not_set": Kind(
        NOTICE, "The frame that `[world]` asks for could not be set; `why` has the words of the fault.",
        "the rig stays in its own frame, since {why}",
    ),
    "point_off_everywhere": Kind(
        NOTICE, "A known point contradicts the others in all cameras that see it, and was left out.",
        "point {point} is off by {off_m:.1f} m in all {count} cameras: check its coordinates; it was left out",
    ),
    "point_off": Kind(
        NOTICE, "A known point contradicts the others in one camera, and was left out there.",
        "point {point} in camera {camera} is off by {off_m:.1f} m: check it; it was left out",
    ),
    "position_off": Kind(
        NOTICE, "The known position of the camera contradicts the others, and was left out.",
        "the position of camera {camera} is off by {off_m:.1f} m: check it; it was left out",
    ),
    "points_without_pose": Kind(
        NOTICE, "The camera has no pose, so that its known points are left out.",
        lambda v: f"camera {v['camera']} has no pose: its {v['count']} point{'s are' if v['count'] > 1 else ' is'} left out",
    ),
    "position_without_pose": Kind(
        NOTICE, "The camera has no pose, so that its known position is left out.",
        "camera {camera} has no pose: its position is left out",
    ),
    "places_fit_poorly": Kind(
        NOTICE, "The known places fit worse than their stated accuracy.",
        "the {what} fit to {off_m:.2f} m only, {times:.1f} times their stated accuracy",
        "check them, or state a larger sd_m",
    ),
    "places_want_scale": Kind(
        NOTICE, "By the known places all lengths should be others; they were not asked for that.",
        lambda v: f"by the {v['what']} all lengths should be {v['percent']:.1f} % "
        f"{'larger' if v['larger'] else 'smaller'} (one "
        f"sigma {v['sigma_percent']:.1f} %): `scale` makes them so",
    ),
    "ground_elsewhere": Kind(
        NOTICE, "In the wanted frame the people's ground leans, or is not at z = 0.",
        "the ground that people walked on leans by {lean_deg:.2f} degrees now and lies at z = {height_m:.2f} m below the "
        "cameras: "
        "their ways take z = 0 to be the ground",
    ),
}  # fmt: skip
