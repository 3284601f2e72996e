"""Findings of identity association and of the search for the clocks."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.common.text import list_names
from passerby.findings.finding import Severity
from passerby.findings.texts.kinds import DOUBT, NOTICE, REFUSAL, Fields, Kind, Said

WALK = "record more people walking in the area that the cameras share"
VIEW = f"{WALK}, and check its fps and its intrinsics"
_ANY: tuple[Severity, ...] = ("notice", "refusal")
_SAID_OR_NOT: tuple[Severity, ...] = ("notice", "doubt")


def _fit(v: Fields) -> str:
    """Return in words how well the tracks of two cameras fit."""
    clauses = {
        "never_together": "no person walks in both at the same time",
        "nobody": "no person walks in it and in another camera at the same time",
        "few_in_both": "the best fit of their tracks finds {share:.0%} of the people that both should see in both",
        "contradicted": "loops through other cameras contradict the best fit of their tracks",
        "ambiguous": "the fit of their tracks is ambiguous (the second-best hypothesis scores {runner_up:.0%} of the best)",
    }
    return clauses[v["fit"]].format_map(v)


def _fixed(v: Fields) -> Said | None:
    """Return the change with which the tracks would fit; None if none is known."""
    found: Said | None = v.get("fixed_by")
    return found


def _unregistered(v: Fields) -> str:
    to = "" if v["to"] is None else f" to {v['to']}"
    so, fixed = "" if v["timed"] else "has an unknown clock offset and ", _fixed(v)
    text = f"camera {v['camera']} {so}could not be registered{to}: {_fit(v)}"
    return text if fixed is None else f"{text}: {fixed.problem}"


def _pair(v: Fields) -> str:
    text, fixed = f"cameras {v['camera']} and {v['second']}: {_fit(v)}", _fixed(v)
    return text if fixed is None else f"{text}: {fixed.problem}"


def _clock(v: Fields) -> str:
    side = "ahead of" if v["ahead_s"] > 0 else "behind"
    return f"the clock of {v['camera']} is {abs(v['ahead_s']):.1f} s {side} the clock of {v['second']}"


def _drifts(v: Fields) -> str:
    if len(v["names"]) > 1:
        return f"the clocks of {v['camera']} and {v['second']} drift apart by {v['drift_s']:.2f} s"
    return (
        f"the clock of {v['camera']} drifts by {v['drift_s']:.2f} s over {v['span_s']:.0f} s: its tracks fit about "
        f"{v['fits_fps']:.4g} frames per second better than the stated {v['fps']:.4g}"
    )


def _minutes(seconds: float) -> str:
    """Format a time, in seconds and, from 600 s, also in minutes."""
    return f"{seconds:.1f} s" if seconds < 600 else f"{seconds:.0f} s ({seconds / 60:.0f} min)"


def _starts_apart(v: Fields) -> str:
    later = ", ".join(f"that of {name} {_minutes(seconds)}" for name, seconds in v["later_s"].items())
    return (
        f"the recordings begin at different times, found by {' and '.join(v['found_by'])}: {later} after that of {v['camera']}"
    )


def _by_files(v: Fields) -> str:
    later = ", ".join(
        f"that of {name} {_minutes(abs(seconds))} {'after' if seconds >= 0 else 'before'}"
        for name, seconds in v["later_s"].items()
    )
    return f"by the {v['found_by']}s in their files the recordings begin at different times: {later} that of {v['camera']}"


def _start_unknown(v: Fields) -> str:
    why = "no clock offset fits its tracks to another camera's significantly"
    if v["lags_s"]:
        why = f"clock offsets of {' and '.join(map(_minutes, v['lags_s']))} fit its tracks equally well"
    return f"the start of the recording of {v['who']} is unknown: {why}, of all up to {_minutes(v['searched_s'])}"


def _start_contradicted(v: Fields) -> str:
    return (
        f"by {v['found_by']} the recording of {v['camera']} begins {v['measured_s']:.2f} s after that of {v['second']}, by the "
        f"tracks of people {v['people_s']:.2f} s: the tracks were used"
    )


def _nobody_shared(v: Fields) -> str:
    several = len(v["names"]) > 1
    groups = v.get("groups", 1)
    separate = f" and form {'a separate group' if groups == 1 else f'{groups} separate groups'}" if several else ""
    return f"{v['who']} share{'' if several else 's'} no people with {list_names(v['main'])}{separate}"


def _separate(v: Fields) -> str:
    among = "" if v["registered"] == len(v["names"]) else f", {v['registered']} of them with a pose"
    found = f"{v['who']} are group {v['group']}, calibrated by themselves in {v['folder']} ({v['verdict']}{among})"
    if "nearest" not in v:
        return found
    first, second = v["nearest"]
    if v["people"] >= v["needed"]:
        but = "both groups see too few of them at one time" if v["open"] else "a common rig contradicts the groups"
        return f"{found}; people pass to another group between {first} and {second}, but {but}"
    return (
        f"{found}; people who may pass to another group do so between {first} and {second}: {v['people']} of the "
        f"{v['needed']} that would join the groups"
    )


_JOIN = "give known positions of cameras of each group under [world], or record people where their views overlap"


def _to_share(v: Fields) -> str:
    if v["given"]:
        return "give the same person the same identity in all cameras, and synchronised frames the same frame number"
    return (
        "search for larger clock offsets: under [association] set max_offset_s to the largest difference between the clocks, "
        "in seconds"
    )


ASSOCIATION: Mapping[str, Kind] = {
    "no_shared_people": Kind(
        REFUSAL, "No two cameras saw the same person at the same time; `given` says whether identities are known.",
        "no two cameras see the same person at the same time", _to_share,
    ),
    "cameras_share_nobody": Kind(
        _ANY, "No person connects a group of cameras, or several `groups`, to the largest group, `main`.",
        _nobody_shared, lambda v: f"record people where their views overlap, or {_to_share(v)}",
    ),
    "separate_group": Kind(
        NOTICE, "A group of cameras that shares no people with the main rig has a rig of its own, in `folder`.",
        _separate, "its frame, scale and clock are its own; to join it, " + _JOIN, joint="; ",
    ),
    "groups_joined": Kind(
        NOTICE, "Groups of cameras that share too little ground to be registered are one rig, by people who pass between them.",
        "{people} people who pass between {camera} and {second} join two groups of {sizes[0]} and {sizes[1]} cameras; the "
        "standard deviations include how well their relative pose is known", "",
    ),
    "no_pair_registered": Kind(
        REFUSAL, "The ground tracks of no two cameras fit each other.",
        "no two cameras could be registered by the tracks of people", WALK,
    ),
    "pair_unregistered": Kind(
        REFUSAL, "How far the ground tracks of two cameras fit, and what would make them fit.",
        _pair, lambda v: "" if (fixed := _fixed(v)) is None else fixed.remedy, advice=VIEW,
    ),
    "nobody_seen_whole": Kind(
        _ANY, "In all its boxes people are cut off or hidden.",
        "{who} saw no person from head to feet and cannot be calibrated",
        "turn or raise the camera so that whole people are in view", common=True,
    ),
    "few_walkers": Kind(
        _ANY, "The camera has no ground tracks.",
        "{who} saw too few people who walk for a second or longer", WALK, common=True,
    ),
    "camera_unregistered": Kind(
        NOTICE, "The camera's ground tracks fit no other camera's; `fit` says how far, `fixed_by` what would make them fit.",
        _unregistered, lambda v: VIEW if (fixed := _fixed(v)) is None else fixed.remedy, rank="symptom",
    ),
    "other_rate_fits": Kind(
        NOTICE, "With another frame rate the camera's people are where the second camera sees them.",
        "at {fits_fps:.4g} frames per second instead of {fps:.4g} {share:.0%} of the people seen by {camera} are where "
        "{second} sees them",
        "check its fps",
    ),
    "clock_far_off": Kind(
        NOTICE, "With a larger clock offset than was searched for the two cameras fit.",
        _clock, "search for larger clock offsets: under [association] set max_offset_s = {search_s}",
    ),
    "starts_apart": Kind(
        NOTICE, "Recordings begin more than a minute apart; `later_s` says how long after the first camera's each begins.",
        _starts_apart,
    ),
    "file_clocks_differ": Kind(
        NOTICE, "By the creation times or timecodes of their files, recordings begin farther apart than is searched for; that "
        "is searched too. `later_s` says how long after the first camera's each begins.",
        lambda v: f"{_by_files(v)}; clock offsets are searched within {v['search_s']:g} s of that, and of 0",
        lambda v: f"if people agree with neither: under [association] set max_offset_s = {v['most_s']:.0f}, which searches all "
        "clock offsets up to that",
    ),
    "file_clocks_unused": Kind(
        NOTICE, "By the creation times or timecodes of their files, recordings begin so far apart that they barely overlap; "
        "these times are not used.",
        lambda v: f"{_by_files(v)}; that is not used, because the recordings would barely overlap",
        lambda v: f"if they do: under [association] set max_offset_s = {v['most_s']:.0f}",
    ),
    "start_unknown": Kind(
        _ANY, "Recordings may begin minutes or hours apart, and the camera's people fit no other camera's at one offset alone.",
        _start_unknown,
        "record for a longer time together, or state the times: name the files by their times, or cut the recordings to the "
        "same time and set max_offset_s = 5 under [association]",
    ),
    "start_contradicted": Kind(
        NOTICE, "A clock or sound contradicts the tracks of people about when a recording began.",
        _start_contradicted, "check the clocks of the recorders",
    ),
    "offset_by_sound": Kind(
        NOTICE, "The sound of two cameras' videos tells when the recording of the first began after that of the second.",
        lambda v: f"by sound the recording of {v['camera']} begins {abs(v['offset_s']):.2f} s "
        f"{'after' if v['offset_s'] > 0 else 'before'} that of {v['second']} (1 sigma {v['sigma_s']:.2f} s)",
    ),
    "sound_unusable": Kind(
        NOTICE, "The camera's video has sound that tells nothing about its clock; `why` says what it lacks.",
        "camera {camera}: {why}: its clock offset is not determined by sound",
    ),
    "sound_unheard": Kind(
        NOTICE, "The videos of these cameras have sound, which a calibration will compare.",
        "cameras {cameras}: their videos have sound: `passerby calibrate` compares it to find the clock offsets",
    ),
    "people_stand_still": Kind(
        DOUBT, "Fewer than two registered cameras saw anybody walk.",
        "the people stand still, so neither their identities nor the clock offsets are reliable", WALK,
    ),
    "clock_drifts": Kind(
        _SAID_OR_NOT, "The camera's clock runs at another rate than stated; of two cameras alone: one of the two clocks.",
        _drifts, 'check fps, or estimate it: under [solver] set refine = ["clock_rate"]', rank="motion",
    ),
    "clock_fitted": Kind(
        NOTICE, "The camera's frame rate was estimated.",
        "the frame rate of {camera} was estimated: {fps:.6g} frames per second (1 sigma {sigma:.1g}) instead of the stated "
        "{stated:.6g}",
    ),
    "clock_unknown": Kind(
        NOTICE, "The tracks of the same people do not determine the camera's clock offset.",
        "the clock offset of {who} is unknown: the tracks of the same people do not determine it",
        "record more people walking in the area shared with the others, or start the cameras at the same time",
        joint="; ",
    ),
    "no_embeddings": Kind(
        REFUSAL, 'Mode "appearance": no two cameras have tracklets with embeddings.',
        "no two cameras have tracklets with embeddings", "provide embeddings for the boxes of every camera",
    ),
    "embeddings_useless": Kind(
        REFUSAL, 'Mode "appearance": the embeddings distinguish people no better than chance.',
        "the embeddings do not distinguish people across cameras: they are no better than chance in any pair",
        "use a network trained for such people, or use their tracks on the ground: under [association] set "
        'mode = "combined"',
        joint="; ",
    ),
    "registered_by_keypoints": Kind(
        NOTICE, "The cameras were registered by the keypoints of moving people; their clock offsets were not estimated.",
        lambda v: f"cameras {', '.join(v['names'][:-1])} and {v['names'][-1]} were registered by the keypoints of moving "
        f"people, because no person walks through their views; their clock offsets were not estimated",
    ),
    "registered_by_rig": Kind(
        NOTICE, "The camera was registered by the people whom the other cameras locate, not by any pair of cameras.",
        "camera {camera} was registered by the people whom the other cameras locate, because no pair of cameras with it could "
        "be registered",
    ),
}  # fmt: skip
