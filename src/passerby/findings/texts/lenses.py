"""Findings about the cameras' intrinsics, of the person-model solver."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import DOUBT, NOTICE, Fields, Kind, longer

_WEAKLY_KNOWN = '"{part}" can be left out of refine under [solver]'


def _focal(v: Fields) -> str:
    text = (
        f"camera {v['camera']}: focal length {v['refined_px']:.0f} px instead of {v['stated_px']:.0f} "
        f"({v['change_percent']:+.1f} %, sigma {v['sigma_percent']:.1f} %)"
    )
    return text if v["constrained"] else f"{text}; the people barely constrain it"


def _point(v: Fields) -> str:
    (x, y), (u, w) = v["stated_px"], v["refined_px"]
    text = (
        f"camera {v['camera']}: principal point ({u:.0f}, {w:.0f}) px instead of ({x:.0f}, {y:.0f}), sigma "
        f"{v['sigma_px']:.0f} px"
    )
    return text if v["constrained"] else f"{text}; the people barely constrain it"


def _estimated(v: Fields) -> str:
    x, y = v["point_px"]
    return (
        f"camera {v['camera']}: estimated focal length {v['focal_px']:.0f} px (sigma {v['sigma_percent']:.1f} %), principal "
        f"point ({x:.0f}, {y:.0f}) px (sigma {v['point_sigma_px']:.0f} px), distortion k1 {v['distortion']:+.3f} (sigma "
        f"{v['distortion_sigma']:.3f})"
    )


def _contradicted(v: Fields) -> str:
    """Return in words the values that people fit instead of the stated ones."""
    parts = []
    if focal := v.get("focal"):
        lengths = f" ({focal['found_px']:.0f} px instead of {focal['stated_px']:.0f} px)" if v["cameras"] else ""
        parts.append(f"{'a focal length' if v['cameras'] else 'focal lengths'} {longer(focal['change'])} than stated{lengths}")
    if point := v.get("principal_point"):
        (x, y), (u, w) = point["stated_px"], point["found_px"]
        text = f"a principal point at ({u:.0f}, {w:.0f}) px instead of ({x:.0f}, {y:.0f}) px"
        if point["cropped"]:
            text += f", {point['moved_px']:.0f} px nearer to the {point['cropped']} of the image, which seems cropped there"
        parts.append(text)
    if distortion := v.get("distortion"):
        of_one = f"a distortion k1 of {distortion['found']:+.3f} instead of {distortion['stated']:+.3f}"
        parts.append(
            of_one if v["cameras"] else f"distortions k1 that differ by {distortion['change']:+.3f} from the stated ones"
        )
    return f"{'camera ' + v['camera'] if v['cameras'] else 'all cameras'}: people fit {' and '.join(parts)}"


def _doubtful(v: Fields) -> str:
    if v["why"] == "several":
        names = {"focal": "focal length", "principal_point": "principal point", "distortion": "distortion"}
        suspects = [
            f"the {names[one['part']]} of camera {one['cameras'][0]}"
            if one["cameras"]
            else f"the {names[one['part']]}s of all cameras"
            for one in v["suspects"]
        ]
        either = " or ".join(suspects)
        return f"people contradict the stated intrinsics: {either} may be wrong, and each of these fits about as well"
    if v["why"] == "unusual":
        return (
            f"camera {v['camera']}: its focal length was estimated {v['change_percent']:+.0f} % from the first guess, and its "
            f"principal point {v['moved_px']:.0f} px from the image centre, farther than lenses are"
        )
    reason = {
        "implausible": "that is more than intrinsics are wrong by: the camera may stand elsewhere, or show other people",
        "not_better": "with these intrinsics the rig predicts people worse, so that it is computed with the stated ones",
    }[v["why"]]
    return f"{_contradicted(v)}; {reason}"


def _assumed(v: Fields) -> str:
    ground = "" if v["ground_mm"] is None else f"positions on the ground by {v['ground_mm'] / 10:.0f} cm, "
    return (
        f"{v['who']} without intrinsics: the principal point is not observable; rotations are uncertain by "
        f"{v['orientation_deg']:.1f} degrees, {ground}points by {v['points_mm'] / 10:.1f} cm (1 sigma)"
    )


_PARTS = {"focal": "focal lengths", "principal_point": "principal points"}
_DROPPED = {
    "diverged": "their refinement did not converge",
    "implausible": "refined ones are farther from them than wrong stated ones are",
    "prediction": "refined ones do not predict people who were held out significantly better",
}


def _dropped(v: Fields) -> str:
    return f"the {' and '.join(_PARTS[part] for part in v['parts'])} stay as stated: {_DROPPED[v['why']]}"


_STATE = "state its intrinsics or its field of view (hfov_deg), and check whether its images were cropped"

LENSES: Mapping[str, Kind] = {
    "lens_corrected": Kind(
        NOTICE, "People contradict stated intrinsics, which were corrected: `focal`, `principal_point`, `distortion`.",
        lambda v: f"{_contradicted(v)}; the rig is computed with these intrinsics",
        "state the right intrinsics",
    ),
    "lens_differs": Kind(
        NOTICE, "People contradict stated intrinsics, and what the rig measures barely depends on it.",
        lambda v: f"{_contradicted(v)}; that changes measured points by {v['moved_mm']:.0f} mm only, within their uncertainty",
    ),
    "lens_doubtful": Kind(
        (*DOUBT, *NOTICE), "People contradict stated intrinsics, which could not be corrected; `why` says the reason. A notice "
        "where several explanations fit about as well: the sigmas hold them.",
        _doubtful,
        lambda v: _STATE
        if v["why"] == "unusual"
        else "check the stated intrinsics, the image sizes they were made for, and whether images were cropped",
        rank="lens",
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
    "refinement_dropped": Kind(
        NOTICE, "The refinement of the `parts` was dropped, and the rig is solved with their stated values; `why` is diverged, "
        "implausible or prediction.",
        _dropped, "check the intrinsics, or leave the refinement out under [solver]",
    ),
    "focal_refined": Kind(
        NOTICE, "The focal length was refined; `constrained` says whether the people constrain it.",
        _focal, lambda v: "" if v["constrained"] else _WEAKLY_KNOWN.format(part="focal"),
    ),
    "principal_point_refined": Kind(
        NOTICE, "The principal point was refined; `constrained` says whether the people constrain it.",
        _point, lambda v: "" if v["constrained"] else _WEAKLY_KNOWN.format(part="principal_point"),
    ),
}  # fmt: skip
