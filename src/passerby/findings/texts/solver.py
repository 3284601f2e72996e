"""Findings of the person-model solver."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import DOUBT, REFUSAL, Fields, Kind


def _undetermined(v: Fields) -> str:
    lacks = v["lacks"]
    what = " and ".join(filter(None, (", ".join(f"the {one}" for one in lacks[:-1]), f"the {lacks[-1]}")))
    return f"nothing fixes {what}"


def _to_determine(v: Fields) -> str:
    if v["lacks"] == ["scale"]:
        return "give a measured length under [scale], or boxes, or joints with heads and ankles"
    length = "; a measured length under [scale] fixes the scale, but no vertical" if "scale" in v["lacks"] else ""
    return f"give boxes, or joints with heads and ankles, of people seen whole by two cameras{length}"


SOLVER: Mapping[str, Kind] = {
    "too_little_evidence": Kind(
        REFUSAL, "A step of the calculation lacks evidence; `why` has its words.", "{why}",
        advice="record more people who walk where the views overlap",
    ),
    "no_pair_fits": Kind(
        REFUSAL, "No two cameras have observations of the same people that fit one relative pose.",
        "no two cameras share {least} sightings of the same people that fit one motion",
        "check the identities and the intrinsics, or record more people where the views overlap",
    ),
    "no_arrangement_fits": Kind(
        REFUSAL, "The pairs of cameras contradict each other.",
        "no arrangement of the cameras agrees with the people", "check their identities and the intrinsics",
    ),
    "keypoint_names_unfit": Kind(
        DOUBT, "The joints' names do not order them from head to feet as the pictures do.",
        "the joints' names do not fit the pictures (they order them from head to feet with a correlation of "
        "{correlation:.2f}): "
        "is it another layout than the file says? Joints are matched by their number, head and feet by position",
        advice="write the joints under the names of the layout that they were found with",
    ),
    "cameras_disconnected": Kind(
        DOUBT, "Too few of the same people join a group of cameras to the largest one, `main`.",
        lambda v: f"{v['who']} could not be joined to {', '.join(v['main'])}: too few of the same people were seen by "
        f"both at the "
        "same instants",
        "record people who walk through both views", joint="; ", common=True,
    ),
    "reinitialisation_failed": Kind(
        DOUBT, "With the refined focal lengths the cameras' arrangement could not be guessed anew.",
        "with the refined focal lengths no first guess at the cameras' arrangement agrees with the people",
        "state focal lengths that are nearer to the true ones, or leave [solver] refine out",
    ),
    "arrangement_ambiguous": Kind(
        DOUBT, "Another arrangement of the cameras fits almost as well.",
        "two arrangements of the cameras fit the people almost equally well", "record people who walk in more directions",
    ),
    "world_undetermined": Kind(
        DOUBT, "No evidence fixes the parts of the world in `lacks`: scale, vertical or height of the ground.",
        _undetermined, _to_determine, subjects=("scale", "vertical"),
    ),
    "camera_undetermined": Kind(
        DOUBT, "No evidence fixes where the camera stands among the others.",
        "nothing fixes where camera {camera} stands among the others",
        "record more people, seen from head to feet, in the view that it shares with them",
    ),
    "few_observations": Kind(
        DOUBT, "Few observations agree with the camera's pose.",
        "camera {camera} rests on {agreeing} sightings only", "record more people in its view",
    ),
    "camera_disagrees_at_times": Kind(
        DOUBT, "In one stretch of the recording the camera contradicts the rig.",
        "camera {camera}: {most:.0%} of its sightings agree with the rig at one time, but {least:.0%} between "
        "{from_percent:.0f} and {to_percent:.0f} % of the recording",
        "see whether it was moved, whether frames are missing and whether its clock keeps step",
    ),
    "camera_disagrees": Kind(
        DOUBT, "Most of what the camera saw contradicts the rig.",
        "camera {camera}: only {agreeing} of {seen} sightings agree with the rig",
        "check its intrinsics, its clock and the identities",
    ),
    "camera_uncertain": Kind(
        DOUBT, "The camera's pose is uncertain, within the rig.",
        "camera {camera} is uncertain by {position_mm:.0f} mm and {orientation_deg:.1f} degrees",
        "record longer, or people nearer to it and in more places",
    ),
    "vertical_uncertain": Kind(
        DOUBT, "The direction of up is uncertain.",
        "the vertical is uncertain by {sigma_deg:.1f} degrees", "record people who walk about, seen from head to feet",
        subjects=("vertical",),
    ),
    "boxes_noisy": Kind(
        DOUBT, "The heights of the boxes scatter so much that they bias the rig.",
        "half of the boxes are off by more than {noise_percent:.0f} % of their own height, which biases shape and scale",
        "use a better detector, or pictures in which people are larger", subjects=("scale",),
    ),
    "adjustment_not_converged": Kind(
        DOUBT, "The adjustment ended before its optimum.",
        "the adjustment did not converge", "under [solver.options] set max_iterations = 200",
    ),
    "scale_cue_contradicted": Kind(
        DOUBT, "A scale cue contradicts the rest.",
        "the scale cue '{cue}' says {stated_m:.3f} m, but the rest makes it {measured_m:.3f} m, {sigmas:.0f} sigmas off",
        "check it", subjects=("scale",),
    ),
}  # fmt: skip
