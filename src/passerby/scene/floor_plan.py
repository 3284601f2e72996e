"""The plan under `[world.plan]`, or in a file of its own, as a value; and what is wrong with its picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from passerby.common.errors import InputError
from passerby.core.scale_cues import FloorPlan, PlannedCamera, PlannedPoint
from passerby.interchange.plan_picture import read_plan_picture
from passerby.interchange.storage.faults import FileFaults, read_toml
from passerby.interchange.storage.versions import check_version
from passerby.scene.errors import Tables, explain_fault
from passerby.scene.world_tables import PlanDistanceTable, PlanPointTable, PlanTable

PLAN_FORMAT = 1
"""Version of the keys of a plan in a file of its own, which may be left out."""

TABLES: Tables = {(): PlanTable, ("distance",): PlanDistanceTable, ("points", "*"): PlanPointTable}
"""Of a file that is a plan and nothing else."""


def floor_plan(table: PlanTable, size: tuple[int, int] | None = None) -> FloorPlan:
    """A plan as a value. Its origin counts only where the table states it or the (width, height) of the picture is known."""
    unit, unit_sd = _metres_per_pixel(table)
    click = table.sd_px * unit if table.sd_m is None else table.sd_m
    corner = (0.0, 0.0) if size is None else (-0.5, size[1] - 0.5)
    return FloorPlan(
        name=table.image.name,
        metres_per_pixel=unit,
        unit_sd=unit_sd,
        cameras=tuple(PlannedCamera(name, at, click) for name, at in table.cameras.items()),
        points=tuple(
            PlannedPoint(point.name or str(number), point.at, point.pixels, click if point.sd_m is None else point.sd_m)
            for number, point in enumerate(table.points, start=1)
        ),
        origin=corner if table.origin is None else table.origin,
        click_sd_px=table.image_sd_px,
    )


def read_plan(path: Path) -> PlanTable:
    """The plan in a TOML file with the keys of `[world.plan]`, its picture as it can be opened.

    Raises `FileFaults` (an `InputError`) that names file, key, value and fix.
    """
    try:
        content = read_toml(path, "a plan (TOML)")
        check_version(path, content, "format_version", PLAN_FORMAT)
        content.pop("format_version", None)
        table = PlanTable.model_validate(content)
    except ValidationError as error:
        # A misspelt key is reported before the key that is missing for it.
        faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
        raise FileFaults([f"{path}: {explain_fault(dict(fault), TABLES)}" for fault in faults]) from None
    table = table.model_copy(update={"image": path.parent / table.image})
    if wrong := plan_faults(table, str(path), {}):
        raise FileFaults(wrong)
    return table


def plan_faults(table: PlanTable, place: str, sizes: Mapping[str, tuple[int, int]]) -> list[str]:
    """What is wrong with a plan's picture and the pixels on it.

    Args:
        table: the plan, its picture as it can be opened.
        place: the file and table that state it.
        sizes: camera -> (width, height) of its picture, pixels.
    """
    try:
        height, width = read_plan_picture(table.image).shape[:2]
    except InputError as error:
        return [f"{place} image: {error}"]
    marks = [(f"cameras {name}", at) for name, at in table.cameras.items()]
    marks += [(f"points {number} at", point.at) for number, point in enumerate(table.points, start=1)]
    marks += [] if table.distance is None else [("distance between", at) for at in table.distance.between]
    faults = [
        f"{place} {key}: [{u:g}, {v:g}] lies outside the {width} x {height} plan {table.image.name}: give a pixel of the plan"
        for key, (u, v) in marks
        if not _inside((u, v), (width, height))
    ]
    for number, point in enumerate(table.points, start=1):
        faults += [
            f"{place} points {number} pixels: [{u:g}, {v:g}] lies outside the {sizes[name][0]} x {sizes[name][1]} image of "
            f"camera {name}: give a pixel of that image"
            for name, (u, v) in point.pixels.items()
            if name in sizes and not _inside((u, v), sizes[name])
        ]
    return faults


def _inside(pixel: tuple[float, float], size: tuple[int, int]) -> bool:
    return -0.5 <= pixel[0] <= size[0] and -0.5 <= pixel[1] <= size[1]


def _metres_per_pixel(table: PlanTable) -> tuple[float, float]:
    """Metres per pixel and its relative standard deviation."""
    if table.metres_per_pixel is not None:
        return table.metres_per_pixel, table.metres_per_pixel_sd_percent / 100
    known = table.distance
    assert known is not None
    pixels = float(np.linalg.norm(np.subtract(*known.between)))
    return known.metres / pixels, float(np.hypot(known.sd_m / known.metres, np.sqrt(2) * table.sd_px / pixels))
