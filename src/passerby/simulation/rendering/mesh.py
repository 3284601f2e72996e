"""A person's surface: rings of points around the joints, and the quads between them.

The surface follows the spheres of `passerby.simulation.body`, whose hull is a person's true box, as closely as a human shape
allows: head to soles exactly, hands, elbows, feet and the trunk's sides within about a hundredth of the standing height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.simulation.body import JOINTS

PARTS = ("trunk", "neck", "head", "arm", "hand", "leg", "shoe", "hair", "skirt", "backpack", "brim")
"""Kinds of parts; the last four are worn by some people only."""
OPTIONAL = ("hair", "skirt", "backpack", "brim")
CONVEX = {"trunk": 4, "arm": 6, "leg": 5}
"""Number of bands of a part that are nearly convex together: limbs are cut at elbow and knee. Other parts are convex."""

_FRAMES = (
    ("chest", "pelvis"),
    ("up", "up"),
    *(
        pair
        for side in ("left", "right")
        for pair in (
            (f"{side}_shoulder", f"{side}_elbow"),
            (f"{side}_shoulder", f"{side}_wrist"),
            (f"{side}_elbow", f"{side}_wrist"),
            (f"{side}_hip", f"{side}_knee"),
            (f"{side}_hip", f"{side}_ankle"),
            (f"{side}_knee", f"{side}_ankle"),
            (f"{side}_heel", f"{side}_toe"),
        )
    ),
)
"""Axes of the rings, each from one joint to another; "up" is the world's z. At an elbow or knee, the axis spans both limbs."""


@dataclass(frozen=True)
class _Ring:
    """An ellipse around a point between two joints; lengths are fractions of the standing height."""

    first: str
    last: str
    place: float
    """0 at the first joint, 1 at the last; may be below 0 or above 1."""
    across: float
    """Half width along the body's left."""
    deep: float
    """Half depth along the body's front."""
    axis: tuple[str, str]
    ahead: float = 0.0
    """Offset from the joints' line to the front."""
    above: float = 0.0
    """Offset from the joints' line along the world's z."""


@dataclass(frozen=True, eq=False)
class Template:
    """The surface of any person. V points in rings, F quads, whose corners run anticlockwise seen from outside."""

    first: Ints
    """(V,) index of the joint at one end of the ring's line."""
    last: Ints
    """(V,) index of the joint at its other end."""
    place: Floats
    """(V,) 0 at the first joint, 1 at the last."""
    axis: Ints
    """(V,) index of the ring's axis."""
    offsets: Floats
    """(V, 3) offsets from that line along the axis's left and front and the world's z, fractions of the standing height."""
    quads: Ints
    """(F, 4) point indices."""
    part: Ints
    """(F,) index of `PARTS`."""
    ring: Ints
    """(F,) number of the band between two rings in its part, from 0 at the top (of a shoe: at the heel)."""
    angle: Floats
    """(F,) radians about the axis: 0 on the body's left, pi / 2 in front."""
    piece: Ints
    """(F,) number of the nearly convex piece of a quad, for shadows."""
    pieces: tuple[Ints, ...]
    """Indices of the points of each piece."""

    def faces(self, part: str) -> NDArray[np.bool_]:
        """Return whether quads belong to a kind of part, (F,)."""
        return np.asarray(self.part == PARTS.index(part))


def pose_surface(template: Template, joints: Floats, heights: Floats, builds: Floats) -> Floats:
    """Compute the points of P people's surfaces.

    Args:
        template: surface with V points.
        joints: (P, J, 3) world, metres, from `body.pose_joints`.
        heights: (P,) standing heights, metres.
        builds: (P,) factor on all widths, about 1.

    Returns:
        (P, V, 3) points, world, metres.
    """
    left, front = _axes(joints)
    start = joints[:, template.first]
    along = joints[:, template.last] - start
    size = (heights * builds)[:, None, None]
    sideways = left[:, template.axis] * template.offsets[:, :1] + front[:, template.axis] * template.offsets[:, 1:2]
    points = start + template.place[:, None] * along + size * sideways
    points[..., 2] += heights[:, None] * template.offsets[:, 2]
    return np.asarray(points)


