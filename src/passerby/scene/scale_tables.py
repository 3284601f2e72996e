"""The tables of the scene file that state known lengths: `[scale]` and its subtables."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from passerby.core.observations import BODY_17
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M, POPULATIONS
from passerby.scene.table import Metres, Pixel, Seconds, Table


def _check_standing(value: float) -> float:
    if not 0.3 < value < 3:
        raise ValueError(f"{value:g} is not a person's height: metres are needed")
    return value


Population = Literal["adults", "children", "mixed"]
Height = Annotated[float, AfterValidator(_check_standing)]
Ends = tuple[tuple[Pixel, Pixel], tuple[Pixel, Pixel]]


class PersonTable(Table):
    """`[[scale.people]]`: the standing height of one person, named by an id or by a pixel."""

    identity: int | None = Field(default=None, ge=0)
    """The person's id in the files, which in mode "given" is the same in all cameras. In all modes: `camera`, `at` and
    `time_s` or `frame` instead."""
    camera: str | None = None
    """A camera that sees the person."""
    time_s: Seconds | None = None
    """When: seconds from the beginning of this camera's own recording, which frame 1 is."""
    frame: int | None = Field(default=None, ge=0)
    """When, as a frame number of this camera, in place of `time_s`."""
    at: tuple[Pixel, Pixel] | None = None
    """[u, v], a pixel on the person then. Of people who overlap there it is the nearest, whose box reaches lowest."""
    height_m: Height
    """Standing height, with shoes."""
    sd_m: Metres = 0.01
    """Standard deviation. A measured height is accurate to about a centimetre (shoes)."""

    @model_validator(mode="after")
    def _check_named_once(self) -> Self:
        keys = ("camera", "time_s", "frame", "at")
        stated = [key for key in keys if getattr(self, key) is not None]
        if self.identity is not None and stated:
            raise ValueError(f"has identity and {stated[0]}: name the person by one of them, and delete the other")
        if self.identity is None and not stated:
            raise ValueError("does not say whose height it is: add identity, or camera, at = [u, v] and time_s or frame")
        if self.identity is None:
            if self.time_s is not None and self.frame is not None:
                raise ValueError("has time_s and frame: delete one of them")
            missing = [key for key in ("camera", "at") if getattr(self, key) is None]
            missing += ["time_s or frame"] if self.time_s is None and self.frame is None else []
            if missing:
                raise ValueError(f"points at a person, but has no {' and no '.join(missing)}: add it")
        return self


class LengthTable(Table):
    """`[[scale.lengths]]`: a known length between two points marked in two or more cameras."""

    metres: Metres
    """The length."""
    sd_m: Metres = 0.02
    """Standard deviation. The marked points of painted lines and pipes are accurate to about two centimetres."""
    points: dict[str, Ends]
    """camera -> the pixels of the two ends, the ends in the same order in all cameras."""
    name: str = ""
    """What was measured. Tables of one name are one object, such as a stick that is marked at several times."""


class WandTable(Table):
    """`[[scale.wands]]`: a stick of known length that a person carries, its two ends found in the images as keypoints are."""

    points: tuple[str, str]
    """The names of the two ends in the `keypoints` files, beside the keypoints of the body or in annotations of their own."""
    metres: Metres
    """The length between the two ends."""
    sd_m: Metres = 0.005
    """Standard deviation. The ends of a stick that was measured with a tape are accurate to about half a centimetre."""

    @model_validator(mode="after")
    def _has_two_ends(self) -> Self:
        if self.points[0] == self.points[1]:
            raise ValueError(f"points names '{self.points[0]}' twice: name the two ends of the stick")
        of_body = [name for name in self.points if name in BODY_17]
        if of_body:
            raise ValueError(f"points: '{of_body[0]}' is a keypoint of the body: name the two ends of the stick")
        return self


