"""The tables of the scene file, key by key: valid values, meaning and default of each."""

from __future__ import annotations

import re
from datetime import datetime, time
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from passerby.common.text import not_a_file, shortened
from passerby.core.data_sheet import NARROWEST_FIELD_DEG, WIDEST_FISHEYE_DEG
from passerby.core.observations import BoxFormat
from passerby.perception.sources.name_times import NamePattern
from passerby.scene.lens_keys import check_lens_keys, parse_named_camera
from passerby.scene.table import FramesPerSecond, PersonAtTable, Pixel, Positive, Seconds, Table, TogetherTable


def _moment(value: Any) -> Any:
    """Read a date with a time, or a time of day; both may be text."""
    if isinstance(value, datetime | time):
        return value
    if isinstance(value, str):
        for kind in (time, datetime):
            try:
                if kind is time or re.search(r"\d[ T]\d", value):
                    return kind.fromisoformat(value.strip())
            except ValueError:
                continue
    raise ValueError(f'{shortened(value)} is no time: write "2026-11-22 08:00" or "08:00"')


def _name_pattern(value: str) -> str:
    NamePattern(value)
    return value


def _box_format(value: Any) -> Any:
    """Convert the usual spellings of a box format to the documented one."""
    return str(BoxFormat.of_text(value)) if isinstance(value, str) else value


def _check_same_as(value: str) -> str:
    parse_named_camera(value)
    return value