def _axes(joints: Floats) -> tuple[Floats, Floats]:
    """Compute the left and the front of each axis, unit vectors (P, A, 3) perpendicular to it."""
    left = joints[:, JOINTS.index("left_shoulder")] - joints[:, JOINTS.index("right_shoulder")]
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    first = [JOINTS.index(first) for first, _ in _FRAMES if first != "up"]
    last = [JOINTS.index(last) for _, last in _FRAMES if last != "up"]
    axes = np.empty((len(joints), len(_FRAMES), 3))
    limbs = np.array([first != "up" for first, _ in _FRAMES])
    axes[:, limbs] = joints[:, first] - joints[:, last]
    axes[:, ~limbs] = (0.0, 0.0, 1.0)
    front = np.cross(left[:, None], axes)
    front /= np.linalg.norm(front, axis=-1, keepdims=True)
    across = np.cross(axes, front)
    return across / np.linalg.norm(across, axis=-1, keepdims=True), front


@cache
def template(fine: bool) -> Template:
    """Return the surface with about 800 quads for people near the camera, or with about 300 for small people in the picture."""
    builder = _Builder()
    for part, rings, sides, power in _tubes():
        builder.add(part, rings, sides if fine else max(5, round(0.55 * sides)), power)
    return builder.template()


class _Builder:
    """A collector of the tubes of a template."""

    def __init__(self) -> None:
        self._points: list[tuple[int, int, float, int, float, float, float]] = []
        self._quads: list[tuple[int, int, int, int]] = []
        self._faces: list[tuple[int, int, float, int]] = []
        self._pieces: list[list[int]] = []

    def add(self, part: str, rings: Sequence[_Ring], sides: int, power: float) -> None:
        """Add a tube; small outer rings close its ends. With a power below 1 the rings are nearly square."""
        angles = 2 * np.pi * np.arange(sides) / sides
        c, s = (np.sign(wave) * np.abs(wave) ** power for wave in (np.cos(angles), np.sin(angles)))
        base = len(self._points)
        for ring in rings:
            joints = JOINTS.index(ring.first), JOINTS.index(ring.last)
            for across, deep in zip(ring.across * c, ring.deep * s, strict=True):
                offsets = float(across), float(deep) + ring.ahead, ring.above
                self._points.append((*joints, ring.place, _FRAMES.index(ring.axis), *offsets))
        for row in range(len(rings) - 1):
            above, below = base + row * sides, base + (row + 1) * sides
            if row % CONVEX.get(part, len(rings)) == 0:
                self._pieces.append([])
            self._pieces[-1] += range(above, below + sides)
            for column in range(sides):
                after = (column + 1) % sides
                self._quads.append((above + column, above + after, below + after, below + column))
                angle = 2 * np.pi * (column + 0.5) / sides
                self._faces.append((PARTS.index(part), row, angle, len(self._pieces) - 1))

    def template(self) -> Template:
        """Return the template of all tubes."""
        points = np.array(self._points)
        faces = np.array(self._faces)
        return Template(
            first=points[:, 0].astype(np.int64),
            last=points[:, 1].astype(np.int64),
            place=points[:, 2],
            axis=points[:, 3].astype(np.int64),
            offsets=points[:, 4:],
            quads=np.array(self._quads, dtype=np.int64),
            part=faces[:, 0].astype(np.int64),
            ring=faces[:, 1].astype(np.int64),
            angle=faces[:, 2],
            piece=faces[:, 3].astype(np.int64),
            pieces=tuple(np.unique(points) for points in self._pieces),
        )


def _tubes() -> list[tuple[str, list[_Ring], int, float]]:
    """Return, for each tube: part, rings from the top down, number of sides, and power (see `_Builder.add`)."""
    tubes = [
        ("trunk", _trunk(), 16, 0.85),
        ("neck", _neck(), 8, 1.0),
        ("head", _head(), 14, 1.0),
        ("hair", _long_hair(), 10, 1.0),
        ("brim", _brim(), 12, 1.0),
        ("backpack", _backpack(), 8, 0.5),
    ]
    for side in ("left", "right"):
        tubes += [
            ("arm", _arm(side), 9, 1.0),
            ("hand", _hand(side), 6, 1.0),
            ("leg", _leg(side), 10, 1.0),
            ("skirt", _skirt(side), 10, 0.9),
            ("shoe", _shoe(side), 8, 0.8),
        ]
    return tubes


