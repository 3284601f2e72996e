"""Findings of the solvers: the person model, and `geopose`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from passerby.common.text import list_names
from passerby.findings.finding import Severity
from passerby.findings.texts.kinds import DOUBT, NOTICE, REFUSAL, Fields, Kind, Subject

PART_NAMES = {"vertical": "up direction"}
"""Words for parts of the world that can be undetermined, where they differ from the names in the values."""
_SUBJECTS: Mapping[str, tuple[Subject, ...]] = MappingProxyType({
    "scale": ("scale",), "ground": ("vertical",), "world": ("scale", "vertical")
})  # fmt: skip
_EITHER: tuple[Severity, ...] = ("notice", "refusal")
_OVERLAP = "record people walking where the views of these cameras overlap"
GEOPOSE: Mapping[str, Kind] = {
    "pair_failed": Kind(
        _EITHER, "The camera could not be registered with the reference, `second`, for the `cause`.",
        "camera {camera} could not be registered with {second}: {cause.problem}",
        "{cause.remedy}", joint="{cause.joint}", rank="symptom",
    ),
    "few_common_points": Kind(
        REFUSAL, "Two cameras have few points in common.",
        "{common} common points, {needed} are needed", _OVERLAP,
    ),
    "few_agreeing_points": Kind(
        REFUSAL, "Few of the common points of two cameras agree on a relative pose.",
        "{agreeing} of {common} common points agree on one relative pose, {needed} are needed", _OVERLAP,
    ),
    "few_usable_points": Kind(
        REFUSAL, "Few of the common points of two cameras can be used for a relative pose.",
        "{usable} common points do not fix a relative pose: at least {needed} are needed", _OVERLAP,
    ),
    "no_relative_pose": Kind(
        REFUSAL, "No relative pose was found for two cameras.",
        "no relative pose agrees with the {common} common points", _OVERLAP,
    ),
    "relative_pose_weak": Kind(
        REFUSAL, "The best relative pose of two cameras agrees with few of their common points.",
        "the best relative pose agrees with {agreeing} of {common} common points: at least {needed} are needed",
        _OVERLAP,
    ),
    "people_do_not_stand": Kind(
        REFUSAL, "In the pair's pose the head and feet of almost no person agree: it is the mirror image of the true pose.",
        "the heads and feet of only {standing} of {shared} people seen by both agree with its pose, so the pose is wrong "
        "(points on one level cannot distinguish two poses of cameras that face each other)",
        "choose another reference camera",
    ),
    "few_whole_people": Kind(
        REFUSAL, "Too few people were seen whole by two cameras to estimate the up direction and the scale.",
        "{seen} people were seen from head to feet by two cameras at the same time: at least {needed} are needed to estimate "
        "the up direction and the scale",
        "record people walking where they are fully in view", joint="; ",
    ),
    "few_upright_people": Kind(
        REFUSAL, "Too few upright people were measured to estimate the scale.",
        "{seen} upright people were measured: at least {needed} are needed for the scale",
        "record people walking where they are fully in view",
    ),
    "few_inliers": Kind(
        NOTICE, "Few of the points that the camera shares with the reference agree with its pose.",
        "only {share:.0%} of the points that camera {camera} shares with the reference agree with its pose", _OVERLAP,
        rank="symptom",
    ),
    "near_reference": Kind(
        NOTICE, "The camera is almost at the position of the reference camera.",
        "camera {camera} is almost at the position of the reference camera (rays meet at {parallax_deg:.1f} degrees): its "
        "distance is unknown",
        "choose another reference camera", joint="; ",
    ),
    "pairs_disagree": Kind(
        NOTICE, "The pairs disagree about the positions of the same points.",
        "the pairs disagree about the positions of the same {what} by {share:.0%} of their distance: at least one pair is "
        "wrong",
        "try another reference camera or {other}", joint="; ", rank="symptom",
    ),
}  # fmt: skip


def _uncertain(v: Fields) -> str:
    what, sigma, why = v["what"], v["sigma"], v["why"]
    if v["lacks"]:
        named = [f"the {PART_NAMES.get(one, one)}" for one in v["lacks"]]
        text = f"nothing fixes {' and '.join(filter(None, (', '.join(named[:-1]), named[-1])))}"
    elif sigma is None:
        text = "how well the rig measures is unknown"
        if v["cameras"]:
            text = f"the pose of camera {v['camera']} relative to the others is not determined"
    elif what == "scale":
        text = f"all lengths are uncertain by {sigma:.0f} % (1 sigma)"
    elif what == "ground":
        text = f"positions on the ground by camera {v['camera']} are uncertain by {sigma / 10:.0f} cm (1 sigma)"
    else:
        text = f"points seen by camera {v['camera']} are uncertain by {sigma / 10:.0f} cm (1 sigma)"
    return f"{text}, since {why.problem}" if why else text


def _gives(v: Fields) -> str:
    """Return in words the evidence that gives scale and up direction; empty for files of an older Passerby."""
    named = [
        f"{list_names(v[key])} give {what}" for key, what in (("scale", "the scale"), ("up", "the up direction")) if v.get(key)
    ]
    return f"{' and '.join(named)}, but " if named else ""


def _to_be_certain(v: Fields) -> str:
    if v["why"] and v["why"].remedy:
        return str(v["why"].remedy)
    if v["lacks"] == ["scale"]:
        return "give a measured length under [scale], or boxes, or keypoints with heads and ankles"
    if v["lacks"]:
        length = "; a measured length under [scale] fixes the scale, but not the up direction" if "scale" in v["lacks"] else ""
        return f"give boxes, or keypoints with heads and ankles, of people seen whole by two cameras{length}"
    if v["what"] == "scale":
        return "give a measured length under [scale]"
    return "record longer, or people nearer to it, seen from head to feet, all over the area that it shares with others"


def _unusual(v: Fields) -> str:
    low, high = f"{v['low_m']:.2f}", f"{v['high_m']:.2f}"
    tall = f"{low} m" if low == high else f"{low} to {high} m"
    numbers = [str(one) for one in v["identities"]]
    who, are = (f"person {numbers[0]}", "is") if len(numbers) == 1 else (f"people {list_names(numbers)}", "are")
    return f"{who} {are} {tall} tall by the rig (median of all people: {v['usual_m']:.2f} m), and {are} left out of the scale"


def _ambiguous(v: Fields) -> str:
    if "runner_up" in v:
        return (
            f"the paths of people fit almost as well if {v['who']} stood elsewhere or showed another time (the second-best "
            f"hypotheses score {v['runner_up']:.0%} of the best)"
        )
    if v["names"]:
        return f"the paths of people fit another arrangement of {v['who']}, before identities are known"
    return "two arrangements of the cameras fit the people almost equally well"


_CUE_REMEDIES: Mapping[str | None, str] = MappingProxyType({
    "walking_speed": "check the frame rate, which may be wrong",
    "body_width": "check that the boxes reach from head to feet and no further",
    "population": "check person_height_m under [scale] (are they children?) and that the boxes reach from head to feet",
    "world": "check the units and coordinates under [world]",
})  # fmt: skip


def _to_check(kinds: Sequence[str | None], otherwise: str) -> str:
    """Return in words what to check for scale cues of these kinds."""
    return "; ".join(dict.fromkeys(_CUE_REMEDIES[kind] for kind in kinds if kind in _CUE_REMEDIES)) or otherwise


def _cues_disagree(v: Fields) -> str:
    cues, sigmas = v["cues"], f"{v['sigmas']:.1f} sigmas"
    if len(cues) == 2:
        one, other = (f"'{cue}' (1 sigma {sd:.1f} %)" for cue, sd in zip(cues, v["sigmas_percent"], strict=True))
        return f"the scale constraints {one} and {other} disagree by {v['percent']:.0f} %, {sigmas}"
    measured, stated = v["measured_m"], v["stated_m"]
    if v["kinds"] == ["walking_speed"]:
        return (
            f"the {cues[0]} people is {measured:.1f} m/s by the other scale constraints, but {stated:.1f} m/s is usual, "
            f"{sigmas} away"
        )
    other = f"the other evidence gives {measured:.3f} m, {sigmas} away"
    return f"the scale constraint '{cues[0]}' states {stated:.3f} m, but {other}"


def _to_agree(v: Fields) -> str:
    if len(v["cues"]) == 1:
        return _to_check(v["kinds"], "check it")
    decides = "" if v["severity"] == "notice" else ", or state a third length, which decides between them"
    return f"{_to_check(v['kinds'], 'check both')}{decides}"


SOLVER: Mapping[str, Kind] = {
    "too_little_evidence": Kind(
        REFUSAL, "A step of the calculation lacks evidence; `why` has its words.", "{why}",
        advice="record more people walking where the views overlap",
    ),
    "no_pair_fits": Kind(
        REFUSAL, "No two cameras have observations of the same people that fit one relative pose.",
        "no two cameras share {least} observations of the same people that fit one relative pose",
        "check the identities and the intrinsics, or record more people where the views overlap",
    ),
    "no_arrangement_fits": Kind(
        REFUSAL, "The pairs of cameras contradict each other.",
        "no arrangement of the cameras agrees with the people", "check their identities and the intrinsics",
    ),
    "keypoint_names_unfit": Kind(
        (*DOUBT, *REFUSAL), "The keypoint names do not order the keypoints from head to feet as the images do.",
        "the keypoint names do not fit the images (correlation of {correlation:.2f} with the order from head to feet): "
        "keypoints are matched by their number, head and feet by position",
        "write the keypoints under the names of the layout that they were detected with", joint="; ", rank="input",
    ),
    "cameras_disconnected": Kind(
        NOTICE, "Too few people seen by both connect a group of cameras to the largest one, `main`.",
        lambda v: f"{v['who']} could not be connected to {list_names(v['main'])}: too few people were seen by both at the "
        f"same time",
        "record people who walk through both views", joint="; ", common=True, rank="symptom",
    ),
    "reinitialisation_failed": Kind(
        DOUBT, "With the refined focal lengths no new initial rig was found.",
        "with the refined focal lengths no initial rig agrees with the people",
        "state focal lengths that are nearer to the true ones, or leave [solver] refine out", rank="symptom",
    ),
    "arrangement_ambiguous": Kind(
        DOUBT, "Another arrangement of all cameras fits almost as well, or of some by the paths of their people; `runner_up` "
        "is the share that other places or times of these score.",
        _ambiguous, "record longer, and people who walk in more directions, all over the ground that the cameras share; or "
        "give identities or clock offsets",
        rank="symptom",
    ),
    "rig_uncertain": Kind(
        DOUBT, "What the rig measures is too uncertain to use, or has no bound (`sigma` is null): `what` is points or ground "
        "(mm, by a camera), scale (%) or world, `lacks` what nothing fixes of the world, `why` the finding that explains it.",
        _uncertain, _to_be_certain, rank="symptom",
        subjects=lambda v: _SUBJECTS.get(v["what"], ()),
    ),
    "ground_by_hips": Kind(
        NOTICE, "No person is seen from head to feet: the height of the ground is a guess from the height of hips, shoulders "
        "or heads (`by`); `scale` and `up` have the parts of the body that give the scale and the up direction.",
        lambda v: f"no person is seen from head to feet: {_gives(v)}the height of the ground is a guess from the height of "
        f"{v.get('by', 'hips')} ({v['sigma_m']:.2f} m, 1 sigma)",
        "state the height of a camera under [[scale.camera_heights]], or turn a camera so that it sees feet",
        subjects=("vertical",),
    ),
    "few_observations": Kind(
        NOTICE, "Few observations agree with the camera's pose.",
        "camera {camera} has only {agreeing} supporting observations", "record more people in its view", rank="symptom",
    ),
    "boxes_noisy": Kind(
        NOTICE, "The heights of the boxes scatter so much that they bias the rig.",
        "half of the boxes have an error of more than {noise_percent:.0f} % of their own height, which biases shape and scale",
        "use a better detector, or images in which people are larger", subjects=("scale",), rank="symptom",
    ),
    "adjustment_not_converged": Kind(
        NOTICE, "The adjustment ended before its optimum.",
        "the adjustment did not converge", "under [solver.options] set max_iterations = 200", rank="symptom",
    ),
    "scale_cues_disagree": Kind(
        (*DOUBT, *NOTICE),
        "One of these scale constraints is wrong; the more certain is first. A notice where the scale is not in doubt.",
        _cues_disagree, _to_agree, subjects=("scale",),
    ),
    "people_unusual": Kind(
        NOTICE, "People of these `identities` are far taller or shorter than most: the scale does not use them.",
        _unusual,
        "check that these are people, not posters, prams or reflections",
        subjects=("scale",),
    ),
}  # fmt: skip
