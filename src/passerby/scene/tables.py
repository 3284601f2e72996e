"""The tables of the scene file, key by key: what each may say, what it means, and what it is where nothing is said."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from passerby.common.addresses import not_a_file, plain_without_credentials
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("a finite number is needed")
    return value


def _standing(value: float) -> float:
    if not 0.3 < value < 3:
        raise ValueError(f"{value:g} is not a person's height: metres are needed")
    return value


Mode = Literal["combined", "trajectory", "appearance", "given"]

WATCHED_FPS = 5.0
"""People walk a third of a step in a fifth of a second: neighbouring pictures add little that is independent."""
SEARCHED_S = 5.0
"""Recordings that are started by hand, or cut by cameras whose clocks are set now and then, differ by a few seconds."""

Metres = Annotated[float, Field(gt=0), AfterValidator(_finite)]
Height = Annotated[float, AfterValidator(_standing)]
Pixel = Annotated[float, AfterValidator(_finite)]
FramesPerSecond = Annotated[float, Field(gt=0), AfterValidator(_finite)]
Seconds = Annotated[float, Field(ge=0), AfterValidator(_finite)]
Ends = tuple[tuple[Pixel, Pixel], tuple[Pixel, Pixel]]


class Table(BaseModel):
    """A table of the scene file: frozen, unknown keys rejected."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _without_passwords(cls, values: Any) -> Any:
        """No message, and no file that a scene is copied into, repeats the password of an address in it."""
        return plain_without_credentials(values) if isinstance(values, dict) else values


class SceneTable(Table):
    """`[scene]`: the scene as a whole."""

    name: str | None = None
    """What reports call the scene; the file's name without ending, unless given."""
    fps: FramesPerSecond | None = None
    """Frames per second of the frame numbers. None: those of the videos; without any, nothing that needs speeds or clocks is
    used. Given, it is believed rather than a video's own rate, which many recorders write wrongly."""


class CameraTable(Table):
    """`[cameras.NAME]`: one camera and what it saw."""

    intrinsics: Path
    """Rig file; size, matrix and distortions of its table [NAME] are read, a pose in it is ignored."""
    video: Path | None = None
    """A video file. People are found in it where there are neither boxes nor joints; boxes get their embeddings from it.
    Streams, devices, pieces of recordings and folders of pictures are not read yet."""
    detections: Path | None = None
    """Boxes without identities, MOTChallenge text, id -1. Read where there are no `tracks`, in every mode but "given"."""
    tracks: Path | None = None
    """Boxes with ids, MOTChallenge text: identities in mode "given", else the camera's own tracklet numbers; -1 for unknown."""
    keypoints: Path | None = None
    """Joints, COCO JSON; `track_id` as the ids in `tracks`, with the same numbers as there."""
    embeddings: Path | None = None
    """Appearance of the boxes in `tracks`, or else in `detections`: npz, one row a row of that file, in its order."""
    fps: FramesPerSecond | None = None
    """Frames per second of this camera's frame numbers. None: those of `[scene]`, or else the video's own."""
    from_s: Seconds | None = None
    """What the camera saw earlier is not used: seconds of its own recording, (frame - 1) / fps. For one that was moved."""
    until_s: Seconds | None = None
    """What the camera saw later is not used, likewise."""
    focal_sd_percent: Annotated[float, Field(gt=0, le=50)] | None = None
    """How far the focal length may be off, one standard deviation in per cent of it, where it is a guess: it is carried into
    every sigma, and is the prior where `refine` has "focal". None: what the table in `intrinsics` says under the same key, or
    else the lens is taken to be right."""

    @property
    def watched(self) -> bool:
        """Whether people have to be found in the video, since nothing else tells of them."""
        return self.video is not None and self.detections is None and self.tracks is None and self.keypoints is None

    @field_validator("video", mode="before")
    @classmethod
    def _is_a_file(cls, value: Any) -> Any:
        why = not_a_file(str(value)) if isinstance(value, str | Path) else None
        if why is not None:
            raise ValueError(why)
        return value

    @model_validator(mode="after")
    def _has_a_source(self) -> Self:
        if self.video is None and self.detections is None and self.tracks is None and self.keypoints is None:
            raise ValueError(
                "says nothing of what the camera saw: add `video`, `tracks` (boxes with ids), `detections` (boxes without) "
                "or `keypoints` (joints)"
            )
        if self.embeddings is not None and self.detections is None and self.tracks is None:
            raise ValueError("has embeddings, but no boxes that they could belong to: add `tracks` or `detections`")
        if self.from_s is not None and self.until_s is not None and self.from_s >= self.until_s:
            raise ValueError(f"from_s = {self.from_s:g} is not before until_s = {self.until_s:g}: nothing would be left")
        return self


