"""Frigate: a zone of four points for each camera, with the lengths of its sides on the ground, for its estimate of speeds.

One YAML file with `cameras`, to be copied into Frigate's configuration: each camera has one zone with `coordinates`, the
corners as shares of width and height, and `distances`, the sides in metres between the corners in their order (Frigate's
`unit_system` must be metric).

Frigate knows the ground only by these four lengths. It computes the metres per pixel along the upper and the lower side, and
along the left and the right side, interpolates each pair over the zone and takes the mean of the two. But a step towards the
camera covers fewer pixels than the same step across. The difference depends on the camera's angle below the horizon: from 55
degrees on, all speeds can be right within 10 %, from 30 degrees barely within 30 %. `speed_errors` computes the errors of
Frigate's speeds inside a zone. The zone that is written is the largest one with errors within 10 %, or else the one with the
smallest error; a comment states the error.

Sources: frigate/util/velocity.py and frigate/config/camera/zone.py of github.com/blakeblackshear/frigate; "Speed Estimation" in
docs.frigate.video/configuration/zones.

`ground_points` maps pixels to the points of the ground z = 0 that they show, through the camera's own lens.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import yaml

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.interchange.formats.format import Export, Format, Losses
from passerby.interchange.formats.values import tame_names

FORBIDDEN, FIRST = re.compile(r"[^A-Za-z0-9_-]"), re.compile(r"[A-Za-z0-9]")
ZONE = "ground_"
"""Prefix of a zone's name before the camera's name: a zone must not have the name of a camera."""
GOOD = 0.10
"""Largest error of Frigate's speeds in a good zone, as a share of the true speed."""
SHORTEST_M, FARTHEST_M = 1.5, 60.0
"""Least length of a zone's sides, so that people need at least a second to cross it; largest distance of its corners from the
camera."""
MARGIN = 0.04
"""Least distance of a zone from the image's edges, as a share of its sides. People leave the image there, and Frigate advises
to keep zones away from the edges."""
PLACES = np.linspace(0.14, 0.86, 7)
EXTENTS = (0.08, 0.13, 0.2, 0.3, 0.45)
"""Centres and sizes of the zones that are tried, as shares of width and height."""
SAMPLES = (0.05, 0.35, 0.65, 0.95)
"""Positions in a zone, as shares along both sides, at which speeds are compared."""
DIRECTIONS = np.linspace(0, np.pi, 8, endpoint=False)
STEP_M = 0.05
"""Length of the step of a person from which a speed is computed."""


