"""Findings about the cameras' intrinsics, of the person-model solver."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import DOUBT, NOTICE, Fields, Kind, longer

_HARDLY_KNOWN = '"{part}" can be left out of refine under [solver]'


def _focal(v: Fields) -> str:
    text = (
        f"camera {v['camera']}: focal length {v['refined_px']:.0f} px instead of {v['stated_px']:.0f} "
        f"({v['change_percent']:+.1f} %, sigma {v['sigma_percent']:.1f} %)"
    )
    return text if v["constrained"] else f"{text}; the people hardly constrain it"


def _point(v: Fields) -> str:
    (x, y), (u, w) = v["stated_px"], v["refined_px"]
    text = (
        f"camera {v['camera']}: principal point ({u:.0f}, {w:.0f}) px instead of ({x:.0f}, {y:.0f}), sigma "
        f"{v['sigma_px']:.0f} px"
    )
    return text if v["constrained"] else f"{text}; the people hardly constrain it"


def _estimated(v: Fields) -> str:
    x, y = v["point_px"]
    return (
        f"camera {v['camera']}: estimated focal length {v['focal_px']:.0f} px (sigma {v['sigma_percent']:.1f} %), principal "
        f"point ({x:.0f}, {y:.0f}) px (sigma {v['point_sigma_px']:.0f} px), distortion k1 {v['distortion']:+.3f} (sigma "
        f"{v['distortion_sigma']:.3f})"
    )


def _assumed(v: Fields) -> str:
    ground = "" if v["ground_mm"] is None else f"positions on the ground by {v['ground_mm'] / 10:.0f} cm, "
    return (
        f"{v['who']} without intrinsics: the principal point is not observable; rotations are uncertain by "
        f"{v['orientation_deg']:.1f} degrees, {ground}points by {v['points_mm'] / 10:.1f} cm (1 sigma)"
    )


LENSES: Mapping[str, Kind] = {
    "focal_contradicted": Kind(
        DOUBT, "The people contradict the camera's focal length, relative `change`.",
        lambda v: f"camera {v['camera']}: people fit a focal length {longer(v['change'])} than stated",
        'check its intrinsics, or refine it: under [solver] set refine = ["focal"]', rank="lens",
    ),
    "all_focals_contradicted": Kind(
        DOUBT, "The people contradict the focal lengths of all cameras alike, relative `change`.",
        lambda v: f"people fit focal lengths {longer(v['change'])} than stated in all cameras",
        "check the intrinsics and the image size that they were made for, or refine them: under [solver] set "
        'refine = ["focal"]', rank="lens",
    ),
    "image_seems_cropped": Kind(
        DOUBT, "The people put the camera's principal point `moved_px` nearer to one `side` of the image than stated.",
        "camera {camera}: people fit a principal point {moved_px:.0f} px nearer to the {side} of the image than stated: it "
        "seems cropped there",
        "check whether its images were cropped after it was calibrated, and state the intrinsics of the cropped images",
        rank="lens",
    ),
    "lens_part_contradicted": Kind(
        DOUBT, "The people contradict a further `part` of the camera's intrinsics.",
        "{who}: people fit a different {part} than stated", "check its intrinsics", common=True, rank="lens",
    ),
    "size_contradicted": Kind(
        DOUBT, "The people appear too large or too small for where the camera seems to stand; no wrong intrinsics explain it.",
        lambda v: (
            f"camera {v['camera']}: people fit a focal length {longer(v['change'])} than stated ({v['sigmas']:.1f} sigmas), "
            "and no error of its intrinsics explains that: the camera may be placed by people who are not those of the others"
        ),
        "check whether it shows a screen, a mirror or another place, and its intrinsics and identities", rank="symptom",
    ),
    "focal_refined_far": Kind(
        DOUBT, "The refined focal length is farther from the stated value than the error expected of one.",
        "camera {camera}: its focal length was refined by {change_percent:+.0f} %, more than the error expected of a stated "
        "value",
        "check its intrinsics and the image size that they were made for", rank="lens",
    ),
    "principal_point_refined_far": Kind(
        DOUBT, "The refined principal point is farther from the stated value than the error expected of one.",
        "camera {camera}: its principal point was refined by {moved_px:.0f} px, more than the error expected of a stated "
        "value",
        "check its intrinsics and whether its images were cropped", rank="lens",
    ),
    "principal_points_assumed": Kind(
        NOTICE, "The principal points of cameras without intrinsics are not observable: rotations stand in for them.",
        _assumed,
        "for exact rotations, state the intrinsics",
    ),
    "intrinsics_estimated": Kind(
        NOTICE, "Focal length, principal point and distortion of a camera without intrinsics were estimated.",
        _estimated,
    ),
    "focal_refined": Kind(
        NOTICE, "The focal length was refined; `constrained` says whether the people constrain it.",
        _focal, lambda v: "" if v["constrained"] else _HARDLY_KNOWN.format(part="focal"),
    ),
    "principal_point_refined": Kind(
        NOTICE, "The principal point was refined; `constrained` says whether the people constrain it.",
        _point, lambda v: "" if v["constrained"] else _HARDLY_KNOWN.format(part="principal_point"),
    ),
}  # fmt: skip