class PerceptionTable(Table):
    """`[perception]`: how people are found in the videos. A choice is a word, the name of a model that
    `passerby models list` knows, or the path of an ONNX file.
    """

    detector: str = "auto"
    """auto: the default network, or "background" where it cannot be had; background: what differs from the empty scene."""
    embedder: str = "auto"
    """auto: the default network, or "stripes" where it cannot be had; stripes: colours of horizontal stripes; none."""
    keypoints: str = "none"
    """none, or a network that finds the joints of each person found."""
    fps: FramesPerSecond | None = None
    """Pictures looked at in a second of video. None: `WATCHED_FPS`, and more in videos of less than a minute."""
    min_score: Annotated[float, Field(ge=0, le=1)] = 0.25
    """A network's detections of a lower score are dropped. The tracker uses weak ones to go on, never to begin."""
    tiles: Literal["auto", "none"] | tuple[Annotated[int, Field(ge=1, le=16)], Annotated[int, Field(ge=1, le=16)]] = "auto"
    """Columns and rows of overlapping tiles in which small people are looked for. auto: as the picture's size asks for."""
    models: Path | None = None
    """A folder of model files, looked into before the others."""


class AssociationTable(Table):
    """`[association]`: how identities over cameras are found."""

    mode: Mode = "combined"
    """combined: by how people move and, where there are embeddings, how they look. trajectory: by how they move alone.
    appearance: by how they look alone. given: the ids in the files are global, the same id is the same person in all cameras.
    In all modes but given the ids are each camera's own: the same number in two cameras means nothing."""
    max_offset_s: Seconds | None = None
    """The largest difference of two cameras' clocks that is searched for. None: `SEARCHED_S` in modes combined and trajectory,
    nothing in modes appearance and given. 0: the cameras' clocks agree."""

    @property
    def given(self) -> bool:
        """Whether the ids in the files are global identities."""
        return self.mode == "given"

    @property
    def search_s(self) -> float:
        """The largest difference of two clocks to search for, seconds; without a frame rate there is nothing to search."""
        if self.max_offset_s is not None:
            return self.max_offset_s
        return SEARCHED_S if self.mode in ("combined", "trajectory") else 0.0


class SolverTable(Table):
    """`[solver]`: how the rig is computed."""

    method: Literal["people", "geopose"] = "people"
    """people: the person-model adjustment, the more accurate; geopose: the paper's method, as described there."""
    reference: str | None = None
    """The reference camera. geopose needs one; people treats all cameras alike."""
    refine: tuple[Literal["focal", "principal_point", "clock_rate"], ...] = ()
    """What is computed beside the poses, about what is stated. focal: each camera's focal length, where it comes from a data
    sheet or a zoom was moved. principal_point: where each lens's axis meets the picture. clock_rate: each camera's frames
    per second, where a clock drifts."""
    options: dict[str, Any] = Field(default_factory=dict)
    """`[solver.options]`: fields of the method's options dataclass, for experiments; nothing needs to be set."""

    @model_validator(mode="after")
    def _geopose_has_a_reference(self) -> Self:
        if self.method == "geopose" and self.reference is None:
            raise ValueError('method "geopose" needs a reference camera: add reference = "NAME"')
        if self.method == "geopose" and self.refine:
            raise ValueError('method "geopose" refines nothing: delete refine, or take method "people"')
        return self