def _trunk() -> list[_Ring]:
    """Return the rings of the trunk; the pelvis is at place 0, the shoulders at 1."""
    rows = (
        (1.17, 0.030, 0.030, -0.004),
        (1.13, 0.050, 0.036, -0.006),
        (1.07, 0.088, 0.044, -0.006),
        (0.97, 0.113, 0.052, -0.002),
        (0.82, 0.112, 0.060, 0.002),
        (0.66, 0.104, 0.064, 0.006),
        (0.48, 0.092, 0.058, 0.002),
        (0.33, 0.088, 0.056, 0.0),
        (0.20, 0.096, 0.062, -0.002),
        (0.05, 0.101, 0.068, -0.008),
        (-0.08, 0.094, 0.064, -0.008),
        (-0.17, 0.055, 0.045, -0.004),
        (-0.20, 0.010, 0.010, 0.0),
    )
    axis = ("chest", "pelvis")
    return [_Ring("pelvis", "chest", place, across, deep, axis, ahead) for place, across, deep, ahead in rows]


def _neck() -> list[_Ring]:
    axis = ("up", "up")
    return [
        _Ring("head", "head", 0.0, 0.028, 0.030, axis, -0.008, -0.045),
        _Ring("neck", "neck", 0.0, 0.030, 0.030, axis, -0.004, 0.005),
        _Ring("neck", "neck", 0.0, 0.036, 0.036, axis, -0.004, -0.015),
    ]


def _head() -> list[_Ring]:
    """Return an egg-shaped head with the chin in front; its crown is exactly as high as the head's sphere."""
    rows = (
        (0.0545, 0.006, 0.006, -0.004),
        (0.050, 0.022, 0.027, -0.004),
        (0.040, 0.034, 0.042, -0.003),
        (0.026, 0.042, 0.051, -0.001),
        (0.010, 0.046, 0.055, 0.0),
        (-0.008, 0.046, 0.055, 0.0),
        (-0.026, 0.044, 0.052, 0.001),
        (-0.044, 0.040, 0.046, 0.006),
        (-0.060, 0.034, 0.036, 0.014),
        (-0.072, 0.024, 0.024, 0.024),
        (-0.079, 0.006, 0.006, 0.028),
    )
    return [_Ring("head", "head", 0.0, across, deep, ("up", "up"), ahead, above) for above, across, deep, ahead in rows]


def _long_hair() -> list[_Ring]:
    """Return long hair, which falls behind the head onto the shoulders."""
    rows = ((0.046, 0.018, 0.016, -0.024), (0.030, 0.041, 0.032, -0.026), (0.0, 0.049, 0.036, -0.026),
            (-0.04, 0.050, 0.036, -0.024), (-0.08, 0.048, 0.030, -0.024), (-0.105, 0.046, 0.024, -0.028),
            (-0.11, 0.008, 0.008, -0.030))  # fmt: skip
    return [_Ring("head", "head", 0.0, across, deep, ("up", "up"), ahead, above) for above, across, deep, ahead in rows]


def _brim() -> list[_Ring]:
    """Return the brim of a cap."""
    rows = ((0.026, 0.040, 0.012, 0.046), (0.023, 0.038, 0.022, 0.052), (0.020, 0.020, 0.008, 0.050))
    return [_Ring("head", "head", 0.0, across, deep, ("up", "up"), ahead, above) for above, across, deep, ahead in rows]


def _skirt(side: str) -> list[_Ring]:
    """Return half of a skirt, from the waist to above the knee; it lies around the thigh and so follows a bend of the hips."""
    hip, knee = f"{side}_hip", f"{side}_knee"
    rows = ((-0.30, 0.030, 0.050), (-0.10, 0.050, 0.066), (0.20, 0.056, 0.070), (0.55, 0.058, 0.070), (0.85, 0.060, 0.072))
    return [_Ring(hip, knee, place, across, deep, (hip, knee)) for place, across, deep in rows]


