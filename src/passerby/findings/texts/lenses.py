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


_PARTS = {"focal": "focal lengths", "principal_point": "principal points"}
_DROPPED = {
    "diverged": "their refinement did not converge",
    "implausible": "refined ones are farther from them than wrong stated ones are",
    "prediction": "refined ones do not predict people who were held out significantly better",
}


def _dropped(v: Fields) -> str:
    return f"the {' and '.join(_PARTS[part] for part in v['parts'])} stay as stated: {_DROPPED[v['why']]}"


LENSES: Mapping[str, Kind] = {
    "focal_contradicted": Kind(
        DOUBT, "The people contradict the camera's focal length, relative `change`.",
        lambda v: f"camera {v['camera']}: people fit a focal length {longer(v['change'])} than stated",
        'check its intrinsics, or refine it: under [solver] set refine = ["focal"]',
    ),
    "all_focals_contradicted": Kind(
        DOUBT, "The people contradict the focal lengths of all cameras alike, relative `change`.",
        lambda v: f"people fit focal lengths {longer(v['change'])} than stated in all cameras",
        "check the intrinsics and the image size that they were made for, or refine them: under [solver] set "
        'refine = ["focal"]',
    ),
    "image_seems_cropped": Kind(
        DOUBT, "The people put the camera's principal point `moved_px` nearer to one `side` of the image than stated.",
        "camera {camera}: people fit a principal point {moved_px:.0f} px nearer to the {side} of the image than stated: it "
        "seems cropped there",
        "check whether its images were cropped after it was calibrated, and state the intrinsics of the cropped images",
    ),
    "lens_part_contradicted": Kind(
        DOUBT, "The people contradict a further `part` of the camera's intrinsics.",
        "{who}: people fit a different {part} than stated", "check its intrinsics", common=True,
    ),
    "size_contradicted": Kind(
        DOUBT, "The people appear too large or too small for where the camera seems to stand; no wrong intrinsics explain it.",
        lambda v: (
            f"camera {v['camera']}: people fit a focal length {longer(v['change'])} than stated ({v['sigmas']:.1f} sigmas), "
            "and no error of its intrinsics explains that: the camera may be placed by people who are not those of the others"
        ),
        "check whether it shows a screen, a mirror or another place, and its intrinsics and identities",
    ),
    "focal_undetermined": Kind(
        DOUBT, "The people hardly determine the focal length of a camera without intrinsics.",
        "camera {camera}: its focal length is estimated to {sigma_percent:.0f} % only",
        "state its field of view (hfov_deg) or its intrinsics, or record more people, near and far and all over its images",
    ),
    "principal_points_assumed": Kind(
        DOUBT, "The principal points of cameras without intrinsics are assumed to be near the image centres.",
        "{who}: without intrinsics the principal point is assumed to be near the image centre, and an image that was cropped "
        "on one side turns its camera",
        "compare the report's images with the ground and people drawn into them, or state the intrinsics", common=True,
    ),
    "intrinsics_estimated": Kind(
        NOTICE, "Focal length, principal point and distortion of a camera without intrinsics were estimated.",
        _estimated,
    ),
    "refinement_dropped": Kind(
        NOTICE, "The refinement of the `parts` was dropped, and the rig is solved with their stated values; `why` is diverged, "
        "implausible or prediction.",
        _dropped, "check the intrinsics, or leave the refinement out under [solver]",
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
