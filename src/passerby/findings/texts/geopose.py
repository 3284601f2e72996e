"""Findings of the method `geopose`."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.finding import Severity
from passerby.findings.texts.kinds import NOTICE, REFUSAL, Kind

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
