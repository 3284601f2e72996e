"""Requests of a browser about a plan: a draft that is tried on the rig, and the acts that write and delete `[world.plan]`."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Any, Literal

import numpy as np
import tomlkit
from pydantic import BaseModel, ConfigDict, Field, model_validator
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Table

from passerby.calibration.alignment.plan import align_to_plan
from passerby.calibration.alignment.world import Aligned
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.colours import camera_colour
from passerby.core.scale_cues import FloorPlan
from passerby.interchange.storage.safe_parsing import FileFaults, NotParsed, parse_toml
from passerby.page.plan_pictures import PlanPictures, plan_path
from passerby.page.requests import Act, Name, Pixel, read_as
from passerby.page.scene_edits import keep_lines
from passerby.page.session import Session
from passerby.report.rig_geometry import WEDGE_SHARE, stage_of, wedge
from passerby.scene.world_tables import PlanTable, floor_plan, plan_faults

Metres = Annotated[float, Field(gt=0, le=1e5)]
PIXEL_DIGITS = 2
STATED = ("image", "metres_per_pixel", "distance", "cameras", "points")
"""The keys that the page sets; other keys stay as a user wrote them in an editor."""
IN_EDITOR = "correct [world.plan] in an editor"


class PlanDistance(BaseModel):
    """A known distance between two pixels of the plan."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    between: tuple[Pixel, Pixel]
    metres: Metres
    sd_m: Metres | None = None


class PlanPoint(BaseModel):
    """A point of the ground, by its pixels on the plan and in cameras' pictures."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    at: Pixel
    pixels: Annotated[dict[Name, Pixel], Field(min_length=1, max_length=1000)]
    name: Name | None = None
    sd_m: Metres | None = None


class PlanDraft(BaseModel):
    """A plan with the cameras and points that are placed on it."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    image: Annotated[str, Field(max_length=40)] | None = None
    """File name of an uploaded picture; None: the picture that the scene file names."""
    metres_per_pixel: Metres | None = None
    distance: PlanDistance | None = None
    cameras: Annotated[dict[Name, Pixel], Field(max_length=1000)] = {}
    points: Annotated[list[PlanPoint], Field(max_length=1000)] = []

    @model_validator(mode="after")
    def _check_one_scale(self) -> PlanDraft:
        if (self.metres_per_pixel is None) == (self.distance is None):
            raise ValueError("the plan needs its scale: metres per pixel, or two clicks and their distance")
        return self


class PlacePlan(Act):
    """An act that sets `[world.plan]`."""

    act: Literal["plan"]
    plan: PlanDraft


class RemovePlan(Act):
    """An act that removes the plan from the scene."""

    act: Literal["remove_plan"]


def change_plan(session: Session, act: PlacePlan | RemovePlan, text: str) -> str:
    """Return the scene file's text after an act on the plan. Raises `InputError` for an invalid plan."""
    if isinstance(act, RemovePlan):
        return remove_plan(text)
    table = plan_table(session, act.plan)
    sizes = {}
    with suppress(InputError):  # without a rig, only a calibration can check the pixels of pictures
        sizes = {camera.name: camera.lens.size for camera in session.rig()}
    if wrong := plan_faults(table, "the plan:", sizes):
        raise FileFaults(wrong)
    return write_plan(text, state_plan(session, act.plan))


def plan_table(session: Session, draft: PlanDraft) -> PlanTable:
    """Return a draft as the scene file's table, with the full path of its picture. Raises `InputError` if it is no plan."""
    scene, _ = session.scene()
    old = None if scene.world is None else scene.world.plan
    now = state_plan(session, draft)
    others = {} if old is None else {key: one for key, one in old.model_dump(exclude_unset=True).items() if key not in STATED}
    if old is not None and old.image.as_posix() != now["image"]:
        others.pop("origin", None)  # it is a pixel of the old picture
    table: PlanTable = read_as(PlanTable, others | now)
    return table.model_copy(update={"image": plan_path(session, draft.image)})


def state_plan(session: Session, draft: PlanDraft) -> dict[str, Any]:
    """Return the content of `[world.plan]` for a draft, as plain values of TOML."""
    plan: dict[str, Any] = {"image": draft.image}
    if draft.image is None:
        world = session.scene()[0].world
        if world is None or world.plan is None:
            raise InputError("the scene file has no plan yet: upload one")
        plan["image"] = world.plan.image.as_posix()
    if draft.metres_per_pixel is not None:
        plan["metres_per_pixel"] = draft.metres_per_pixel
    if draft.distance is not None:
        known = draft.distance
        plan["distance"] = {"between": [_pixel(one) for one in known.between], "metres": known.metres}
        plan["distance"] |= {} if known.sd_m is None else {"sd_m": known.sd_m}
    if draft.cameras:
        plan["cameras"] = {name: _pixel(at) for name, at in draft.cameras.items()}
    if draft.points:
        plan["points"] = [_point(one) for one in draft.points]
    return plan


