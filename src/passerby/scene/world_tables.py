"""`[world]`: the requested world frame, and the plan that sets it together with the scale."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from passerby.common.errors import InputError
from passerby.core.scale_cues import CLICK_SD_PX, UNIT_SD, FloorPlan, PlannedCamera, PlannedPoint
from passerby.interchange.plan_picture import read_plan_picture
from passerby.interchange.storage.safe_parsing import FileFaults, read_toml
from passerby.interchange.storage.text_formats import check_version
from passerby.scene.table import Metres, Pixel, Table, Tables, explain_fault

PlanPixel = tuple[Pixel, Pixel]
PLAN_FORMAT = 1
"""Version of the keys of a plan in a file of its own; the file may leave it out."""


class PlanDistanceTable(Table):
    """`distance` of `[world.plan]`: a distance that is known between two pixels of the plan."""

    between: tuple[PlanPixel, PlanPixel]
    """[[u, v], [u, v]], two pixels of the plan, as far apart as possible."""
    metres: Metres
    """Between them."""
    sd_m: Metres = 0.02
    """Standard deviation of `metres`; the clicks on the plan add theirs."""

    @model_validator(mode="after")
    def _check_apart(self) -> Self:
        if self.between[0] == self.between[1]:
            raise ValueError(f"between names the pixel {list(self.between[0])} twice: give two pixels that are far apart")
        return self


class PlanPointTable(Table):
    """`[[world.plan.points]]`: a point of the ground that is on the plan and that cameras see."""

    at: PlanPixel
    """[u, v], the point's pixel on the plan."""
    pixels: dict[str, PlanPixel]
    """camera -> [u, v], the point's pixel in its image. One camera is enough, since the point is on the ground; two or more
    that see it from different sides are better."""
    name: str | None = None
    """What messages call it. None: its number."""
    sd_m: Metres | None = None
    """Standard deviation of its place on the plan, in metres. None: `sd_px` of the plan."""

    @model_validator(mode="after")
    def _check_seen(self) -> Self:
        if not self.pixels:
            raise ValueError("pixels is empty: give the point's pixel in one camera or more, or delete the point")
        return self


class PlanTable(Table):
    """`[world.plan]`: a floor plan or a satellite picture. Two cameras or points of the ground that are placed on it set scale,
    origin and heading: the world's x runs to its right, y up, in metres.
    """

    image: Path
    """The picture of the plan (PNG, JPEG), seen from above."""
    metres_per_pixel: Metres | None = None
    """How long a pixel of the plan is. Or `distance`."""
    metres_per_pixel_sd_percent: Metres = 100 * UNIT_SD
    """Standard deviation of `metres_per_pixel`, in per cent."""
    distance: PlanDistanceTable | None = None
    """Instead of `metres_per_pixel`, two pixels of the plan and their distance:
    `distance = { between = [[u, v], [u, v]], metres = 12.5 }`."""
    origin: PlanPixel | None = None
    """[u, v], the pixel of the plan where the world's origin is. None: its lower left corner."""
    cameras: dict[str, PlanPixel] = Field(default_factory=dict)
    """camera -> [u, v], the pixel of the plan above which it is mounted."""
    points: tuple[PlanPointTable, ...] = ()
    """Points of the ground: `[[world.plan.points]]`."""
    sd_px: Metres = CLICK_SD_PX
    """Standard deviation of a click on the plan, in pixels of the plan."""
    sd_m: Metres | None = None
    """The same in metres, if the plan is less accurate than the clicks."""
    image_sd_px: Metres = CLICK_SD_PX
    """Standard deviation of a click in the image of a camera, in pixels."""

    @model_validator(mode="after")
    def _check_one_scale(self) -> Self:
        if (self.metres_per_pixel is None) == (self.distance is None):
            told = "no scale" if self.distance is None else "metres_per_pixel and distance"
            raise ValueError(
                f"has {told}: give one of metres_per_pixel and distance = {{ between = [[u, v], [u, v]], metres }}"
            )
        return self

    @model_validator(mode="after")
    def _check_placed(self) -> Self:
        placed = [*((f"camera {name}", at) for name, at in self.cameras.items()), *self.named_points()]
        if len(placed) < 2:
            raise ValueError(
                f"{len(placed)} camera or point is placed on the plan: place two or more, as far apart as possible, under "
                "cameras = { NAME = [u, v] } or [[world.plan.points]]"
            )
        names = [name for name, _ in placed]
        for (name, at), (other, there) in combinations(placed, 2):
            if at == there:
                raise ValueError(f"{name} and {other} are at the same pixel of the plan, {list(at)}: correct one, or delete it")
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{twice[0]} occurs twice: give each point a name of its own")
        for (first, (_, one)), (second, (_, two)) in combinations(
            enumerate(zip(names[len(self.cameras) :], self.points, strict=True)), 2
        ):
            for camera in one.pixels:
                if one.pixels[camera] == two.pixels.get(camera):
                    raise ValueError(
                        f"points {first + 1} and {second + 1} are at the same pixel of camera {camera}, "
                        f"{list(one.pixels[camera])}: correct one, or delete it"
                    )
        return self

    def named_points(self) -> list[tuple[str, PlanPixel]]:
        """Return each point's name in messages, and its pixel of the plan."""
        return [(f"point {point.name or number}", point.at) for number, point in enumerate(self.points, start=1)]


TABLES: Tables = {(): PlanTable, ("distance",): PlanDistanceTable, ("points", "*"): PlanPointTable}
"""The tables of a file that contains only a plan."""