def _polygon(value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len(set(value)) < 3:
        raise ValueError(f"has {len(set(value))} different corners: a region needs three or more, each [u, v] in pixels")
    return value


Moment = Annotated[datetime | time, BeforeValidator(_moment)]
Mode = Literal["combined", "trajectory", "appearance", "given"]
BoxFormatName = Annotated[
    Literal["ltwh", "corners", "centres", "normalised ltwh", "normalised corners", "normalised centres"],
    BeforeValidator(_box_format),
]

LONGEST_RECORDING_S = 7 * 86400.0
RECORDED_BY_CALIBRATE = "or add [recording] seconds = 600: then `passerby calibrate` records it first"
RECORDED_BY_COMMAND = "[recording] seconds counts only for the commands `passerby calibrate` and `passerby check`"
RECORDS = "records"
"""Key of the validation's context: whether the scene states the duration to record."""
WATCHED_FPS = 5.0
"""People walk a third of a step in a fifth of a second: neighbouring frames add little independent evidence."""
SEARCHED_S = 5.0
"""Recordings that are started by hand, or by cameras whose clocks are set occasionally, differ by a few seconds."""

Polygon = Annotated[tuple[tuple[Pixel, Pixel], ...], AfterValidator(_polygon)]


SCENE_FORMAT = 1
"""Version of the keys of a scene file. New keys need no new version: an older Passerby names the unknown keys."""


class SceneTable(Table):
    """`[scene]`: the scene as a whole."""

    name: str | None = None
    """Name of the scene in reports. None: the file's name without suffix."""
    fps: FramesPerSecond | None = None
    """Frames per second of the frame numbers. None: those of the videos; without any, walking speeds and clock
    offsets are not used. A stated value overrides the rate of a video, which many recorders write wrongly."""
    from_: Moment | None = Field(default=None, alias="from")
    """Wall time at which the used span begins, of all cameras whose files tell their wall times: "2026-11-22 08:00" or a time
    of day, "08:00", by the clock of the files' names; with an offset ("08:00+01:00") if that clock is UTC. None: all is
    used."""
    until: Moment | None = None
    """Wall time at which the used span ends, likewise."""
    boxes: BoxFormatName = "ltwh"
    """What the four numbers of a box are in `tracks` and `detections`. ltwh: left, top, width, height; corners: left, top,
    right, bottom; centres: centre x, centre y, width, height. In pixels, or normalised: in shares of the image's width and
    height, as YOLO tools write centres."""
    format_version: int = 1
    """Of the scene file's keys; a file of a later Passerby is not read. It can be left out."""

    @field_validator("format_version")
    @classmethod
    def _is_known(cls, version: int) -> int:
        if version < 1:
            raise ValueError("is no version: delete the key")
        if version > SCENE_FORMAT:
            raise ValueError(f"is of a later Passerby; this one reads up to {SCENE_FORMAT}: install a later one")
        return version

    @model_validator(mode="after")
    def _span_in_order(self) -> Self:
        first, last = self.from_, self.until
        if first is None or last is None:
            return self
        if isinstance(first, datetime) != isinstance(last, datetime):
            raise ValueError("from and until must both be times of day, or both have a date")
        if (first.tzinfo is None) != (last.tzinfo is None):
            raise ValueError("from and until must both have an offset from UTC, or none")
        if isinstance(first, datetime) and isinstance(last, datetime):
            in_order = first < last
        else:
            in_order = first.isoformat() < last.isoformat()
        if not in_order:
            raise ValueError(f"from = {first} is not before until = {last}: give a date to both if midnight lies between them")
        return self


class RecordingTable(Table):
    """`[recording]`: how `passerby calibrate` records the cameras whose `video` is a stream, before anything else."""

    seconds: Annotated[float, Field(ge=1, le=LONGEST_RECORDING_S)]
    """Length of the recording."""
    folder: Path | None = None
    """Where the recording is written. A finished one that is there is used again. None: `recording` in the output folder."""
    secrets: Path | None = None
    """A file of lines NAME=VALUE: `${NAME}` in an address stands for the value. None: variables of the environment only."""
    without_missing: bool = False
    """Whether the other cameras are recorded if one cannot be reached."""


class CameraTable(Table):
    """`[cameras.NAME]`: one camera and its observations."""

    intrinsics: Path | None = None
    """Rig file. The image size, matrix and distortions of its table [NAME] are read; a pose in it is ignored. None: focal
    length, principal point and distortion are estimated together with the rig."""
    image_size: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]] | None = None
    """[width, height] in pixels, if there are no `intrinsics` and no `video` that states it."""
    hfov_deg: Annotated[float, Field(ge=NARROWEST_FIELD_DEG, le=WIDEST_FISHEYE_DEG)] | None = None
    """Field of view in degrees over the image's width, as on a data sheet, if there are no `intrinsics`: the focal length is
    estimated about it. Its standard deviation is `focal_sd_percent`; not given, 15 %, and more beyond 60 degrees (19 % at 90,
    22 % at 103), since data sheets state it with the distortion. Above 150 for fisheye lenses only."""
    video: Path | tuple[Path, ...] | None = None
    """A video file; or the pieces of one recording, or images: a folder, a pattern ("recordings/*/*/north/*.mp4"), or a list of
    files, folders and patterns. People are detected in it if there are neither boxes nor keypoints; boxes get their embeddings
    from it. Or a stream or device ("rtsp://...", "https://...", "/dev/video0") that is recorded first: see `[recording]`."""
    video_names: Annotated[str, AfterValidator(_name_pattern)] | None = None
    """How the ends of the files' paths tell their wall times: text with directives of strptime, and * for any text in one name,
    as "%Y-%m-%d/%H/north/%M.%S.mp4". None: the usual names are recognised."""
    video_times: Path | None = None
    """The times of the files, CSV: file name, and seconds or an ISO 8601 time. Of images, of each; of videos, of the first
    frame."""
    times: Path | None = None
    """The times of the frames, CSV: a row per frame of the one video file, or of the boxes and keypoints, in seconds, ms, us or
    ns from any zero or since 1970, or ISO 8601. For a logger's video, which states a constant rate that it did not have. Frames
    are then numbered by hundredths of a second."""
    detections: Path | None = None
    """Boxes without identities, MOTChallenge text, id -1. Read if there are no `tracks`, in every mode except "given"."""
    tracks: Path | None = None
    """Boxes with ids, MOTChallenge text: identities in mode "given", otherwise tracklets of this camera; -1 for unknown."""
    keypoints: Path | None = None
    """Keypoints, COCO JSON; `track_id` has the same meaning and the same numbers as the ids in `tracks`. Or a folder with a
    JSON file per frame, as OpenPose and Pose2Sim write it."""
    boxes: BoxFormatName | None = None
    """Format of the boxes in this camera's `tracks` and `detections`. None: that of `[scene]`."""
    embeddings: Path | None = None
    """Appearance of the boxes in `tracks`, or else in `detections`: npz, one row per row of that file, in the same order."""
    fps: FramesPerSecond | None = None
    """Frames per second of this camera's frame numbers. None: those of `[scene]`, or else those of the video."""
    from_s: Seconds | None = None
    """Earlier observations of the camera are not used: seconds of its own recording, (frame - 1) / fps. For a camera that
    was moved."""
    until_s: Seconds | None = None
    """Later observations of the camera are not used, in the same seconds."""
    exclude: tuple[Polygon, ...] = ()
    """Regions of the image, each a list of corners [u, v] in pixels: people whose feet (the middle of their box's lower edge)
    are in one are not used. For mirrors, screens, and a street behind a fence."""
    exclude_s: tuple[tuple[Seconds, Seconds], ...] = ()
    """Spans [begin, end] of the camera's own recording in seconds, as `from_s`, whose observations are not used."""
    rotate: Literal[0, 90, 180, 270] = 0
    """Degrees clockwise by which the camera's images are turned so that people in them stand upright, for a camera that is
    mounted on its side or upside down. All else (boxes, keypoints, intrinsics, pixels in this file, results) is of the images
    as filmed: as a player shows them, with the rotation that the video's metadata may state."""
    focal_sd_percent: Annotated[float, Field(gt=0, le=50)] | None = None
    """Standard deviation of a stated focal length, in per cent of it. Every reported uncertainty includes it, and it is
    the prior if `refine` has "focal". None: the value of the same key in the table of `intrinsics`, or else the intrinsics
    are assumed to be exact."""
    focal_mm: Positive | None = None
    """Focal length in millimetres, as on a data sheet, with `sensor_width_mm`, if there are no `intrinsics`. Its standard
    deviation is `focal_sd_percent`; not given, 15 %, since cameras crop when they film."""
    sensor_width_mm: Positive | None = None
    """Length in millimetres of the part of the sensor that the image's longer side shows; of the whole sensor, if nothing else
    is known."""
    focal_35mm: Positive | None = None
    """35 mm equivalent focal length, over the diagonal, instead of `focal_mm`. Not given: that of the video's metadata, where
    they have one. Standard deviation as for `focal_mm`."""
    lens_model: Literal["pinhole", "fisheye"] | None = None
    """Projection of a lens without `intrinsics`. pinhole: with radial distortion; fisheye: equidistant. Not given: pinhole."""
    lens: Annotated[str, AfterValidator(_check_same_as)] | None = None
    """"same as CAMERA", for a camera of the same model, at the same zoom and image size, instead of `intrinsics`: the cameras
    share one unknown focal length and distortion. If CAMERA has intrinsics, they are the start, with `focal_sd_percent`, 1 %
    unless given, from unit to unit."""

    @property
    def watched(self) -> bool:
        """Whether people must be detected in the video, because no other file contains them."""
        return self.video is not None and self.detections is None and self.tracks is None and self.keypoints is None

    @field_validator("video", mode="before")
    @classmethod
    def _is_a_file(cls, value: Any, info: ValidationInfo) -> Any:
        named = value if isinstance(value, list | tuple) else [value]
        why = next((why for one in named if isinstance(one, str | Path) and (why := not_a_file(str(one)))), None)
        if why is not None:
            records = RECORDED_BY_COMMAND if (info.context or {}).get(RECORDS) else RECORDED_BY_CALIBRATE
            raise ValueError(why if why.startswith("is an address") else f"{why}; {records}")
        if not named or not all(isinstance(one, str | Path) and str(one).strip(" .") for one in named):
            raise ValueError("a path, a pattern or a list of these is needed: a video, or the pieces of one")
        return tuple(value) if isinstance(value, list) else value

    @property
    def videos(self) -> tuple[Path, ...]:
        """The paths that `video` names."""
        return self.video if isinstance(self.video, tuple) else () if self.video is None else (self.video,)

    @model_validator(mode="after")
    def _has_a_source(self) -> Self:
        if self.video is None and self.detections is None and self.tracks is None and self.keypoints is None:
            raise ValueError(
                "has no observations: add `video`, `tracks` (boxes with ids), `detections` (boxes without) or `keypoints`"
            )
        if self.video is None and (self.video_names is not None or self.video_times is not None):
            raise ValueError("has video_names or video_times, but no video that they could belong to: add `video`")
        if self.video_names is not None and self.video_times is not None:
            raise ValueError("has video_names and video_times: delete one of them")
        if self.times is not None and (self.fps is not None or self.video_times is not None):
            other = "fps" if self.fps is not None else "video_times"
            raise ValueError(f"has times and {other}: delete one of them")
        check_lens_keys(self)
        if self.embeddings is not None and self.detections is None and self.tracks is None:
            raise ValueError("has embeddings, but no boxes that they could belong to: add `tracks` or `detections`")
        if self.from_s is not None and self.until_s is not None and self.from_s >= self.until_s:
            raise ValueError(f"from_s = {self.from_s:g} is not before until_s = {self.until_s:g}: nothing would be left")
        for low, high in self.exclude_s:
            if low >= high:
                raise ValueError(f"exclude_s: [{low:g}, {high:g}] ends before it begins: give [begin, end] in seconds")
        return self