def _backpack() -> list[_Ring]:
    """Return a flat backpack: it enlarges the body's outline by less than a fiftieth of the height."""
    rows = ((1.02, 0.030, 0.010), (0.98, 0.062, 0.030), (0.75, 0.072, 0.036), (0.50, 0.072, 0.036), (0.32, 0.064, 0.032),
            (0.28, 0.030, 0.010))  # fmt: skip
    axis = ("chest", "pelvis")
    return [_Ring("pelvis", "chest", place, across, deep, axis, -0.052) for place, across, deep in rows]


def _arm(side: str) -> list[_Ring]:
    shoulder, elbow, wrist = f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"
    upper, bend, lower = (shoulder, elbow), (shoulder, wrist), (elbow, wrist)
    rows = (
        (shoulder, elbow, -0.18, 0.008, upper),
        (shoulder, elbow, -0.13, 0.022, upper),
        (shoulder, elbow, -0.02, 0.034, upper),
        (shoulder, elbow, 0.18, 0.036, upper),
        (shoulder, elbow, 0.50, 0.032, upper),
        (shoulder, elbow, 0.78, 0.028, upper),
        (shoulder, elbow, 1.0, 0.026, bend),
        (elbow, wrist, 0.28, 0.026, lower),
        (elbow, wrist, 0.65, 0.022, lower),
        (elbow, wrist, 1.0, 0.018, lower),
    )
    return [_Ring(first, last, place, radius, radius, axis) for first, last, place, radius, axis in rows]


def _hand(side: str) -> list[_Ring]:
    wrist, hand, axis = f"{side}_wrist", f"{side}_hand", (f"{side}_elbow", f"{side}_wrist")
    rows = ((-0.1, 0.012, 0.015), (0.35, 0.013, 0.022), (0.9, 0.015, 0.024), (1.25, 0.012, 0.017), (1.46, 0.004, 0.005))
    return [_Ring(wrist, hand, place, across, deep, axis) for place, across, deep in rows]


def _leg(side: str) -> list[_Ring]:
    hip, knee, ankle = f"{side}_hip", f"{side}_knee", f"{side}_ankle"
    thigh, bend, shank = (hip, knee), (hip, ankle), (knee, ankle)
    rows = (
        (hip, knee, -0.10, 0.030, 0.040, thigh, -0.004),
        (hip, knee, 0.05, 0.050, 0.060, thigh, -0.006),
        (hip, knee, 0.30, 0.049, 0.056, thigh, 0.0),
        (hip, knee, 0.60, 0.042, 0.047, thigh, 0.002),
        (hip, knee, 0.85, 0.037, 0.040, thigh, 0.002),
        (hip, knee, 1.0, 0.035, 0.038, bend, 0.0),
        (knee, ankle, 0.15, 0.033, 0.036, shank, -0.002),
        (knee, ankle, 0.35, 0.033, 0.037, shank, -0.006),
        (knee, ankle, 0.65, 0.028, 0.031, shank, -0.004),
        (knee, ankle, 0.92, 0.024, 0.028, shank, 0.0),
        (knee, ankle, 1.0, 0.010, 0.012, shank, 0.0),
    )
    return [_Ring(*row) for row in rows]


def _shoe(side: str) -> list[_Ring]:
    """Return a shoe from the heel to the toe; the front of this axis points up."""
    heel, toe = f"{side}_heel", f"{side}_toe"
    axis = (heel, toe)
    rows = ((-0.16, 0.010, 0.010, 0.0), (-0.10, 0.020, 0.021, 0.002), (0.10, 0.025, 0.030, 0.010), (0.30, 0.026, 0.030, 0.010),
            (0.55, 0.027, 0.023, 0.003), (0.85, 0.030, 0.019, -0.001), (1.05, 0.025, 0.016, -0.004),
            (1.15, 0.010, 0.009, -0.006))  # fmt: skip
    return [_Ring(heel, toe, place, across, deep, axis, ahead) for place, across, deep, ahead in rows]