class PersonTable(Table):
    """`[[scale.people]]`: the standing height of one person."""

    identity: int = Field(ge=0)
    """The person's id in the files, which in mode "given" is the same in all cameras."""
    height_m: Height
    """Standing height, shoes on."""
    sd_m: Metres = 0.01
    """A person's measured height is good to a centimetre (shoes)."""


class LengthTable(Table):
    """`[[scale.lengths]]`: a known length between two points marked in two or more cameras."""

    metres: Metres
    """The length."""
    sd_m: Metres = 0.02
    """Painted lines and pipes are known to about two centimetres at the point one marks."""
    points: dict[str, Ends]
    """camera -> the pixels of the two ends, the ends in the same order in all cameras."""


class DistanceTable(Table):
    """`[[scale.distances]]`: a known distance between two cameras."""

    between: tuple[str, str]
    """The two cameras' names."""
    metres: Metres
    """From one lens to the other."""
    sd_m: Metres = 0.05
    """A tape between two mounted cameras meets neither optical centre: half a decimetre."""


class CameraHeightTable(Table):
    """`[[scale.camera_heights]]`: a known height of a camera above the people's ground."""

    camera: str
    """The camera's name."""
    metres: Metres
    """From its lens straight down to the level on which people walk."""
    sd_m: Metres = 0.05
    """As for distances."""


class ScaleTable(Table):
    """`[scale]`: what is known about lengths; all of it is combined, weighted by the standard deviations."""

    person_height_m: Height = PERSON_HEIGHT_M
    """Mean standing height of the people, shoes on: adults of both sexes, worldwide."""
    person_height_sd_m: Metres = PERSON_HEIGHT_SD_M
    """How much people's heights differ around it."""
    person_height_mean_sd_m: Metres | None = None
    """How well that mean is known of the people in these videos. None: 4 % of it, as where nobody asked them; 0.02 is as good
    as boxes allow for people whose mean was measured."""
    people: tuple[PersonTable, ...] = ()
    """Single people whose height was measured: `[[scale.people]]`."""
    lengths: tuple[LengthTable, ...] = ()
    """Lengths that cameras see: `[[scale.lengths]]`."""
    distances: tuple[DistanceTable, ...] = ()
    """Distances between two cameras: `[[scale.distances]]`."""
    camera_heights: tuple[CameraHeightTable, ...] = ()
    """Heights of cameras above the ground: `[[scale.camera_heights]]`."""


class WorldTable(Table):
    """`[world]`: the frame that the rig is wanted in. Left out, the first camera stands above the origin and looks along y."""

    camera: str | None = None
    """The origin lies on the ground below this camera, x along what it looks at."""
    towards: str | None = None
    """With `camera`: x points towards this other camera."""
    points: Path | None = None
    """Points with known coordinates, marked in the pictures: CSV or TOML."""
    positions: Path | None = None
    """Known positions of cameras, in metres or as latitude, longitude and altitude: CSV or TOML."""
    scale: bool = False
    """Whether points or positions set the scale too. Otherwise it stays what `[scale]` makes it."""
    tilt: bool = False
    """Whether they set the vertical and the height too. Otherwise the ground that people walk on stays at z = 0."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        ways = [key for key in ("camera", "points", "positions") if getattr(self, key) is not None]
        if len(ways) != 1:
            told = " and ".join(ways) or "none of them"
            raise ValueError(f"has {told}: give one of camera, points, positions")
        if self.towards is not None and self.camera is None:
            raise ValueError("towards goes with camera: name the camera that the world begins at, or delete towards")
        if self.towards is not None and self.towards == self.camera:
            raise ValueError("towards is the camera itself: name another one")
        if self.camera is not None and (self.scale or self.tilt):
            raise ValueError("scale and tilt need points or positions: a camera tells neither; delete them")
        return self