class PerceptionTable(Table):
    """`[perception]`: how people are detected in the videos. A choice is a word, the name of a model that
    `passerby models list` knows, or the path of an ONNX file.
    """

    detector: str = "auto"
    """auto: the default network, or "background" if it is unavailable; background: background subtraction."""
    embedder: str = "auto"
    """auto: the default network, or "stripes" if it is unavailable; stripes: colour histograms of horizontal
    stripes; none."""
    keypoints: str = "auto"
    """The network that detects the keypoints of detected people. auto: the best one on this computer, or else one that is
    downloaded, and no keypoints if there is neither; none: no keypoints."""
    keypoints_per_s: FramesPerSecond | None = None
    """Detected people whose keypoints are measured, per second of video and camera. None: `CROPS_PER_S` where `keypoints` is
    auto, everybody where it names a network."""
    fps: FramesPerSecond | None = None
    """Frames processed per second of video. None: `WATCHED_FPS`, and more in videos shorter than a minute."""
    min_score: Annotated[float, Field(ge=0, le=1)] = 0.25
    """Detections with a lower score are dropped. The tracker uses weak detections to continue a track, never to start one."""
    tiles: Literal["auto", "none"] | tuple[Annotated[int, Field(ge=1, le=16)], Annotated[int, Field(ge=1, le=16)]] = "auto"
    """Columns and rows of overlapping tiles in which small people are detected. auto: chosen by the image size."""
    models: Path | None = None
    """A folder of model files that is searched first."""
    lens_network: Path | None = None
    """The path of an ONNX file that sees the vertical field of view in one image, for cameras with a video and without
    intrinsics or `hfov_deg`: where their focal length is sought. None: people alone determine it."""