class DistanceTable(Table):
    """`[[scale.distances]]`: a known distance between two cameras."""

    between: tuple[str, str]
    """The two cameras' names."""
    metres: Metres
    """Between the two camera centres."""
    sd_m: Metres = 0.05
    """Standard deviation. A tape between two mounted cameras reaches neither optical centre: about 5 centimetres."""


class CheckTable(Table):
    """`[[scale.checks]]`: a known length that has no part in the calibration and is compared with the finished rig."""

    metres: Metres
    """The length."""
    sd_m: Metres = 0.02
    """Standard deviation."""
    points: dict[str, Ends] | None = None
    """camera -> the pixels of the two ends, as in `[[scale.lengths]]`."""
    between: tuple[str, str] | None = None
    """Instead, the names of two cameras: the distance between their centres."""

    @model_validator(mode="after")
    def _is_one_of_both(self) -> Self:
        if (self.points is None) == (self.between is None):
            told = "neither points nor between" if self.points is None else "points and between"
            raise ValueError(f"has {told}: give points = {{ NAME = [[u, v], [u, v]] }}, or between = [NAME, NAME]")
        if self.points is not None and len(self.points) < 2:
            raise ValueError("points are marked in one camera: mark both ends in two or more")
        if self.between is not None and self.between[0] == self.between[1]:
            raise ValueError("between names one camera twice: name two")
        return self


class CameraHeightTable(Table):
    """`[[scale.camera_heights]]`: a known height of a camera above the ground that people walk on."""

    camera: str
    """The camera's name."""
    metres: Metres
    """From the camera centre straight down to the ground that people walk on."""
    sd_m: Metres = 0.05
    """Standard deviation, as for distances."""


class ScaleTable(Table):
    """`[scale]`: known lengths. All are combined, weighted by their standard deviations."""

    population: Population = "adults"
    """Who the people are, where no `person_height_m` is stated. adults: mean 1.72 m, sd 0.09. children: 6 to 11 years old,
    1.32 m, sd 0.11, the mean known to 0.10 m. mixed: as many adults as such children, 1.52 m, sd 0.22, the mean known to
    0.11 m."""
    person_height_m: Height = PERSON_HEIGHT_M
    """Mean standing height of the people, with shoes. Default: that of `population`; it overrides `population`."""
    person_height_sd_m: Metres = PERSON_HEIGHT_SD_M
    """Standard deviation of the heights of people around the mean."""
    person_height_mean_sd_m: Metres | None = None
    """Standard deviation of that mean for the people in these videos. None: 4.5 % of it, for unknown people. 0.02 is the best
    that boxes allow for people whose mean was measured."""
    people: tuple[PersonTable, ...] = ()
    """People with a measured height: `[[scale.people]]`."""
    lengths: tuple[LengthTable, ...] = ()
    """Lengths between points that cameras see: `[[scale.lengths]]`."""
    wands: tuple[WandTable, ...] = ()
    """Sticks of known length that people carry: `[[scale.wands]]`."""
    distances: tuple[DistanceTable, ...] = ()
    """Distances between two cameras: `[[scale.distances]]`."""
    checks: tuple[CheckTable, ...] = ()
    """Known lengths that the finished rig is compared with: `[[scale.checks]]`."""
    camera_heights: tuple[CameraHeightTable, ...] = ()
    """Heights of cameras above the ground: `[[scale.camera_heights]]`."""

    @model_validator(mode="before")
    @classmethod
    def _heights_of_population(cls, values: Any) -> Any:
        """Fill in the heights of a stated population, unless `person_height_m` is stated."""
        if not isinstance(values, dict) or "person_height_m" in values:
            return values
        prior = POPULATIONS.get(values["population"]) if isinstance(values.get("population"), str) else None
        if prior is None:
            return values
        stated = {
            "person_height_m": prior.mean_m,
            "person_height_sd_m": prior.sd_m,
            "person_height_mean_sd_m": prior.mean_sd_m,
        }
        return {**stated, **values}