def _point(point: PlanPoint) -> dict[str, Any]:
    told: dict[str, Any] = {} if point.name is None else {"name": point.name}
    told |= {"at": _pixel(point.at), "pixels": {name: _pixel(at) for name, at in point.pixels.items()}}
    return told if point.sd_m is None else {**told, "sd_m": point.sd_m}


def _pixel(at: Pixel) -> list[float]:
    return [round(float(value), PIXEL_DIGITS) for value in at]


def write_plan(text: str, wanted: Mapping[str, Any]) -> str:
    """Return the text with `[world.plan]` as wanted and without any other frame; lines stay, except those that set the heading.

    Args:
        text: of the scene file.
        wanted: plain values of `STATED`; missing keys are removed. Points that are already in the file keep their position.

    Raises `InputError` if the file is not TOML, or has the plan in a form that cannot be changed here.
    """
    document = _parse_scene(text)
    world: Any = document.get("world")
    plan: Any = world.get("plan") if isinstance(world, Mapping) else None
    if isinstance(plan, Table):
        _update(plan, wanted)
    else:
        fresh = tomlkit.table(is_super_table=True)
        fresh["plan"] = _make_plan_table(wanted, plan)
        keep_lines(world, fresh)
        if world is None and text.strip():
            document.add(tomlkit.nl())
        document["world"] = fresh
    return _check_text(document, wanted)


def remove_plan(text: str) -> str:
    """Return the text without `[world.plan]`, and so without a stated world frame; lines stay. Raises `InputError` if none."""
    document = _parse_scene(text)
    world: Any = document.get("world")
    if not isinstance(world, Mapping) or "plan" not in world:
        raise InputError("[world.plan] is not there")
    fresh = tomlkit.table(is_super_table=True)
    keep_lines(world, fresh)
    if len(fresh):
        document["world"] = fresh
    else:
        del document["world"]
    return _check_text(document, None)


def _parse_scene(text: str) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(text)
    except TOMLKitError as error:
        raise InputError(f"the scene file is not TOML: {error}: correct it in an editor first") from None


def _make_plan_table(wanted: Mapping[str, Any], before: Any) -> Table:
    """Return a new table, with the other keys of a plan that was written as an inline table."""
    kept = {} if not isinstance(before, Mapping) else {key: before[key] for key in before if key not in STATED}
    if kept and strip_lines(before.get("image")) != wanted["image"]:
        kept.pop("origin", None)
    table = tomlkit.table()
    for key in STATED[:-1]:
        if key in wanted:
            table[key] = _item(wanted[key])
    for key, value in kept.items():
        table[key] = value
    if wanted.get("points"):
        table["points"] = _tables(wanted["points"])
    return table


def _update(plan: Table, wanted: Mapping[str, Any]) -> None:
    """Change the values that differ. The origin is a pixel of one picture, so it is removed with a change of picture."""
    if strip_lines(plan.get("image")) != wanted["image"]:
        plan.pop("origin", None)
    for key in STATED[:-1]:
        if key not in wanted:
            plan.pop(key, None)
        elif key == "cameras" and isinstance(plan.get(key), Mapping):
            _update_cameras(plan[key], wanted[key])
        elif strip_lines(plan.get(key)) != wanted[key]:
            plan[key] = _item(wanted[key])
    points = plan.get("points")
    if not isinstance(points, AoT):
        plan.pop("points", None)
        if wanted.get("points"):
            plan["points"] = _tables(wanted["points"])
        return
    left = [dict(one) for one in wanted.get("points", [])]
    for number in reversed(range(len(points))):
        one = strip_lines(points[number])
        if one in left:
            left.remove(one)
        else:
            del points[number]
    for one in left:
        points.append(_write_point(one))
    if not len(points):
        plan.pop("points")


def _update_cameras(cameras: Any, wanted: Mapping[str, Any]) -> None:
    for name in [name for name in cameras if name not in wanted]:
        del cameras[name]
    for name, at in wanted.items():
        if strip_lines(cameras.get(name)) != at:
            cameras[name] = at