@dataclass(frozen=True, eq=False)
class SpeedZone:
    """A zone of one camera."""

    corners: Floats
    """(4, 2) pixels: upper left, upper right, lower right, lower left."""
    sides_m: Floats
    """(4,) lengths on the ground from each corner to the next, metres."""
    errors: tuple[float, float]
    """Smallest and largest error of Frigate's speeds in the zone, as shares of the true speeds."""

    @property
    def worst(self) -> float:
        """Largest absolute error."""
        return max(-self.errors[0], self.errors[1])


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the zones as a Frigate configuration file. Cameras that see too little ground are losses."""
    rig = export.posed(losses)
    names = tame_names(rig.names, FORBIDDEN, FIRST)
    comments, cameras = [], {}
    for camera in rig:
        zone = propose_zone(camera)
        if zone is None:
            losses.add(f"camera {camera.name} sees too little ground for a zone and is left out")
            continue
        name = names[camera.name]
        comments.append(f"# {name}: Frigate's speeds are off by {zone.errors[0]:+.0%} to {zone.errors[1]:+.0%} in this zone\n")
        shares = (zone.corners + 0.5) / camera.lens.size
        cameras[name] = {
            "zones": {
                f"{ZONE}{name}": {
                    "coordinates": ",".join(f"{share:.4f}" for share in shares.ravel()),
                    "distances": ",".join(f"{side:.3f}" for side in zone.sides_m),
                }
            }
        }
    if not cameras:
        raise InputError("no camera sees enough ground for a zone: there is nothing to export")
    text = "".join(comments) + yaml.safe_dump({"cameras": cameras}, sort_keys=False)
    return {"": text.encode("utf-8")}


def propose_zone(camera: Camera) -> SpeedZone | None:
    """Find the largest zone with good speeds in Frigate, else the zone with the least error; None without enough ground."""
    best, reached = None, (False, -np.inf)
    for corners in _candidates(camera):
        if not side_lengths(camera, corners).min() >= SHORTEST_M:
            continue
        zone = zone_at(camera, corners)
        if zone is not None:
            good = zone.worst <= GOOD
            rank = good, _area(camera, corners) if good else -zone.worst
            if rank > reached:
                best, reached = zone, rank
    return best


def zone_at(camera: Camera, corners: Floats) -> SpeedZone | None:
    """Compute the zone with corners (4, 2), pixels in order around it; None if a corner or its inside shows no ground."""
    sides = side_lengths(camera, corners)
    errors = speed_errors(camera, corners, sides)
    if not np.isfinite(sides).all() or not np.isfinite(errors).all():
        return None
    return SpeedZone(corners, sides, (float(errors.min()), float(errors.max())))


def side_lengths(camera: Camera, corners: Floats) -> Floats:
    """Compute the lengths (4,) on the ground, metres, from each corner of a zone, pixels (4, 2), to the next.

    A length is NaN if a corner shows no ground, or is farther than `FARTHEST_M` from the camera.
    """
    points = ground_points(camera, corners)
    far = np.linalg.norm(points - camera.centre[:2], axis=1) > FARTHEST_M
    points = np.where(far[:, None], np.nan, points)
    return np.asarray(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1))


def speed_errors(camera: Camera, corners: Floats, sides_m: Floats) -> Floats:
    """Compute the errors of Frigate's speeds in a zone, over its inside and all directions of walking.

    Args:
        camera: a camera with a pose.
        corners: (4, 2) pixels, in order around the zone.
        sides_m: (4,) lengths of its sides, as configured in Frigate.

    Returns:
        (N,) Frigate's speed divided by the true speed, minus 1; NaN where the zone shows no ground.
    """
    u, v = (part.ravel() for part in np.meshgrid(SAMPLES, SAMPLES))
    a, b, c, d = corners
    pixels = np.outer((1 - u) * (1 - v), a) + np.outer(u * (1 - v), b) + np.outer(u * v, c) + np.outer((1 - u) * v, d)
    points = ground_points(camera, pixels)
    steps = STEP_M * np.column_stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)])
    ends = points[:, None] + steps
    seen = camera.project(np.concatenate([ends.reshape(-1, 2), np.zeros((ends.size // 2, 1))], axis=1))
    stepped = np.linalg.norm(seen.reshape(ends.shape) - pixels[:, None], axis=2)
    return np.asarray((metres_per_pixel(corners, sides_m, pixels)[:, None] * stepped / STEP_M - 1).ravel())


def metres_per_pixel(corners: Floats, sides_m: Floats, pixels: Floats) -> Floats:
    """Compute the metres per pixel (N,) at pixels (N, 2), as Frigate interpolates them from a zone's sides.

    Frigate begins with the corner whose coordinates have the smallest sum. The direction from there to the next corner is left
    to right, the direction from there to the last corner is downwards.
    """
    first = int(np.argmin(corners.sum(axis=1)))
    corners, sides_m = np.roll(corners, -first, axis=0), np.roll(sides_m, -first)
    upper, right, lower, left = sides_m / np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = (pixels[:, 0] - corners[0, 0]) / (corners[1, 0] - corners[0, 0])
        down = (pixels[:, 1] - corners[0, 1]) / (corners[3, 1] - corners[0, 1])
    return np.asarray((upper + (lower - upper) * down + left + (right - left) * across) / 2)


def _candidates(camera: Camera) -> Iterator[Floats]:
    """Generate the corners (4, 2) of rectangles whose centres show ground within `FARTHEST_M`, always in the same order."""
    size = np.array(camera.lens.size, dtype=np.float64)
    for y in PLACES:
        for x in PLACES:
            if not np.isfinite(side_lengths(camera, np.tile(size * (x, y), (4, 1)))).all():
                continue
            for height in EXTENTS:
                for width in EXTENTS:
                    low, high = np.array([x - width / 2, y - height / 2]), np.array([x + width / 2, y + height / 2])
                    if low.min() >= MARGIN and high.max() <= 1 - MARGIN:
                        yield size * np.array([low, (high[0], low[1]), high, (low[0], high[1])]) - 0.5


def _area(camera: Camera, corners: Floats) -> float:
    """Compute the area of the ground in a zone, square metres (the shoelace formula)."""
    x, y = ground_points(camera, corners).T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def ground_points(camera: Camera, pixels: Floats) -> Floats:
    """Intersect the rays of pixels with the ground.

    Args:
        camera: a camera with a pose; world z up, ground at z = 0, metres.
        pixels: (N, 2) pixels of the original picture, with distortion.

    Returns:
        (N, 2) world x and y, metres; NaN for a ray that does not meet the ground ahead of the camera.
    """
    assert camera.pose is not None
    rays = camera.lens.bearings(pixels) @ camera.pose.R_cw
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -camera.centre[2] / rays[:, 2]
        points = camera.centre[:2] + far[:, None] * rays[:, :2]
    return np.asarray(np.where((far > 0)[:, None] & np.isfinite(points), points, np.nan), dtype=np.float64)


FORMAT = Format(
    name="frigate",
    title="Zones for Frigate's speed estimation",
    tools=("Frigate",),
    target="file",
    suffixes=(".yml", ".yaml"),
    conventions="One zone for each camera: corners as shares of the image, sides in metres on the ground. Frigate's own "
    "interpolation is wrong in many places; a comment for each camera states by how much, for all directions of walking.",
    write=write,
)
