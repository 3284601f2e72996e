"""`[world]`: the frame that a user wants, and the plan that sets it together with the scale."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from passerby.core.scale_cues import CLICK_SD_PX, UNIT_SD
from passerby.scene.table import Metres, Pixel, Table

PlanPixel = tuple[Pixel, Pixel]


class PlanDistanceTable(Table):
    """`distance` of `[world.plan]`: a distance that is known between two pixels of the plan."""

    between: tuple[PlanPixel, PlanPixel]
    """[[u, v], [u, v]], two pixels of the plan, as far apart as possible."""
    metres: Metres
    """Between them."""
    sd_m: Metres = 0.02
    """Standard deviation of `metres`; the clicks on the plan add theirs."""

    @model_validator(mode="after")
    def _apart(self) -> Self:
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
    def _seen(self) -> Self:
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
    def _one_scale(self) -> Self:
        if (self.metres_per_pixel is None) == (self.distance is None):
            told = "no scale" if self.distance is None else "metres_per_pixel and distance"
            raise ValueError(
                f"has {told}: give one of metres_per_pixel and distance = {{ between = [[u, v], [u, v]], metres }}"
            )
        return self

    @model_validator(mode="after")
    def _placed(self) -> Self:
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
        """Each point's name in messages and its pixel of the plan."""
        return [(f"point {point.name or number}", point.at) for number, point in enumerate(self.points, start=1)]


class LineTable(Table):
    """`[[world.lines]]`: a straight vertical or horizontal thing, marked in one camera or more."""

    direction: Literal["vertical", "horizontal", "x"]
    """vertical: a door frame, the edge of a house. horizontal: a lintel, a court line, seen by two cameras or more. x:
    horizontal, and the world's x axis runs along it, from the first end to the second one."""
    points: dict[str, tuple[tuple[Pixel, Pixel], tuple[Pixel, Pixel]]]
    """camera -> two pixels on it, far apart. They need not be the same points in different cameras."""

    @model_validator(mode="after")
    def _marked(self) -> Self:
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
        """The key that sets the origin; None where there are lines only."""
        return next((key for key in ("camera", "points", "positions", "plan") if getattr(self, key) is not None), None)

    @property
    def heading_by_lines(self) -> bool:
        """Whether the x axis runs along a line."""
        return any(line.direction == "x" for line in self.lines)

    @model_validator(mode="after")
    def _one_way(self) -> Self:
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