def _item(value: Any) -> Any:
    """Return a value as a TOML item; a mapping becomes an inline table."""
    if not isinstance(value, Mapping):
        return value
    table = tomlkit.inline_table()
    for key, one in value.items():
        table[key] = one
    return table


def _tables(points: Any) -> AoT:
    tables = tomlkit.aot()
    for one in points:
        tables.append(_write_point(one))
    return tables


def _write_point(point: Mapping[str, Any]) -> Table:
    table = tomlkit.table()
    table.trivia.indent = "\n"  # an empty line before its header
    for key, value in point.items():
        table[key] = _item(value)
    return table


def strip_lines(item: Any) -> Any:
    """Return the plain value of a TOML item, without its formatting."""
    return item.unwrap() if hasattr(item, "unwrap") else item


def _check_text(document: tomlkit.TOMLDocument, wanted: Mapping[str, Any] | None) -> str:
    """Return the new text if it has the wanted content: a file may contain tables anywhere and in any form."""
    text = tomlkit.dumps(document)
    try:
        found = parse_toml(text.replace("\r\n", "\n")).get("world", {})
    except NotParsed:
        raise InputError(f"the plan cannot be changed here: {IN_EDITOR}") from None
    plan = found.get("plan") if isinstance(found, dict) else None
    if wanted is None and plan is None:
        return text
    if wanted is None or not isinstance(plan, dict) or _read_stated_plan(plan) != _read_stated_plan(wanted):
        raise InputError(f"the plan cannot be changed here: {IN_EDITOR}")
    return text


def _read_stated_plan(plan: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that the page sets, with sorted points for a comparison that ignores their order."""
    points = sorted(plan.get("points", []), key=repr)
    return {**{key: plan[key] for key in STATED[:-1] if key in plan}, "points": points}


def try_plan(session: Session, pictures: PlanPictures, content: Any) -> dict[str, Any]:
    """Align the rig to a draft, with the plan's scale, and return the result in pixels of the plan, ready for JSON.

    Nothing is written, and people are not fitted again: the next calibration fits them and may change the rig.

    Raises `InputError` for an invalid plan, or a pixel that a camera cannot see; `EvidenceError` if the placements do not
    determine an alignment, or there is no rig.
    """
    draft = read_as(PlanDraft, content)
    rig, table = session.rig(), plan_table(session, draft)
    plan = floor_plan(table, pictures.shown(table.image).size)
    aligned = align_to_plan(rig, plan, table.image, with_scale=True)
    return {
        "cameras": _cameras(aligned, plan),
        "placements": _placements(aligned, plan),
        "notes": [session.public(one) for one in aligned.notes],
        "scale_percent": 100 * (aligned.motion.scale - 1),
        "scale_sigma_percent": 100 * aligned.figures["scale_sigma"],
        "turn_sigma_deg": aligned.figures["turn_sigma_deg"],
        "place_sigma_m": aligned.figures["place_sigma_mm"] / 1000,
    }


def to_plan(plan: FloorPlan, xy: Floats) -> Floats:
    """Convert positions (N, 2) in a plan's world, metres, to pixels (N, 2) of the plan."""
    return np.asarray(np.asarray(xy, dtype=np.float64) / plan.metres_per_pixel * (1.0, -1.0) + plan.origin)


def _cameras(aligned: Aligned, plan: FloorPlan) -> list[dict[str, Any]]:
    """Return, for each camera with a pose, its position and its view of the nearby ground, pixels of the plan."""
    reach = WEDGE_SHARE * stage_of(aligned.rig, np.zeros((0, 2))).reach
    return [
        {
            "name": camera.name,
            "colour": camera_colour(place),
            "at": to_plan(plan, camera.centre[None, :2])[0].round(1).tolist(),
            "seen": to_plan(plan, wedge(camera, reach)).round(1).tolist(),
        }
        for place, camera in enumerate(aligned.rig)
        if camera.pose is not None
    ]


def _placements(aligned: Aligned, plan: FloorPlan) -> list[dict[str, Any]]:
    """Return, for each placed camera and each observation of a point, its residual and its position by the rig."""
    return [
        {
            "point": row.get("point"), "camera": row["camera"], "off_m": row["off_m"], "used": row["used"],
            "found": None if row["found_m"] is None else to_plan(plan, np.array([row["found_m"]]))[0].round(1).tolist(),
        }
        for row in aligned.residuals
    ]  # fmt: skip