class AssociationTable(Table):
    """`[association]`: how identities are associated across cameras."""

    mode: Mode = "combined"
    """combined: by trajectories and, if there are embeddings, by appearance. trajectory: by trajectories only. appearance: by
    appearance only. given: identities are known, the same id is the same person in all cameras. In all other modes an id
    belongs to one camera: the same number in two cameras has no meaning."""
    max_offset_s: Seconds | None = None
    """The largest clock offset between two cameras that is searched for. None: `SEARCHED_S` in modes combined and trajectory, 0
    in modes appearance and given. 0: the cameras are synchronised. Above 60, the starts of the recordings are found first, by
    the people's activity over time."""
    sound: Literal["auto", "off"] | None = None
    """Clock offsets by the sound of the videos, where two cameras have any. None: auto; off: nothing is listened to."""
    same: tuple[TogetherTable, ...] = ()
    """`[[association.same]]`: boxes that are one person, whatever the association would find."""
    different: tuple[TogetherTable, ...] = ()
    """`[[association.different]]`: boxes that are all different people."""
    not_people: tuple[PersonAtTable, ...] = ()
    """`[[association.not_people]]`: boxes of a poster, a mannequin, a trolley. The tracklet of such a box is not used, nor are
    the camera's tracklets that stay in its place."""

    @model_validator(mode="after")
    def _check_corrections(self) -> Self:
        if self.given and (self.same or self.different):
            key = "same" if self.same else "different"
            raise ValueError(
                f'{key}: corrects identities that are found, but mode "given" takes those of the files: correct the ids there, '
                "or use another mode"
            )
        return self

    @property
    def given(self) -> bool:
        """Whether the ids in the files are global identities."""
        return self.mode == "given"

    @property
    def search_s(self) -> float:
        """The largest difference of two clocks that is searched, seconds; without a frame rate there is no search."""
        if self.max_offset_s is not None:
            return self.max_offset_s
        return SEARCHED_S if self.mode in ("combined", "trajectory") else 0.0


