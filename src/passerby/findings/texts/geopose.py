"""Findings of the method `geopose`."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.finding import Severity
from passerby.findings.texts.kinds import DOUBT, REFUSAL, Kind

_EITHER: tuple[Severity, ...] = ("doubt", "refusal")
_OVERLAP = "record people who walk where the views of these cameras overlap"

GEOPOSE: Mapping[str, Kind] = {
    "keypoint_ends_unnamed": Kind(
        _EITHER, "The joints' names do not fit the pictures: the highest and lowest joints are taken for head and feet.",
        "the joints' names do not fit the pictures (correlation of {correlation:.2f} with the order from head to feet): "
        "joints are "
        "matched by number, and the highest and lowest ones stand in for head and feet",
        "check the layout of the keypoint files", joint="; ",
    ),
    "pair_failed": Kind(
        _EITHER, "The camera could not be registered with the reference, `second`, for the `cause`.",
        "camera {camera} could not be registered with {second}: {cause.problem}",
        "{cause.remedy}", joint="{cause.joint}", advice=_OVERLAP,
    ),
    "few_common_points": Kind(
        REFUSAL, "Two cameras have few points in common.",
        "{common} common points, {needed} are needed", advice=_OVERLAP,
    ),
    "few_agreeing_points": Kind(
        REFUSAL, "Few of the common points of two cameras agree on a relative pose.",
        "{agreeing} of {common} common points agree on one relative pose, {needed} are needed", advice=_OVERLAP,
    ),
    "few_usable_points": Kind(
        REFUSAL, "Few of the common points of two cameras can be used for a relative pose.",
        "{usable} common points do not fix a relative pose: at least {needed} are needed", advice=_OVERLAP,
    ),
    "no_relative_pose": Kind(
        REFUSAL, "No relative pose was found for two cameras.",
        "no relative pose agrees with the {common} common points", advice=_OVERLAP,
    ),
    "relative_pose_weak": Kind(
        REFUSAL, "The best relative pose of two cameras agrees with few of their common points.",
        "the best relative pose agrees with {agreeing} of {common} common points: at least {needed} are needed",
        advice=_OVERLAP,
    ),
    "people_do_not_stand": Kind(
        REFUSAL, "By the pair's pose hardly anybody has head and feet: it is its mirror image.",
        "heads and feet of only {standing} of {shared} people seen by both meet in its pose, so it is wrong (points on "
        "one level "
        "cannot tell apart two poses of cameras that face each other)",
        "choose another reference camera",
    ),
    "few_whole_people": Kind(
        REFUSAL, "Too few people were seen whole by two cameras to find the vertical and the scale.",
        "{seen} people were seen from head to feet by two cameras at once: at least {needed} are needed to find the "
        "vertical and "
        "the scale",
        "let people walk where the pictures hold them whole", joint="; ",
    ),
    "few_upright_people": Kind(
        REFUSAL, "Too few upright people were measured to find the scale.",
        "{seen} upright people were measured: at least {needed} are needed for the scale",
        advice="let people walk where the pictures hold them whole",
    ),
    "few_inliers": Kind(
        DOUBT, "Few of the points that the camera shares with the reference agree with its pose.",
        "only {share:.0%} of the points that camera {camera} shares with the reference agree with its pose", advice=_OVERLAP,
    ),
    "near_reference": Kind(
        DOUBT, "The camera looks from almost where the reference stands.",
        "camera {camera} looks from almost where the reference stands (rays meet at {parallax_deg:.1f} degrees): its "
        "distance is "
        "not known",
        "choose another reference", joint="; ",
    ),
    "pairs_disagree": Kind(
        DOUBT, "The pairs place the same points differently.",
        "the pairs place the same {what} {share:.0%} of their distance apart: at least one pair is wrong",
        "try another reference camera or {other}", joint="; ",
    ),
    "global_adjustment_not_converged": Kind(
        DOUBT, "The global adjustment ended before its optimum.",
        "the global adjustment did not converge in {iterations} iterations",
        advice="record longer, or under [solver.options] set max_iterations = 200",
    ),
}  # fmt: skip
