"""Findings about the files of a scene, and of cameras that show one another's pictures."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import DOUBT, NOTICE, Fields, Kind

_OF_THAT_SIZE = "Give a lens for pictures of that size, or scale the boxes and joints to the size of the lens"


def _guessed(v: Fields) -> str:
    text = f"the focal length of {v['who']} is a guess with one sigma of {v['sd_percent']:g} %"
    return f"{text}: it is the prior of their refinement" if v["refined"] else f"{text}: it is in every sigma"


def _spans(v: Fields) -> str:
    spans = ", ".join(
        f"{one['camera']} {one['seconds']:.1f} s (frames {one['frames'][0]} to {one['frames'][1]} at {one['fps']:g} fps)"
        for one in v["spans"]
    )
    others = "" if v["usual_s"] is None else f"; the other cameras about {v['usual_s']:.1f} s"
    return f"by their frame rates the recordings differ in length: {spans}{others}"


def _doubled(v: Fields) -> str:
    camera = f"camera {v['camera']}: " if v["names"] else ""
    who = "nobody known" if v["identity"] is None else f"id {v['identity']}"
    text = f"{camera}{v['doubled']} of {v['rows']} rows stand for somebody who has another row in the same frame"
    ending = ", which is too often for a slip" if v["too_many"] else ": of each the better row is used"
    return f"{text} (first: {who} in frame {v['frame']}){ending}"


def _same(v: Fields) -> str:
    scaled = "" if abs(v["scale"] - 1) < 0.02 else f", {v['scale']:.2f} times as large"
    amount = f"{abs(v['later']):.1f}" if v["timed"] else f"{abs(v['later']):.0f}"
    way = "later" if v["later"] > 0 else "earlier"
    shifted = "" if float(amount) == 0 else f", {amount} {'s' if v['timed'] else 'frames'} {way}"
    return (
        f"cameras {v['camera']} and {v['second']} show the same: {v['share']:.0%} of the people of the one are at the "
        f"same places "
        f"in the pictures of the other{scaled}{shifted}"
    )


def _short(v: Fields) -> str:
    cameras = ", ".join(f"{name} ({seconds:.1f} s)" for name, seconds in v["seconds"].items())
    return (
        f"what camera{'s' if len(v['names']) > 1 else ''} {cameras} recorded is too short to tell cameras by how people "
        f"walk, which "
        f"takes more than {v['shortest_s']:g} s"
    )


INPUT_FILES: Mapping[str, Kind] = {
    "same_recording": Kind(
        DOUBT, "Two cameras show the same pictures.",
        _same, "give each camera a recording of its own, or delete [cameras.{second}]",
    ),
    "same_place": Kind(
        DOUBT, "Two cameras stand at one place, look one way, and their people do not tell them apart.",
        "cameras {camera} and {second} stand {distance_m:.2f} m apart and look the same way, and their people do not tell "
        "them apart",
        "if it is one camera, delete [cameras.{second}]; if not, record people near them",
    ),
    "smaller_image_cut": Kind(
        DOUBT, "People keep to a part of the picture and are cut off at its edge: they were found in smaller pictures.",
        "camera {camera}: all people lie within {seen_size[0]} x {seen_size[1]} of the {size[0]} x {size[1]} picture, and "
        "{cut} are "
        "cut off just there: were they found in pictures of {seen_size[0]} x {seen_size[1]}?",
        _OF_THAT_SIZE, joint=" ",
    ),
    "image_upside_down": Kind(
        DOUBT, "The camera's people stand on their heads.",
        "{who}: people stand on their heads: the picture seems flipped top to bottom, or the camera hangs upside down",
        "turn its pictures the right way up, with the boxes and joints in them", common=True,
    ),
    "recordings_short": Kind(
        DOUBT, "The recordings are too short for people to be followed, and joints are not used.",
        _short,
        lambda v: "record longer" if v["network"] is None else "record longer, or go by the joints of people: under "
        "[perception] "
        f'set keypoints = "{v["network"]}"',
    ),
    "identity_unseen": Kind(
        NOTICE, "The scene file states the height of a person that no camera sees.",
        "[[scale.people]]: identity {identity} is seen by no camera; its height says nothing",
    ),
    "focal_guessed": Kind(
        NOTICE, "The scene file says that the cameras' focal length is a guess.",
        _guessed,
        lambda v: "" if v["refined"] else "calibrate the lens with a pattern and delete focal_sd_percent, or write refine = "
        '["focal"] under [solver]',
    ),
    "frame_rate_missing": Kind(
        NOTICE, "No frame rate is known, so that clocks are not searched for.",
        "no frame rate is given: frame numbers are taken to be counted alike in all cameras, and no difference of their "
        "clocks is "
        "searched for",
        "under [scene] set fps to the frame rate, or under [association] set max_offset_s = 0",
    ),
    "recordings_differ": Kind(
        NOTICE, "By their frame rates the recordings differ in length.",
        _spans, "check fps, unless people were there for a part of the time only",
    ),
    "embeddings_missing": Kind(
        NOTICE, "Some cameras have embeddings, and these have none.",
        lambda v: f"{v['who']} ha{'ve' if len(v['names']) > 1 else 's'} no embeddings: people there are known by how they "
        f"move alone",
    ),
    "video_cropped": Kind(
        NOTICE, "The video's pictures are slightly smaller than the lens is for.",
        "camera {camera}: its pictures are {video_size[0]} x {video_size[1]}, the lens's {size[0]} x {size[1]}: the last "
        "columns or "
        "rows are taken to be cut off, as codecs do",
    ),
    "video_rate_variable": Kind(
        NOTICE, "The video's pictures come at a variable rate; their own times are used.",
        "camera {camera}: the pictures' own times are used, since they come at a variable rate, not fps",
    ),
    "video_rate_differs": Kind(
        NOTICE, "The video and the scene file say different frame rates.",
        "camera {camera}: the video says {video_fps:g} frames per second, the scene file {fps:g}: the scene file is believed",
    ),
    "detections_unused": Kind(
        NOTICE, "The camera has tracks, so that its detections are not used.",
        "[cameras.{camera}] detections are not used, since there are tracks",
    ),
    "unused_with_identities": Kind(
        NOTICE, "What `key` names is not used where identities are given.",
        '[cameras.{camera}] {key} are not used in mode "given"',
    ),
    "camera_saw_nobody": Kind(
        NOTICE, "The camera saw nobody; it cannot be calibrated.",
        lambda v: f"[cameras.{v['camera']}] camera {v['camera']} saw nobody: "
        f"{'nobody was found in its video' if v['watched'] else 'its files have no rows'}, it cannot be calibrated",
    ),
    "file_empty": Kind(
        NOTICE, "A file of the camera has no rows.", "camera {camera} saw nobody: the file has no rows",
    ),
    "ids_no_tracklets": Kind(
        NOTICE, "Most ids stand in few rows: the rows are taken as detections.",
        "camera {camera}: {short} of {rows} rows have an id that stands in fewer than {least} rows: such ids are no "
        "tracklets, all "
        "rows are taken as detections",
    ),
    "rows_without_identity": Kind(
        NOTICE, "Some rows have no identity and are not used.",
        "camera {camera}: {unknown} of {rows} rows have no identity and are not used",
    ),
    "duplicate_rows": Kind(
        NOTICE, "One identity has several rows in one frame; with `too_many` of them the file cannot be used.",
        _doubled, lambda v: "give every person in a frame an id of their own, once" if v["too_many"] else "",
    ),
    "principal_point_outside_image": Kind(
        NOTICE, "The principal point lies outside the picture.",
        "[{camera}] the principal point {point} lies outside the {size[0]} x {size[1]} picture: wrong image size? Matrix "
        "and size "
        "must be of one picture",
    ),
    "people_outside_image": Kind(
        NOTICE, "Some people lie outside the picture.",
        "camera {camera}: {outside} of {people} people lie outside the {size[0]} x {size[1]} picture (first: frame "
        "{frame}, from "
        "{corners[0]} to {corners[1]})",
    ),
    "people_in_part_of_image": Kind(
        NOTICE, "All people keep to a part of the picture: its size may be wrong.",
        "camera {camera}: all people lie within {across:.0%} of the width and {down:.0%} of the height: wrong image size? "
        "perhaps "
        "the size {size[0]} x {size[1]} in {intrinsics} is not that of the picture in which they were found",
    ),
}  # fmt: skip
