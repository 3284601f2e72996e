"""Findings about the files of a scene: boxes, keypoints, intrinsics, videos, and the networks that detect people."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import DOUBT, NOTICE, Fields, Kind

_INSTEAD = {
    "detector": "people are detected by background subtraction, without a neural network",
    "embedder": "appearance is described by colour histograms of horizontal stripes, without a neural network",
    "keypoints": "keypoints are not detected",
}


def _guessed(v: Fields) -> str:
    text = f"the focal length of {v['who']} is a guess with 1 sigma of {v['sd_percent']:g} %"
    return f"{text}: it is the prior of the refinement" if v["refined"] else f"{text}: every reported uncertainty includes it"


def _spans(v: Fields) -> str:
    spans = ", ".join(
        f"{one['camera']} {one['seconds']:.1f} s (frames {one['frames'][0]} to {one['frames'][1]} at {one['fps']:g} fps)"
        for one in v["spans"]
    )
    others = "" if v["usual_s"] is None else f"; the other cameras have about {v['usual_s']:.1f} s"
    return f"the recordings differ in length according to their frame rates: {spans}{others}"


def _doubled(v: Fields) -> str:
    camera = f"camera {v['camera']}: " if v["names"] else ""
    who = "an unknown identity" if v["identity"] is None else f"id {v['identity']}"
    text = f"{camera}{v['doubled']} of {v['rows']} rows repeat an identity that has another row in the same frame"
    ending = ", which is too often for a mistake" if v["too_many"] else ": the better row of each is used"
    return f"{text} (first: {who} in frame {v['frame']}){ending}"


def _same(v: Fields) -> str:
    scaled = "" if abs(v["scale"] - 1) < 0.02 else f", {v['scale']:.2f} times as large"
    amount = f"{abs(v['later']):.1f}" if v["timed"] else f"{abs(v['later']):.0f}"
    way = "later" if v["later"] > 0 else "earlier"
    shifted = "" if float(amount) == 0 else f", {amount} {'s' if v['timed'] else 'frames'} {way}"
    return (
        f"cameras {v['camera']} and {v['second']} show the same images: {v['share']:.0%} of the people of one camera are at "
        f"the same positions in the images of the other{scaled}{shifted}"
    )


def _short(v: Fields) -> str:
    what, verb = ("the recordings of cameras", "are") if len(v["names"]) > 1 else ("the recording of camera", "is")
    cameras = ", ".join(f"{name} ({seconds:.1f} s)" for name, seconds in v["seconds"].items())
    return (
        f"{what} {cameras} {verb} too short to register cameras by how people walk, which takes more than {v['shortest_s']:g} s"
    )


def _off_centre(v: Fields) -> str:
    beyond, near, seem = ("right and lower", "left and upper", "be given by their centres")
    if "centres" not in v["box_format"]:
        beyond, near, seem = near, beyond, f"be {v['box_format']}, not {v['stated']}"
    if v["beyond"] is None:
        side = "below" if v["shift"] > 0 else "above"
        return f"{v['who']}: taller people reach farther {side} the ground than shorter ones: the boxes seem to {seem}"
    return (
        f"{v['who']}: {v['beyond']} boxes reach beyond the {beyond} borders of the images, and few come near the {near} ones: "
        f"the boxes seem to {seem}"
    )


INPUT_FILES: Mapping[str, Kind] = {
    "streams_seem_exchanged": Kind(
        DOUBT, "From `frames` on, the files of two cameras seem to show what the other camera sees.",
        "cameras {camera} and {second} seem to be exchanged from frames {frames[0]} and {frames[1]} on: {boxes} boxes "
        "continue in the other camera's file and not in their own",
        "look at both recordings around these frames; if it is so, exchange the rest of the two files, or use one part of both",
        rank="input",
    ),
    "same_recording": Kind(
        DOUBT, "Two cameras show the same images.",
        _same, "give each camera a recording of its own, or delete [cameras.{second}]", rank="input",
    ),
    "same_place": Kind(
        DOUBT, "Two cameras have the same pose, and their people do not distinguish them.",
        "cameras {camera} and {second} are {distance_m:.2f} m apart and face the same direction, and their people do not "
        "distinguish them",
        "if they are one camera, delete [cameras.{second}]; if not, record people near them", rank="input",
    ),
    "keypoint_layout_corrected": Kind(
        NOTICE, "The keypoints have the names of one layout, and lie in the images as those of another: they get its names.",
        "{who}: the keypoints are named as those of {stated}, but lie in the images as those of {layout}: they are taken as "
        "{layout} (correlation of {correlation:.2f} with the order from head to feet)",
        "name them so in the files", common=True,
    ),
    "boxes_by_centres": Kind(
        DOUBT, "Boxes reach beyond two borders of the images and keep away from the others, or lie on bodies of different "
        "heights as if shifted by half a box: their centres were read as their left and upper edges, or these as centres.",
        _off_centre, "under [scene] set boxes = \"{box_format}\", or under [cameras.{camera}] for one camera", rank="input",
    ),
    "boxes_coarse": Kind(
        NOTICE, "The edges of the camera's boxes lie on a grid that is coarse beside people.",
        "{who}: the edges of the boxes are multiples of {step_px} px, and people are {height_px:.0f} px tall: the boxes are "
        "quantised to a coarse grid, so that they are larger than people",
        "detect people in the images themselves", common=True, rank="input",
    ),
    "recordings_short": Kind(
        NOTICE, "The recordings are too short to follow people, and keypoints are not used.",
        _short,
        lambda v: "record longer" if v["network"] is None else "record longer, or use keypoints: under "
        "[perception] "
        f'set keypoints = "{v["network"]}"',
    ),
    "identity_unseen": Kind(
        NOTICE, "The scene file states the height of a person that no camera sees.",
        "[[scale.people]]: identity {identity} is not seen by any camera; its height is not used",
    ),
    "pointed_people_overlap": Kind(
        NOTICE, "The scene file points at a pixel where several people overlap.",
        "{count} people overlap at [{at[0]:g}, {at[1]:g}] in camera {camera} in frame {frame}: the nearest one "
        "is meant, whose box is {box[2]:.0f} x {box[3]:.0f} px at left {box[0]:.0f}, top {box[1]:.0f}",
        "if that is another person, point at a time at which the person stands alone",
    ),
    "focal_guessed": Kind(
        NOTICE, "The scene file says that the cameras' focal length is a guess.",
        _guessed,
        lambda v: "" if v["refined"] else "calibrate the intrinsics with a pattern and delete focal_sd_percent, or write "
        "refine = "
        '["focal"] under [solver]',
    ),
    "focal_from_metadata": Kind(
        NOTICE, "The camera's focal length is estimated about the one in its video's metadata.",
        "camera {camera}: its focal length is estimated about the {focal_35mm:g} mm (35 mm equivalent) in the video's "
        "metadata: {focal_px:.0f} px, sigma {sd_percent:.0f} %",
        "if the video was cropped or zoomed, state hfov_deg or focal_35mm",
    ),
    "intrinsics_unknown": Kind(
        NOTICE, "The cameras have no intrinsics; they are estimated together with the rig.",
        "{who}: no intrinsics: focal length, principal point and distortion are estimated together with the rig", common=True,
    ),
    "frame_rate_missing": Kind(
        NOTICE, "No frame rate is known, so clock offsets are not estimated.",
        "no frame rate is given: equal frame numbers are assumed to be synchronised in all cameras, and clock offsets are "
        "not estimated",
        "under [scene] set fps to the frame rate, or under [association] set max_offset_s = 0",
    ),
    "recordings_differ": Kind(
        NOTICE, "The recordings differ in length according to their frame rates.",
        _spans, "check fps, unless people were present for only part of the time",
    ),
    "embeddings_missing": Kind(
        NOTICE, "Some cameras have embeddings, but these have none.",
        lambda v: f"{v['who']} ha{'ve' if len(v['names']) > 1 else 's'} no embeddings: people there are identified by their "
        f"motion only",
    ),
    "video_cropped": Kind(
        NOTICE, "The video's frames are slightly smaller than the image size of the intrinsics.",
        "camera {camera}: its video frames are {video_size[0]} x {video_size[1]}, the image size of its intrinsics is "
        "{size[0]} x {size[1]}: the codec is assumed to have cut off the last columns or rows",
    ),
    "people_excluded": Kind(
        NOTICE, "People in excluded regions of the image were left out.",
        "[cameras.{camera}] exclude: {left_out} of {rows} detected people have their feet in the excluded regions and were "
        "left out",
    ),
    "video_rate_variable": Kind(
        NOTICE, "The video's frame rate is variable; the timestamps of its frames are used.",
        "camera {camera}: the frame rate is variable, so the timestamps of the frames are used, not fps",
    ),
    "video_rate_differs": Kind(
        NOTICE, "The video and the scene file state different frame rates.",
        "camera {camera}: the video states {video_fps:g} frames per second, the scene file {fps:g}: the value of the scene "
        "file is used",
    ),
    "keypoints_folder": Kind(
        NOTICE, "How a folder of keypoints, one file per frame, was read, or what in it was left out; `why` says it.",
        "camera {camera}: {why}",
    ),
    "detections_unused": Kind(
        NOTICE, "The camera has tracks, so that its detections are not used.",
        "[cameras.{camera}] detections are not used, because there are tracks",
    ),
    "unused_with_identities": Kind(
        NOTICE, "What `key` names is not used where identities are known.",
        '[cameras.{camera}] {key} are not used in mode "given"',
    ),
    "camera_saw_nobody": Kind(
        NOTICE, "The camera saw no person; it cannot be calibrated.",
        lambda v: f"[cameras.{v['camera']}] camera {v['camera']} saw no person: "
        f"{'no person was detected in its video' if v['watched'] else 'its files have no rows'}, so it cannot be calibrated",
    ),
    "file_empty": Kind(
        NOTICE, "A file of the camera has no rows.", "camera {camera} saw no person: the file has no rows",
    ),
    "ids_no_tracklets": Kind(
        NOTICE, "Most ids occur in few rows: the rows are treated as detections.",
        "camera {camera}: {short} of {rows} rows have an id that occurs in fewer than {least} rows: such ids are not "
        "tracklets, so all rows are treated as detections",
    ),
    "rows_without_identity": Kind(
        NOTICE, "Some rows have no identity and are not used.",
        "camera {camera}: {unknown} of {rows} rows have no identity and are not used",
    ),
    "duplicate_rows": Kind(
        NOTICE, "One identity has several rows in one frame; with `too_many` of them the file cannot be used.",
        _doubled, lambda v: "give every person in a frame one row and an id of their own" if v["too_many"] else "",
    ),
    "principal_point_outside_image": Kind(
        NOTICE, "The principal point lies outside the image.",
        "[{camera}] the principal point {point} lies outside the {size[0]} x {size[1]} image: wrong image size? The matrix "
        "and the size must belong to the same image",
    ),
    "people_outside_image": Kind(
        NOTICE, "Some people lie outside the image.",
        "camera {camera}: {outside} of {people} people lie outside the {size[0]} x {size[1]} image (first: frame {frame}, "
        "from {corners[0]} to {corners[1]})",
    ),
    "people_in_part_of_image": Kind(
        NOTICE, "All people lie in a part of the image: its size may be wrong.",
        "camera {camera}: all people lie within {across:.0%} of the width and {down:.0%} of the height: wrong image size? "
        "Perhaps the size {size[0]} x {size[1]} in {intrinsics} is not the size of the images in which they were detected",
    ),
}  # fmt: skip


def _to_fetch(v: Fields) -> str:
    text = f"{v['why']}, and so does `passerby calibrate`"
    if v["otherwise"] is None:
        return text
    return f"{text}; {'no keypoints are' if v['otherwise'] == 'none' else v['otherwise'] + ' is'} used if it is unavailable"


def _gaps(v: Fields) -> str:
    where = f"{v['longest_at_s']:.0f} s after the start" if v["longest_at"] is None else f"at {v['longest_at']}"
    gaps = "1 gap" if v["count"] == 1 else f"{v['count']} gaps"
    return (
        f"camera {v['camera']}: the recording has {gaps} between its {v['between']}, {v['seconds']:.0f} s in all; the longest, "
        f"{v['longest_s']:.0f} s, is {where}"
    )


NOTABLE = 0.95
"""An uncertainty that falls to more than this share of itself has barely fallen."""


def _used_in_part(v: Fields) -> str:
    """Return the part of the videos that was used, and the expected gain of the rest, in words."""
    known = [
        (what, now, then)
        for what, now, then in (
            ("points", v["now_points_m"], v["points_m"]), ("positions on the ground", v["now_ground_m"], v["ground_m"]),
        )
        if now is not None and then is not None
    ]  # fmt: skip
    gains = [f"{what} from {100 * now:.1f} to about {100 * then:.1f} cm" for what, now, then in known if then < NOTABLE * now]
    less = f"reduce the uncertainty of {' and of '.join(gains)}" if gains else "barely reduce the uncertainty"
    used = f"{v['used_s']:.0f} s of {v['recorded_s']:.0f} s of the videos were used"
    return f"{used}; the rest would {less}" if known else used


def _broken(v: Fields) -> str:
    parts = [f"{v['failed']} could not be decoded"] if v["failed"] else []
    parts += [f"{v['cut']} end before the length that they state"] if v["cut"] else []
    return f"camera {v['camera']}: of {v['files']} files, {' and '.join(parts)}: the rest is used"


def _long(v: Fields) -> str:
    when = "" if v["first"] is None else f", from {v['first']} to {v['last']}"
    return f"camera {v['camera']}: the recording is {v['hours']:.1f} hours long ({v['files']} files{when})"


VIDEOS: Mapping[str, Kind] = {
    "people_seem_sideways": Kind(
        NOTICE, "Few people are detected in the video, and many more once its images are turned by 90 degrees.",
        "camera {camera}: few people are detected in its images, and many more once these are turned by 90 degrees",
        "if people lie on their side there, set rotate = {rotate} (degrees clockwise), or {other} if they are then upside down",
    ),
    "camera_bumped": Kind(
        NOTICE, "The camera is bumped: it moves for a while and comes back.",
        lambda v: f"camera {v['camera']}: the camera is bumped {v['from_s']:.1f} s after the start, "
        f"{'by an unknown amount' if v['pixels'] is None else 'by {:.0f} pixels'.format(v['pixels'])}, and is back in place "
        f"after {v['until_s']:.1f} s",
    ),
    "frames_undecodable": Kind(
        NOTICE, "Some frames of the video could not be decoded.",
        "camera {camera}: {broken} frames or packets could not be decoded, the first after {first_s:.1f} s",
    ),
    "stream_unrecorded": Kind(
        NOTICE, "The camera's video is a stream, which a calibration records first.",
        "camera {camera}: its stream ({stream}) is not recorded yet: `passerby calibrate` records {seconds:.0f} s of it first, "
        "into {folder}",
    ),
    "pieces_unreadable": Kind(
        NOTICE, "Some files of a recording in pieces cannot be read; the others are used.",
        "camera {camera}: {count} of {files} files cannot be read and are left out; the first is {first}: {why}",
    ),
    "pieces_broken": Kind(
        NOTICE, "Some files of a recording in pieces turned out to be damaged while they were decoded.", _broken,
    ),
    "videos_used_in_part": Kind(
        NOTICE, "The rig measures well enough from a part of the videos; the rest was not watched.", _used_in_part,
        "with --all all of the videos are used",
    ),
    "pieces_differ": Kind(
        NOTICE, "Some files of a recording have another image size or frame rate than most; they are left out.",
        "camera {camera}: {count} of {files} files are left out, because their size or rate is not that of the others; the "
        "first, {first}, has {what} instead of {usual}",
    ),
    "pieces_untimed": Kind(
        NOTICE, "The names of a recording's pieces do not tell their times: each is assumed to follow the one before it.",
        "camera {camera}: the names of its {pieces} pieces do not tell when they were recorded: each is assumed to begin when "
        "the one before it ends, in the order of their names",
        "if pieces are missing, state how the names tell the time (video_names), or give a table of times (video_times)",
    ),
    "pieces_overlap": Kind(
        NOTICE, "Pieces of a recording overlap; frames that were shown already are passed over.",
        "camera {camera}: {count} pieces begin before the piece before them ends, by {seconds:.0f} s in all: what is there "
        "twice is used once",
        lambda v: ""
        if not v["irregular"] or v["longest_at"] is None
        else f"if the clock of the recorder was set back about {v['longest_at']}, choose a span without that: under [scene] "
        "set from and until",
    ),
    "recording_gaps": Kind(
        NOTICE, "A recording in pieces, or in images, has gaps.", _gaps,
    ),
    "recording_long": Kind(
        NOTICE, "The recording lasts for hours, and no span of it is chosen.", _long,
        lambda v: "choose about half an hour with many people: "
        + (
            'under [scene] set from = "08:00" and until = "08:30", for example'
            if v["first"] is not None
            else f"under [cameras.{v['camera']}] set until_s"
        ),
    ),
    "wall_clock_missing": Kind(
        NOTICE, "Some cameras' files tell their wall times, and those of these cameras do not.",
        "{who}: it is not known when the recording began, but that of other cameras is: it is assumed to begin at {origin}, as "
        "the first of them",
        "state the times of its files (video_names or video_times), or let a larger clock offset be searched for: under "
        "[association] set max_offset_s", common=True,
    ),
    "field_of_view_seen": Kind(
        NOTICE, "A network sees the camera's field of view in its video; its focal length is sought about that.",
        "camera {camera}: {network} sees a horizontal field of view of {hfov_deg:.0f} degrees in its video (1 sigma of the "
        "focal length: {sd_percent:.0f} %)",
    ),
    "network_missing": Kind(
        NOTICE, "The network for this `role` is unavailable; `why` is the text of the error.",
        lambda v: f"{v['why']}: {_INSTEAD[v['role']]}",
    ),
    "network_to_fetch": Kind(
        NOTICE, "A network would be fetched; `otherwise` is used instead if that fails.", _to_fetch,
    ),
}  # fmt: skip
