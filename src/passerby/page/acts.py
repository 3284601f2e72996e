"""The acts of the page: requests of a browser that are checked and change the scene file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from passerby.calibration.alignment.lengths import measure_length
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.world_files import read_known_points
from passerby.page.geometry import measure_axis
from passerby.page.plan_acts import PlacePlan, RemovePlan, change_plan
from passerby.page.requests import Act, Frame, Name, Pixel, read_as
from passerby.page.scene_edits import (
    POINTS_FILE,
    GroundClick,
    add_excluded,
    add_identities,
    add_length,
    add_line,
    add_not_a_person,
    add_person,
    remove_camera,
    remove_entry,
    remove_excluded,
    remove_time_limit,
    set_time_limit,
    set_world_points,
    write_points,
)
from passerby.page.session import Session
from passerby.scene.scene import Scene

ORIGIN, ALONG_X = "origin", "x axis"


class MarkLength(Act):
    """An act that adds a known length whose ends are marked in two or more cameras."""

    act: Literal["length"]
    metres: Annotated[float, Field(gt=0, le=1e4)]
    sd_m: Annotated[float, Field(gt=0, le=100)] = 0.02
    points: Annotated[dict[Name, tuple[Pixel, Pixel]], Field(min_length=2, max_length=1000)]
    check: bool = False
    """Whether the length is only compared with the rig and not used by the calibration."""


class PointAtPerson(Act):
    """An act that adds the height of the person at a pixel."""

    act: Literal["person"]
    camera: Name
    frame: Frame
    at: Pixel
    height_m: Annotated[float, Field(gt=0.3, lt=3)]
    sd_m: Annotated[float, Field(gt=0, le=1)] = 0.01


class GroundAt(BaseModel):
    """A pixel on the ground."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    camera: Name
    at: Pixel


class SetWorld(Act):
    """An act that sets the world's origin and a point of its x axis."""

    act: Literal["world"]
    origin: GroundAt
    along_x: GroundAt


class PersonAt(BaseModel):
    """A person at a pixel of one camera's frame."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    camera: Name
    frame: Frame
    at: Pixel


class CorrectIdentities(Act):
    """An act that states that boxes show one person, or different people."""

    act: Literal["identities"]
    key: Literal["same", "different"]
    boxes: Annotated[list[PersonAt], Field(min_length=2, max_length=50)]


class NotAPerson(Act):
    """An act that states that a box shows no person, but for example a poster or a mannequin."""

    act: Literal["not_people"]
    box: PersonAt


class MarkLine(Act):
    """An act that adds a straight vertical or horizontal edge, marked by two pixels in each camera."""

    act: Literal["line"]
    direction: Literal["vertical", "horizontal", "x"]
    points: Annotated[dict[Name, tuple[Pixel, Pixel]], Field(min_length=1, max_length=1000)]


class Remove(Act):
    """An act that removes an entry, by its number from 1, of one of the lists of tables."""

    act: Literal["remove"]
    key: Literal["lengths", "people", "same", "different", "not_people", "lines", "checks"]
    number: Annotated[int, Field(ge=1, le=10**6)]


class ExcludeRegion(Act):
    """An act that excludes the people in a region of one camera's image, given by its corners."""

    act: Literal["exclude_region"]
    camera: Name
    corners: Annotated[list[Pixel], Field(min_length=3, max_length=200)]


class ExcludeTime(Act):
    """An act that excludes a time span of one camera's recording, seconds."""

    act: Literal["exclude_time"]
    camera: Name
    begin_s: Annotated[float, Field(ge=0, le=1e7)]
    end_s: Annotated[float, Field(ge=0, le=1e7)]


class Include(Act):
    """An act that removes an excluded region or time span, by its number from 1."""

    act: Literal["include"]
    camera: Name
    key: Literal["exclude", "exclude_s"]
    number: Annotated[int, Field(ge=1, le=10**6)]


class LeaveOut(Act):
    """An act that leaves a camera out of the scene."""

    act: Literal["leave_out"]
    camera: Name


class Moved(Act):
    """An act that states that a camera was moved at a second of its recording, and keeps the part before or after."""

    act: Literal["moved"]
    camera: Name
    at_s: Annotated[float, Field(ge=0, le=1e7)]
    keep: Literal["before", "after"]


class KeepAll(Act):
    """An act that removes a camera's limit in time."""

    act: Literal["keep_all"]
    camera: Name
    key: Literal["from_s", "until_s"]


class Undo(Act):
    """An act that undoes the last act."""

    act: Literal["undo"]


AnyAct = Annotated[
    MarkLength
    | PointAtPerson
    | SetWorld
    | MarkLine
    | CorrectIdentities
    | NotAPerson
    | Remove
    | ExcludeRegion
    | ExcludeTime
    | Include
    | Moved
    | KeepAll
    | LeaveOut
    | Undo
    | PlacePlan
    | RemovePlan,
    Field(discriminator="act"),
]


