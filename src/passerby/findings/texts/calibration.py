"""Findings of a calibration as a whole, of its alignment with known places, and of a rig in use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from passerby.findings.texts.kinds import DOUBT, NOTICE, REFUSAL, Fields, Kind

_ALL_OVER = "record people walking all over the area that the cameras share"
_LEVEL = 'provide points with known heights: under [world] set points = "points.csv" and tilt = true'


def _when(v: Fields, end: int) -> str:
    frame = v["frames"][end]
    return f"in frame {frame}" if v["seconds"] is None else f"at {v['seconds'][end]:.1f} s (frame {frame})"


def _kept(v: Fields) -> tuple[str, str]:
    """Return the words for the part of the recording that is kept, and for the other part."""
    return ("after", "before") if v["left_out"] == "before" else ("before", "after")


def _moved(v: Fields) -> str:
    factor = v["factor"]
    if factor is None:
        change, far, parts = "move", f"moved by {v['metres']:.2f} m and {v['degrees']:.1f} degrees", "its pose is the one"
    else:
        change, parts = "zoom", "its pose and its focal length are those"
        far = f"zoomed {'in' if factor > 1 else 'out'} by a factor of {max(factor, 1 / factor):.2f}"
    either = f" (or camera {v['second']} did: two cameras alone cannot show which)" if len(v["names"]) > 1 else ""
    if v["left_out"] == "between":
        if v.get("times", 1) > 1:
            since, until = (_when(v, end).removeprefix("at ").removeprefix("in ") for end in (0, 1))
            often = f"{v['times']} times, from {since} to {until}"
            return f"camera {v['camera']} {far} and back {often}{either}: its observations from there were left out"
        there_and_back = f"{_when(v, 0)} and back {_when(v, 1)}"
        return f"camera {v['camera']} {far} {there_and_back}{either}: its observations in between were left out"
    kept, other = _kept(v)
    return (
        f"camera {v['camera']} {far} {_when(v, 0)}{either}: {parts} {kept} the {change}, and its observations {other} the "
        f"{change} were left out"
    )


def _to_choose(v: Fields) -> str:
    if v.get("times", 1) > 1:
        return "stop its tour, or fasten it, and record again"
    if v["seconds"] is None:
        return f"to choose, under [scene] set fps to the frame rate, and then from_s or until_s under [{v['table']}]"
    (kept, other), change = _kept(v), "move" if v["factor"] is None else "zoom"
    until, since = f"until_s = {v['until_s']}", f"from_s = {v['from_s']}"
    one, two = (until, since) if kept == "before" else (since, until)
    return f"under [{v['table']}] set {one} to keep that pose, or {two} for the pose {other} the {change}"


def _drifts(v: Fields) -> str:
    if v["together"]:
        least, most = (f"{pixels:.0f}" for pixels in v["pixels"])
        far = f"{most} px" if least == most else f"{least} to {most} px"
        return f"the images of cameras {v['cameras']} move slowly, by {far}, and this was taken out of their observations"
    either = f" (or camera {v['second']} does: two cameras alone cannot show which)" if len(v["names"]) > 1 else ""
    far, timed = f"{v['pixels']:.0f} px ({v['degrees']:.1f} degrees)", v["minutes"] is not None
    if not v["steady"]:
        far = f"by up to {far}"
    elif timed:
        far = f"by {v['pixels'] / v['minutes']:.0f} px ({v['degrees'] / v['minutes']:.1f} degrees) a minute, {far} in all"
    else:
        far = f"steadily, by {far} in all"
    return (
        f"camera {v['camera']} drifts {far}{either}: its pose is the mean one, and the drift was taken out of its observations"
    )


def _to_hold_still(v: Fields) -> str:
    if v["together"]:
        return "switch image stabilisation off in these cameras, or fasten them, and record again"
    return "fasten the camera, or switch its image stabilisation off, and record again"


def _smaller(v: Fields) -> str:
    small, size = (f"{width} x {height}" for width, height in (v["seen_size"], v["size"]))
    why = f"{v['cut']} are cut off at its edge" if v["cut"] else "fit people whom the other cameras see better with that size"
    return (
        f"camera {v['camera']}: its people seem to be detected in images of {small}, not of the stated {size}: they lie within "
        f"that part, and {why}"
    )


_READINGS = {"mirrored": "mirrored left to right", "overturned": "flipped top to bottom", "turned": "turned by 180 degrees"}


def _uneven(v: Fields) -> str:
    where = ""
    if v["at"] is not None:
        low, high = (f"({x:.1f}, {y:.1f})" for x, y in v["at"])
        where = f", at {low} and {high}"
    return (
        f"the ground that people walk on is not one plane: {v['rise_m']:.1f} m between its lowest and its highest part{where}"
    )


def _unfulfilled(v: Fields) -> str:
    stated = "one person" if v["same"] else "different people"
    found = "1 identity was" if v["found"] == 1 else f"{v['found']} identities were"
    return f"{v['boxes']} boxes are stated to be {stated}, but {found} found in them"


def _unpredicted(v: Fields) -> str:
    who = f"camera {v['camera']} and the others" if v["cameras"] else "the cameras"
    whole = v["to_percent"] - v["from_percent"] >= 100
    when = "" if whole else f" between {v['from_percent']:.0f} and {v['to_percent']:.0f} % of the recording"
    share = f"{max(v['share'], 0.0):.0%} of them are detected there{when} (usual: {v['expected']:.0%})"
    return f"{who} predict people in each other's images, but only {share}"


def _to_predict(v: Fields) -> str:
    if not v["cameras"]:
        return "check the intrinsics, the clocks and the identities, and whether the ground is flat"
    if v["to_percent"] - v["from_percent"] < 100:
        return "check whether it was moved, whether frames are missing and whether its clock stays synchronised"
    return "check whether it films the same place at the same time, and its intrinsics, its clock and the identities"


CALIBRATION: Mapping[str, Kind] = {
    "camera_without_pose": Kind(
        DOUBT, "Cameras could not be registered, and `why` is the finding that explains it, or null.",
        lambda v: v["why"].problem if v["why"] else f"{v['who']} could not be registered",
        lambda v: v["why"].remedy if v["why"] else "record more people in the area shared with the others",
        joint=lambda v: v["why"].joint if v["why"] else ": ", common=True, rank="symptom",
    ),
    "camera_moved": Kind(
        (*DOUBT, *NOTICE), "The camera moved, or zoomed by `factor`, while it filmed (or the second one did); `left_out` says "
        "which part was not used. A notice where it came back once.",
        _moved, _to_choose, joint="; ", rank="motion",
    ),
    "camera_drifts": Kind(
        DOUBT, "The camera kept turning while it filmed, or several cameras did `together`; the rotation was corrected.",
        _drifts, _to_hold_still, joint="; ", rank="motion",
    ),
    "people_not_spread": Kind(
        NOTICE, "All people stay on one spot or walk on one straight line, by `shape`.",
        lambda v: f"all people {'stay on one spot' if v['shape'] == 'spot' else 'walk on one straight line'} of "
        f"{v['length_m']:.1f} m",
        _ALL_OVER,
    ),
    "people_not_predicted": Kind(
        DOUBT, "People are not detected where cameras predict them in each other's images; without a camera: in the whole rig.",
        _unpredicted, _to_predict, rank="symptom",
    ),
    "pointed_person_unmatched": Kind(
        NOTICE, "A person at whom the scene file points was not identified in any other camera.",
        "[[scale.people]] {number}: the person at [{at[0]:g}, {at[1]:g}] in camera {camera} in frame {frame} was not "
        "identified in any other camera; its height is not used",
        "point at a time, or in a camera, at which the person is clearly seen by others too", subjects=("scale",),
    ),
    "stated_identity_unfulfilled": Kind(
        NOTICE, "A correction of identities in the scene file could not be followed.",
        _unfulfilled,
        "check the pixels and the other corrections: two may contradict each other, or two boxes lie on one track",
    ),
    "ground_uneven": Kind(
        NOTICE, "The people's ground is not one plane.", _uneven, f"{_LEVEL}; or record people on one level",
        subjects=("vertical",),
    ),
    "ground_tilted": Kind(
        NOTICE, "The ground is tilted against the people on it: z is the normal of the ground, not the direction of gravity.",
        "the ground is tilted by {tilt_deg:.1f} ± {sigma_deg:.1f} degrees against the bodies of the people on it: z is the "
        "normal of the ground, not the direction of gravity",
        "if z is to be the direction of gravity, mark vertical edges under [[world.lines]]", subjects=("vertical",),
    ),
    "people_on_levels": Kind(
        NOTICE, "People's own ways slope against the ground of the rig: some walk on another level than others.",
        "people's own ways slope by {slope_deg:.1f} degrees against the ground of all people together (1 sigma "
        "{sigma_deg:.1f}): some walk on another level than others",
        f"{_LEVEL}; or record people on one level", subjects=("vertical",),
    ),
    "check_length_off": Kind(
        DOUBT, "A length that was given as a check contradicts the rig.",
        "[[scale.checks]] {number} is {stated_m:.2f} m long, but {measured_m:.2f} m by the rig, where one sigma is "
        "{sigma_m:.2f} m",
        "check the marks and the length; if both are right, the scale or the shape of the rig is wrong: give a measured length "
        "under [[scale.lengths]]", subjects=("scale",), rank="symptom",
    ),
    "check_length_unmeasured": Kind(
        NOTICE, "A length that was given as a check cannot be measured by the rig.",
        "[[scale.checks]] {number} cannot be measured: fewer than two of its cameras have a pose, or its marks do not meet",
        "mark both ends in two cameras that see them from different sides",
    ),
    "image_misread": Kind(
        (*DOUBT, *NOTICE), "The camera's people are upside down, or fit far better if its images are mirrored, overturned or "
        "turned (`how`).",
        lambda v: f"{v['who']}: people are upside down" if v["how"] == "upside_down" else
        f"{v['who']}: people whom the other cameras see fit far better if its images are {_READINGS[v['how']]}",
        lambda v: "give the images, boxes and keypoints as the camera sees the scene; if the camera hangs upside down, "
        + {None: "set rotate", 0: "delete rotate"}.get(v["rotate"], f"set rotate = {v['rotate']}"),
        common=True, rank="input",
    ),
    "smaller_image_fits": Kind(
        (*DOUBT, *NOTICE), "People seem to be detected in smaller images than the intrinsics are for; `cut` of them are cut "
        "off at the edge of that part.",
        _smaller,
        "give intrinsics for images of that size, or scale its boxes and keypoints to the image size of the intrinsics",
        rank="input",
    ),
    "clock_late": Kind(
        (*DOUBT, *NOTICE), "The camera shows people later or earlier than its clock says; `corrected` says whether the rig is "
        "computed with the right offset.",
        lambda v: f"camera {v['camera']} shows people {abs(v['late_s']):.2f} s {'later' if v['late_s'] > 0 else 'earlier'} "
        "than the other cameras do" + ("; the rig is computed with that offset" if v["corrected"] else ""),
        "check the offset of its clock, and whether its tracker smooths the boxes", rank="motion",
    ),
    "keypoints_unused": Kind(
        (*NOTICE, *REFUSAL), "A camera is missing, and keypoints were not detected.",
        "keypoints were not detected; they constrain more than boxes do where people stand or the recording is short",
        'under [perception] set keypoints = "{network}"',
    ),
}  # fmt: skip


def _placements(values: Mapping[str, Any]) -> str:
    """Return the cameras and points on a plan in words."""
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


def _as_of(v: Fields) -> str:
    if v["first"] is None:
        return ""
    span = v["first"] if v["first"] == v["last"] else f"{v['first']} to {v['last']}"
    return f" (files of {span})"


def _thinned(v: Fields) -> str:
    parts = [f"samples {v['every_s']:g} s apart"] if v["every_s"] else []
    parts += [f"one window in {v['one_window_in']}"] if v["one_window_in"] > 1 else []
    what = f"of the footage only {' of '.join(parts)} {'are' if v['every_s'] else 'is'} used"
    within = v["predicted_s"] <= v["budget_s"]
    said = "to stay within" if within else f"and yet it takes about {v['predicted_s']:.2g} s, more than"
    return f"{what}, {said} {v['budget_s']:g} s of processor time for each camera and minute"


MONITORING: Mapping[str, Kind] = {
    "no_news": Kind(
        NOTICE, "Cameras have no new footage since an earlier run of the monitor: they were not read again.",
        lambda v: f"{v['count']} camera{'s have' if v['count'] > 1 else ' has'} no new footage since the last run: "
        f"{'their states are' if v['count'] > 1 else 'its state is'} taken over from there{_as_of(v)}",
    ),
    "news_alone": Kind(
        NOTICE, "A camera has new footage that nothing can be compared with, because none of its neighbours has any.",
        "{who}: no neighbour has new footage, too: tested as soon as one has; until then the last run's state is taken over",
        common=True,
    ),
    "news_without_people": Kind(
        NOTICE, "A camera had moved in an earlier run, and its new footage tells nothing.",
        "{who}: too few people in the new footage: what the last run found is taken over", common=True,
    ),
    "monitoring_thinned": Kind(
        NOTICE, "The monitor uses only a part of the footage, to stay within its budget of processor time.", _thinned,
        "give a larger --budget to use more of it",
    ),
    "earlier_run_broken": Kind(
        NOTICE, "What an earlier run of the monitor wrote cannot be read: all cameras are monitored.",
        "what the last run wrote there cannot be read or is not complete: all cameras are monitored",
    ),
}  # fmt: skip