class SitesTable(Table):
    """`[sites]`: what is known of where many cameras are."""

    groups: tuple[tuple[str, ...], ...] = ()
    """Names of cameras that may share ground, group by group, as [["C1", "C2"], ["C2", "C3"]]; a camera may be in several, and
    each is in one at least. Cameras without a common group are not compared. None: of more than twelve cameras, each is
    compared with those whose people come and go alike."""

    @field_validator("groups", mode="before")
    @classmethod
    def _groups_are_lists_of_names(cls, value: Any) -> Any:
        groups = value if isinstance(value, list | tuple) else [value]
        for number, group in enumerate(groups, start=1):
            if not isinstance(group, list | tuple) or not all(isinstance(name, str) for name in group):
                raise ValueError(
                    f"group {number} is {shortened(group)}: give a list of groups, each a list of names of cameras, as "
                    '[["C1", "C2"], ["C2", "C3"]]'
                )
        return value

    @model_validator(mode="after")
    def _groups_hold_pairs(self) -> Self:
        for number, group in enumerate(self.groups, start=1):
            if twice := next((name for name in group if group.count(name) > 1), None):
                raise ValueError(f"groups {number} names camera {shortened(twice)} twice: name each once")
            if len(group) < 2:
                holds = f"holds only camera {shortened(group[0])}" if group else "is empty"
                raise ValueError(f"groups {number} {holds}: name two or more that may share ground")
        return self


class SolverTable(Table):
    """`[solver]`: how the rig is computed."""

    method: Literal["people", "geopose"] = "people"
    """people: the person-model adjustment, which is more accurate; geopose: the method of the paper."""
    reference: str | None = None
    """The reference camera. geopose needs one; people treats all cameras alike."""
    refine: tuple[Literal["focal", "principal_point", "clock_rate"], ...] = ()
    """What is refined besides the poses, with the stated values as priors. focal: each camera's focal length, if it comes from
    a data sheet or the zoom has changed. principal_point: each camera's principal point. clock_rate: each camera's frames per
    second, if a clock drifts. Intrinsics that do not predict people held out better than the stated ones are dropped."""
    options: dict[str, Any] = Field(default_factory=dict)
    """`[solver.options]`: fields of the method's options dataclass, for experiments; nothing needs to be set."""

    @model_validator(mode="after")
    def _geopose_has_a_reference(self) -> Self:
        if self.method == "geopose" and self.reference is None:
            raise ValueError('method "geopose" needs a reference camera: add reference = "NAME"')
        if self.method == "geopose" and self.refine:
            raise ValueError('method "geopose" refines nothing: delete refine, or use method "people"')
        return self