def perform(session: Session, content: Any) -> None:
    """Perform the act that a browser requests. Raises `InputError` (`StaleError` for an act on an older scene file)."""
    act = read_as(AnyAct, content)
    if isinstance(act, Undo):
        session.undo(act.version)
    else:
        session.act(act.version, lambda text: _apply_act(session, act, text))


def _apply_act(session: Session, act: AnyAct, text: str) -> str:
    """Return the scene file's text after an act."""
    if isinstance(act, MarkLength):
        measure_or_leave(session, act)
        if act.check:
            return add_length(text, act.metres, act.sd_m, act.points, "checks")
        return _rescale_world(session, add_length(text, act.metres, act.sd_m, act.points), act)
    if isinstance(act, PointAtPerson):
        return add_person(text, act.camera, act.frame, act.at, act.height_m, act.sd_m)
    if isinstance(act, MarkLine):
        return add_line(text, act.direction, act.points)
    if isinstance(act, CorrectIdentities):
        return add_identities(text, act.key, [(one.camera, one.frame, one.at) for one in act.boxes])
    if isinstance(act, NotAPerson):
        return add_not_a_person(text, act.box.camera, act.box.frame, act.box.at)
    if isinstance(act, SetWorld):
        return set_world_points(text, _world_points(session, act))
    if isinstance(act, Remove):
        return remove_entry(text, act.key, act.number)
    if isinstance(act, ExcludeRegion):
        return add_excluded(text, act.camera, "exclude", act.corners)
    if isinstance(act, ExcludeTime):
        return add_excluded(text, act.camera, "exclude_s", (act.begin_s, act.end_s))
    if isinstance(act, Include):
        return remove_excluded(text, act.camera, act.key, act.number)
    if isinstance(act, PlacePlan | RemovePlan):
        return change_plan(session, act, text)
    if isinstance(act, Moved):
        return set_time_limit(text, act.camera, "until_s" if act.keep == "before" else "from_s", act.at_s)
    if isinstance(act, KeepAll):
        return remove_time_limit(text, act.camera, act.key)
    assert isinstance(act, LeaveOut)
    return remove_camera(text, act.camera)


def measure_or_leave(session: Session, act: MarkLength) -> None:
    """Check that the rays of the marks meet, if a rig with poses of their cameras exists. Raises `InputError` otherwise."""
    try:
        rig = session.rig()
    except InputError:
        return
    if all(name in rig.names and rig[name].pose is not None for name in act.points):
        measure_length(rig, act.points)


def _world_points(session: Session, act: SetWorld) -> str:
    """Write the file with the two points of a world frame, and return its name."""
    rig, (scene, _) = session.rig(), session.scene()
    far = measure_axis(rig, [(one.camera, one.at) for one in (act.origin, act.along_x)]).metres
    along = far * scale_of_lengths(scene, rig)
    clicks = [
        GroundClick(ORIGIN, act.origin.camera, act.origin.at, 0.0),
        GroundClick(ALONG_X, act.along_x.camera, act.along_x.at, along),
    ]
    return write_points(session.scene_file.parent, clicks)


def _rescale_world(session: Session, text: str, act: MarkLength) -> str:
    """Return the text with the world frame corrected for a new length, if two clicks define the frame.

    The file of such a frame states the distance of the two clicks, which the length corrects. The origin stays at its click.
    """
    scene, _ = session.scene()
    points = None if scene.world is None else scene.world.points
    if points is None or not points.match(POINTS_FILE.format("*")):
        return text
    known = {one.name: one for one in read_known_points(scene.resolve(points))}
    if set(known) != {ORIGIN, ALONG_X}:
        return text
    clicked = {name: GroundAt(camera=camera, at=at) for name, one in known.items() for camera, at in one.pixels.items()}
    rig = session.rig()
    far = measure_axis(rig, [(clicked[name].camera, clicked[name].at) for name in (ORIGIN, ALONG_X)]).metres
    factors = [*_factors(scene, rig), act.metres / measure_length(rig, act.points).metres]
    along = far * float(np.median(factors))
    clicks = [GroundClick(name, clicked[name].camera, clicked[name].at, x) for name, x in ((ORIGIN, 0.0), (ALONG_X, along))]
    return set_world_points(text, write_points(session.scene_file.parent, clicks))


def scale_of_lengths(scene: Scene, rig: Rig) -> float:
    """Return the factor by which the scene's marked lengths correct the lengths of a rig; 1 without any marked length."""
    factors = _factors(scene, rig)
    return float(np.median(factors)) if factors else 1.0


def _factors(scene: Scene, rig: Rig) -> list[float]:
    """Return the ratio of stated to measured length for each marked length that the rig can measure."""
    found = []
    for one in scene.scale.lengths:
        points = {name: ends for name, ends in one.points.items() if name in rig.names and rig[name].pose is not None}
        try:
            found.append(one.metres / measure_length(rig, points).metres)
        except InputError:
            continue
    return found
