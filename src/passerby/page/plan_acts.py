"""What a browser says of a plan, checked: a draft to be tried on the rig, and the acts that write and delete it."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from passerby.common.errors import InputError
from passerby.interchange.storage.faults import FileFaults
from passerby.page.plan_edits import STATED, with_plan, without_plan
from passerby.page.plan_pictures import plan_path
from passerby.page.requests import Act, Name, Pixel, read_as
from passerby.page.session import Session
from passerby.scene.floor_plan import plan_faults
from passerby.scene.world_tables import PlanTable

Metres = Annotated[float, Field(gt=0, le=1e5)]
PIXEL_DIGITS = 2


class PlanDistance(BaseModel):
    """A known distance between two pixels of the plan."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    between: tuple[Pixel, Pixel]
    metres: Metres
    sd_m: Metres | None = None


class PlanPoint(BaseModel):
    """A point of the ground on the plan and in cameras' pictures."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    at: Pixel
    pixels: Annotated[dict[Name, Pixel], Field(min_length=1, max_length=1000)]
    name: Name | None = None
    sd_m: Metres | None = None


class PlanDraft(BaseModel):
    """A plan with what is placed on it."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    image: Annotated[str, Field(max_length=40)] | None = None
    """An uploaded picture; None: the one that the scene file names."""
    metres_per_pixel: Metres | None = None
    distance: PlanDistance | None = None
    cameras: Annotated[dict[Name, Pixel], Field(max_length=1000)] = {}
    points: Annotated[list[PlanPoint], Field(max_length=1000)] = []

    @model_validator(mode="after")
    def _one_scale(self) -> PlanDraft:
        if (self.metres_per_pixel is None) == (self.distance is None):
            raise ValueError("the plan needs its scale: metres per pixel, or two clicks and their distance")
        return self


class PlacePlan(Act):
    """`[world.plan]` as it shall be."""

    act: Literal["plan"]
    plan: PlanDraft


class RemovePlan(Act):
    """The scene without its plan."""

    act: Literal["remove_plan"]


def change_plan(session: Session, act: PlacePlan | RemovePlan, text: str) -> str:
    """The scene file's text after an act on the plan. Raises `InputError` for a plan that nothing can be laid upon."""
    if isinstance(act, RemovePlan):
        return without_plan(text)
    table = plan_table(session, act.plan)
    sizes = {}
    with suppress(InputError):  # without a rig, a calibration checks the pixels of pictures
        sizes = {camera.name: camera.lens.size for camera in session.rig()}
    if wrong := plan_faults(table, "the plan:", sizes):
        raise FileFaults(wrong)
    return with_plan(text, stated(session, act.plan))


def plan_table(session: Session, draft: PlanDraft) -> PlanTable:
    """A draft as the scene file's table, its picture as it can be opened. Raises `InputError` for what is no plan."""
    scene, _ = session.scene()
    old = None if scene.world is None else scene.world.plan
    now = stated(session, draft)
    others = {} if old is None else {key: one for key, one in old.model_dump(exclude_unset=True).items() if key not in STATED}
    if old is not None and old.image.as_posix() != now["image"]:
        others.pop("origin", None)  # a pixel of another picture
    table: PlanTable = read_as(PlanTable, others | now)
    return table.model_copy(update={"image": plan_path(session, draft.image)})


def stated(session: Session, draft: PlanDraft) -> dict[str, Any]:
    """What `[world.plan]` says of a draft, as plain values of TOML."""
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