class LineTable(Table):
    """`[[world.lines]]`: a straight vertical or horizontal thing, marked in one camera or more."""

    direction: Literal["vertical", "horizontal", "x"]
    """vertical: a door frame, the edge of a house. horizontal: a lintel, a court line, seen by two cameras or more. x:
    horizontal, and the world's x axis runs along it, from the first end to the second one."""
    points: dict[str, tuple[tuple[Pixel, Pixel], tuple[Pixel, Pixel]]]
    """camera -> two pixels on it, far apart. They need not be the same points in different cameras."""

    @model_validator(mode="after")
    def _check_marked(self) -> Self:
        if not self.points:
            raise ValueError("points is empty: mark two pixels of the line in one camera or more")
        for name, (first, second) in self.points.items():
            if first == second:
                raise ValueError(f"points of camera {name} are one pixel, {list(first)}: mark two, far apart")
        if self.direction == "horizontal" and len(self.points) < 2:
            raise ValueError('points: a horizontal line in one camera says nothing: mark it in two, or write direction = "x"')
        return self


class WorldTable(Table):
    """`[world]`: the requested world frame. Default: the origin is below the first camera, which faces along y."""

    camera: str | None = None
    """The origin is on the ground below this camera, the x axis along its viewing direction."""
    towards: str | None = None
    """With `camera`: the x axis points towards this other camera."""
    points: Path | None = None
    """Points with known coordinates, marked in the images: CSV or TOML."""
    positions: Path | None = None
    """Known positions of cameras, in metres or as latitude, longitude and altitude: CSV or TOML."""
    plan: PlanTable | None = None
    """A floor plan or a satellite picture with its scale, and cameras or points placed on it: `[world.plan]`."""
    lines: tuple[LineTable, ...] = ()
    """Straight vertical or horizontal things: `[[world.lines]]`. They correct the vertical, which otherwise upright people
    alone determine, and with direction "x" set the heading."""
    scale: bool = False
    """Whether points or positions also set the scale. Otherwise `[scale]` determines it, together with a plan, if there is one;
    with true the plan alone does."""
    tilt: bool = False
    """Whether they also set the up direction and the height. Otherwise the ground that people walk on stays at z = 0."""

    @property
    def placed_by(self) -> str | None:
        """The key that sets the origin; None if there are only lines."""
        return next((key for key in ("camera", "points", "positions", "plan") if getattr(self, key) is not None), None)

    @property
    def heading_by_lines(self) -> bool:
        """Whether the x axis runs along a line."""
        return any(line.direction == "x" for line in self.lines)

    @model_validator(mode="after")
    def _check_one_way(self) -> Self:
        ways = [key for key in ("camera", "points", "positions", "plan") if getattr(self, key) is not None]
        if len(ways) > 1 or not (ways or self.lines):
            told = " and ".join(ways) or "none of them"
            raise ValueError(f"has {told}: give one of camera, points, positions, plan")
        if self.heading_by_lines and self.towards is not None:
            raise ValueError('lines have direction "x", but towards sets the heading: delete one of them')
        if ways and ways != ["camera"] and self.heading_by_lines:
            raise ValueError(
                f'lines have direction "x", but {ways[0]} sets the heading: write "horizontal", or delete {ways[0]}'
            )
        if self.tilt and self.lines:
            raise ValueError("has lines and tilt: both set the vertical: delete one of them")
        if self.towards is not None and self.camera is None:
            raise ValueError("towards needs camera: name the camera at the origin, or delete towards")
        if self.towards is not None and self.towards == self.camera:
            raise ValueError("towards is the camera itself: name another one")
        if self.camera is not None and (self.scale or self.tilt):
            raise ValueError("scale and tilt need points or positions: a camera determines neither; delete them")
        if self.plan is not None and self.tilt:
            raise ValueError("tilt needs points or positions: a plan knows no heights; delete it")
        return self


def floor_plan(table: PlanTable, size: tuple[int, int] | None = None) -> FloorPlan:
    """Convert a plan's table to a `FloorPlan`.

    Its origin is valid only if the table states it or `size`, (width, height) of the picture, is known.
    """
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
    """Read a plan from a TOML file with the keys of `[world.plan]`; the path of its picture can be opened.

    Raises `FileFaults` (an `InputError`) that names file, key, value and remedy.
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
    """List the faults of a plan's picture and of the pixels on it.

    Args:
        table: the plan; the path of its picture can be opened.
        place: the file and table that state it.
        sizes: camera -> (width, height) of its image, pixels.
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
        if not _is_inside((u, v), (width, height))
    ]
    for number, point in enumerate(table.points, start=1):
        faults += [
            f"{place} points {number} pixels: [{u:g}, {v:g}] lies outside the {sizes[name][0]} x {sizes[name][1]} image of "
            f"camera {name}: give a pixel of that image"
            for name, (u, v) in point.pixels.items()
            if name in sizes and not _is_inside((u, v), sizes[name])
        ]
    return faults


def _is_inside(pixel: tuple[float, float], size: tuple[int, int]) -> bool:
    return -0.5 <= pixel[0] <= size[0] and -0.5 <= pixel[1] <= size[1]


def _metres_per_pixel(table: PlanTable) -> tuple[float, float]:
    """Return metres per pixel and its relative standard deviation."""
    if table.metres_per_pixel is not None:
        return table.metres_per_pixel, table.metres_per_pixel_sd_percent / 100
    known = table.distance
    assert known is not None
    pixels = float(np.linalg.norm(np.subtract(*known.between)))
    return known.metres / pixels, float(np.hypot(known.sd_m / known.metres, np.sqrt(2) * table.sd_px / pixels))
