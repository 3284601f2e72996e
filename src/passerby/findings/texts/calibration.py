"""Findings of a calibration as a whole: moved cameras, positions of the people, intrinsics against image sizes."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import DOUBT, NOTICE, REFUSAL, Fields, Kind

_ALL_OVER = "record people walking all over the area that the cameras share"
_LEVEL = 'provide points with known heights: under [world] set points = "points.csv" and tilt = true'


def _when(v: Fields, end: int) -> str:
    frame = v["frames"][end]
    return f"in frame {frame}" if v["seconds"] is None else f"at {v['seconds'][end]:.1f} s (frame {frame})"


def _kept(v: Fields) -> tuple[str, str]:
    """Which part is kept, and which other one could be."""
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
        there_and_back = f"{_when(v, 0)} and back {_when(v, 1)}"
        return f"camera {v['camera']} {far} {there_and_back}{either}: its observations in between were left out"
    kept, other = _kept(v)
    return (
        f"camera {v['camera']} {far} {_when(v, 0)}{either}: {parts} {kept} the {change}, and its observations {other} the "
        f"{change} were left out"
    )


def _to_choose(v: Fields) -> str:
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
        "which part was not used. A notice where it came back.",
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
