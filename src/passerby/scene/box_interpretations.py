"""Interpretation of the numbers of boxes: their format, the rotation of their image, and whether they lie on a coarse grid.

An interpretation is a box format and a rotation of the image by quarter turns. The stated one is compared with its rivals:
boxes have positive sizes and lie within their image; people stand upright on one level ground. One detector usually made all
boxes of a scene, so the cameras that state the same format are tested together, and then each by itself.

The borders of the images show the format. In a wrong format, boxes reach far beyond two borders and keep away from the other
two. Boxes of people who are cut off by a border, but drawn whole, reach equally beyond the left and the right border.

The level fit of the people (`single_view`) shows the rotation: in a camera above the heads, people who are lower in the image
are larger. A camera at about the height of body centres fits both ways up, and so does one that looks straight down; then no
rotation is reported. Keypoints have names, and show head and feet directly.

If a camera's boxes lie on a grid that is coarse in relation to people, their sizes are those of blocks, not of bodies.
Recorders that find motion in blocks of a compressed video, and detectors that output cells, round boxes outwards: the smaller
people are in the image, the more they are enlarged. A rig from such boxes fits well and has a wrong scale.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens
from passerby.core.figures import AdjustedFigures
from passerby.core.observations import FORMATS, MIN_JOINT_SCORE, Boxes, BoxFormat, CameraObservations, Keypoints
from passerby.findings.finding import Finding, notice
from passerby.geometry.single_view import Level, level_camera
from passerby.people.segments import FEET, HEAD, MIN_EXTENT_PX

BEYOND = 0.2
"""Share of a box that lies beyond a border, above which it counts as beyond."""
SLACK = 0.05
"""The same share if a rival format is tested with one camera alone: in the correct format, boxes end at the border. Bodies
that are drawn whole reach farther; then one camera alone gives no result."""
FEWEST, ALONE = 10, 5
"""Minimum number of boxes beyond the borders of each axis, for all cameras together, and for one camera by itself."""
MOST_ELSEWHERE, MOST_FARTHER = 0.1, 0.02
"""Maximum number of boxes beyond the borders in a rival format, as a share of those in the stated one: for all cameras
together, and for one by itself."""
FEWEST_ROWS, MISREAD_SHARE = 20, 0.1
"""The format "corners" is certain if there are at least this many rows, all with the right edge beyond the left and the lower
edge below the upper, and at least this share of the boxes is beyond the image in the stated format. With left, top, width,
height at random positions, at most every second row would fulfil this."""
LARGEST_SHARE = 2.0
"""Largest number in normalised boxes: a body that is drawn whole may reach beyond 1. No person has a box of two pixels."""
MIN_BODIES = 50
FITS_BETTER, FITS_WELL = 1.6, 0.35
"""A rotated image is better if 90 % of its people fit one ground within `FITS_WELL` of their extent, and `FITS_BETTER` times
better than as stated: the rotation holds for all its people. Images upside down, turned back, have a misfit of at most 0.30 for
90 % of the people (all presets, cameras at 2 to 6 m). On two terraces, where no ground fits as stated, it is above 0.51."""
LEAST_MISFIT = 0.1
"""A better fit does not count if the median misfit of the boxes as stated is below this: ordinary boxes have 0.04 to 0.1."""
WIDER = 1.0
"""Minimum median ratio of width to height of the people in an image on its side. Upright people have 0.3 to 0.55 (cameras of
all presets, 1.5 to 9 m high, seeds 200 and 201), so 1.8 to 3 on the side."""
HEADS_ELSEWHERE = 0.8
"""Minimum share of the bodies of keypoints that have the head in this direction from the feet. In an upright image some people
lie, bend or do handstands, but few for long."""
TURNS = {0: (0, -1), 90: (-1, 0), 180: (0, 1), 270: (1, 0)}
"""Direction of the heads in an image, in pixels, by the degrees clockwise that put the image upright."""
FEWEST_FOR_GRID, MOST_FOR_GRID = 50, 2000
"""Minimum number of boxes for the test of a grid, and maximum number of boxes tested, evenly spaced among all."""
ON_GRID = 0.98
"""Minimum share of the edges on multiples of the step: boxes that are clipped at the image border may be off the grid."""
COARSE = 0.1
"""Step of a coarse grid, as a share of the boxes' median height. Rounding outwards adds one step to a height on average. That
is twice the uncertainty of a scale from people's stature."""


@dataclass(frozen=True, eq=False)
class BoxesAsStated:
    """The boxes of one camera as the stated format reads them."""

    name: str
    boxes: Boxes
    """Left, top, width, height in pixels."""
    size: tuple[int, int]
    """Width and height of the image, pixels."""
    stated: BoxFormat

    @property
    def numbers(self) -> Floats:
        """(N, 4) numbers of the boxes as they are in the file."""
        return self.stated.of_ltwh(self.boxes.ltwh, self.size)

    def borders(self, box_format: BoxFormat) -> _Borders:
        """Count the boxes beyond the borders of the image if the numbers are read in another format."""
        return _Borders.of(box_format.to_ltwh(self.numbers, self.size), self.size)


@dataclass(frozen=True)
class OtherFormat:
    """A format that fits the boxes of some cameras better than the stated one."""

    cameras: tuple[str, ...]
    box_format: BoxFormat
    certain: bool
    beyond: int
    """Number of boxes beyond the borders of their images in the stated format."""
    rows: int
    """Number of all boxes."""


@dataclass(frozen=True)
class _Borders:
    """Counts of the boxes of one camera or several."""

    rows: int
    positive: int
    """Number of boxes with a positive width and height."""
    beyond: Ints
    """(2,) number of boxes with more than `BEYOND` of their width, and of their height, outside the image on one side."""
    outside: Ints
    """(2,) the same with more than `SLACK`."""

    @classmethod
    def of(cls, ltwh: Floats, size: tuple[int, int]) -> _Borders:
        extent = ltwh[:, 2:]
        over = np.maximum(-ltwh[:, :2], ltwh[:, :2] + extent - np.array(size)) / np.maximum(extent, 1e-9)
        return cls(len(ltwh), int((extent > 0).all(axis=1).sum()), (over > BEYOND).sum(axis=0), (over > SLACK).sum(axis=0))

    @classmethod
    def joined(cls, parts: Sequence[_Borders]) -> _Borders:
        return cls(
            sum(part.rows for part in parts), sum(part.positive for part in parts),
            np.sum([part.beyond for part in parts], axis=0), np.sum([part.outside for part in parts], axis=0),
        )  # fmt: skip


def find_other_formats(cameras: Sequence[BoxesAsStated]) -> tuple[OtherFormat, ...]:
    """Find the cameras whose boxes fit another format better than the stated one.

    Args:
        cameras: the boxes of each camera.
    """
    cameras = [camera for camera in cameras if len(camera.boxes)]
    unit = [camera for camera in cameras if _are_shares(camera) != camera.stated.normalised]
    out = [_find_other_unit(unit)] if unit else []
    for stated in dict.fromkeys(camera.stated for camera in cameras):
        alike = [camera for camera in cameras if camera.stated == stated and camera not in unit]
        together = _find_other_convention(alike, alone=False) if alike else None
        each = [] if together else [found for camera in alike if (found := _find_other_convention([camera], alone=True))]
        out += [together] if together else _merge_formats(each)
    return tuple(out)


def _are_shares(camera: BoxesAsStated) -> bool:
    return bool(np.abs(camera.numbers).max() <= LARGEST_SHARE)


def _find_other_unit(cameras: Sequence[BoxesAsStated]) -> OtherFormat:
    """Find the format of boxes in the other unit; among equal fits, the stated convention, or else the first."""
    stated = cameras[0].stated
    rivals = sorted(
        (one for one in FORMATS if one.normalised != stated.normalised), key=lambda one: one.convention != stated.convention
    )

    def implausible(rival: BoxFormat) -> int:
        seen = _Borders.joined([camera.borders(rival) for camera in cameras])
        return 2 * (seen.rows - seen.positive) + int(seen.beyond.sum())

    rows = sum(len(camera.boxes) for camera in cameras)
    return OtherFormat(tuple(camera.name for camera in cameras), min(rivals, key=implausible), True, rows, rows)


def _find_other_convention(cameras: Sequence[BoxesAsStated], *, alone: bool) -> OtherFormat | None:
    """Find the convention, in the same unit, that fits the boxes of these cameras together better than the stated one.

    None if no convention does. `alone`: whether there is only one camera, for which stricter limits hold.
    """
    stated = cameras[0].stated
    seen = {camera.name: camera.borders(stated) for camera in cameras}
    now = _Borders.joined(list(seen.values()))
    named = tuple(name for name, own in seen.items() if own.beyond.any())
    rivals = [one for one in FORMATS if one.normalised == stated.normalised and one != stated]
    for rival in sorted(rivals, key=lambda one: one.convention != "corners"):
        then = _Borders.joined([camera.borders(rival) for camera in cameras])
        if then.positive < then.rows:
            continue
        if rival.convention == "corners":
            many = now.rows >= FEWEST_ROWS and now.beyond.sum() >= max(FEWEST, MISREAD_SHARE * now.rows)
            if many and then.beyond.sum() <= MOST_ELSEWHERE * now.beyond.sum():
                every = tuple(camera.name for camera in cameras)
                return OtherFormat(every, rival, True, int(now.beyond.sum()), now.rows)
            continue
        fewer = then.outside <= MOST_FARTHER * now.beyond if alone else then.beyond <= MOST_ELSEWHERE * now.beyond
        if (now.beyond >= (ALONE if alone else FEWEST)).all() and fewer.all():
            return OtherFormat(named, rival, False, int(now.beyond.sum()), now.rows)
    return None


def _merge_formats(found: Sequence[OtherFormat]) -> list[OtherFormat]:
    """Merge entries with the same format and certainty into one."""
    out: dict[tuple[BoxFormat, bool], OtherFormat] = {}
    for one in found:
        key = (one.box_format, one.certain)
        other = out.get(key)
        out[key] = one if other is None else OtherFormat(
            (*other.cameras, *one.cameras), *key, other.beyond + one.beyond, other.rows + one.rows
        )  # fmt: skip
    return list(out.values())


def rotation_of_sideways(lens: Lens, seen: CameraObservations, person_height_m: float) -> int:
    """Find the rotation, 90 or 270 degrees clockwise, that puts an image with people on their side upright; 0 if it needs none.

    Keypoints alone need no upright image: they calibrate a camera on its side as any other.

    Args:
        lens: lens of the image as it is.
        seen: boxes and keypoints in it.
        person_height_m: expected standing height, metres.
    """
    whole = seen.boxes.take(seen.boxes.inside(lens.size))
    if len(whole) < MIN_BODIES or float(np.median(whole.ltwh[:, 2] / whole.ltwh[:, 3])) <= WIDER:
        return 0
    shares = heads_by_rotation(seen.keypoints)
    if shares is not None:
        return next((turn for turn in (90, 270) if shares[turn] > HEADS_ELSEWHERE), 0)
    return _find_better_rotation(lens, whole, person_height_m, (90, 270))


def is_upside_down(lens: Lens, seen: CameraObservations, person_height_m: float) -> bool:
    """Return whether people are upside down in an image; False also if this is unknown.

    The arguments are those of `rotation_of_sideways`.
    """
    shares = heads_by_rotation(seen.keypoints)
    if shares is not None:
        return shares[180] > HEADS_ELSEWHERE
    return _find_better_rotation(lens, seen.boxes, person_height_m, (180,)) == 180


def _find_better_rotation(lens: Lens, boxes: Boxes, person_height_m: float, turns: tuple[int, ...]) -> int:
    """Find the rotation, among `turns`, after which people fit one ground far better than before; 0 if there is none."""
    stated = level_of_rotation(lens, boxes, person_height_m, 0)
    if stated is None or stated.residual < LEAST_MISFIT:
        return 0
    levels = {turn: level_of_rotation(lens, boxes, person_height_m, turn) for turn in turns}
    misfit = {turn: level.residual_90 for turn, level in levels.items() if level is not None}
    best = min(misfit, key=lambda turn: misfit[turn], default=0)
    return best if best and misfit[best] < min(FITS_WELL, stated.residual_90 / FITS_BETTER) else 0


def heads_by_rotation(keypoints: Keypoints) -> dict[int, float] | None:
    """Compute, for each rotation, the share of bodies with the head above the feet; None if fewer than 50 show both."""
    bare = [name.removeprefix("left_").removeprefix("right_") for name in keypoints.joints]
    ends = []
    for wanted in (HEAD, FEET):
        columns = np.array([name in wanted for name in bare])
        found = (keypoints.score[:, columns] > MIN_JOINT_SCORE)[..., None]
        with np.errstate(invalid="ignore", divide="ignore"):
            ends.append(np.where(found, keypoints.xy[:, columns], 0.0).sum(axis=1) / found.sum(axis=1))
    upwards = ends[0] - ends[1]
    upwards = upwards[np.isfinite(upwards).all(axis=1)]
    if len(upwards) < MIN_BODIES:
        return None
    along = {turn: upwards @ np.array(heads) for turn, heads in TURNS.items()}
    return {turn: float(np.mean(most >= np.linalg.norm(upwards, axis=1) * np.sqrt(0.5))) for turn, most in along.items()}


def level_of_rotation(lens: Lens, boxes: Boxes, person_height_m: float, turn: int) -> Level | None:
    """Fit the level ground to the people, with the image turned clockwise.

    None if fewer than 50 boxes can be used, or if no ground fits.

    Args:
        lens: lens of the image as it is.
        boxes: boxes in the image as it is.
        person_height_m: expected standing height, metres.
        turn: degrees clockwise: 0, 90, 180 or 270.
    """
    heads = np.array(TURNS[turn], dtype=np.float64)
    ltwh = boxes.ltwh[boxes.inside(lens.size)]
    extent = ltwh[:, 2:] @ np.abs(heads)
    ltwh, extent = ltwh[extent >= MIN_EXTENT_PX], extent[extent >= MIN_EXTENT_PX]
    middle = ltwh[:, :2] + ltwh[:, 2:] / 2
    top, bottom = (middle + sign * extent[:, None] / 2 * heads for sign in (1, -1))
    across = np.array([[-heads[1], heads[0]], [-heads[0], -heads[1]]])
    R = np.eye(3)
    R[:2, :2] = across
    rays = lens.bearings(top), lens.bearings(bottom)
    known = np.isfinite(np.concatenate(rays, axis=1)).all(axis=1)
    if known.sum() < MIN_BODIES:
        return None
    # The rotation applies to the pixels and to the camera's axes.
    tangent = np.einsum("ab,nbi,ji->naj", across, lens.tangents(rays[0][known]), R)
    return level_camera(
        rays[0][known] @ R.T, rays[1][known] @ R.T, tangent, extent[known],
        np.full(known.sum(), person_height_m), np.zeros(known.sum()), np.random.default_rng(0),
    )  # fmt: skip


def notice_of_coarse_boxes(name: str, boxes: Boxes) -> Finding | None:
    """Return a notice if a camera's boxes lie on a coarse grid; None if they do not, or if there are too few.

    Args:
        name: name of the camera.
        boxes: all of its boxes.
    """
    step = grid_step(boxes)
    if step is None:
        return None
    height = float(np.median(boxes.ltwh[:, 3]))
    return notice("boxes_coarse", name, step_px=step, height_px=height) if step > COARSE * height else None


def adjust_for_coarse_boxes(figures: AdjustedFigures, findings: Iterable[Finding]) -> AdjustedFigures:
    """Increase the sigma of the scale by the error of coarse boxes, as far as the scale depends on people's heights.

    Args:
        figures: figures of the adjustment.
        findings: findings about its input.
    """
    steps = [one.values["step_px"] / one.values["height_px"] for one in findings if one.code == "boxes_coarse"]
    sigma = figures.scale.relative_sigma
    if not steps or sigma is None:
        return figures
    share = sum(cue.share for cue in figures.scale.cues if cue.kind in ("population", "person"))
    return replace(figures, scale=replace(figures.scale, relative_sigma=float(np.hypot(sigma, share * max(steps)))))


def grid_step(boxes: Boxes) -> int | None:
    """Find the largest integer above 1, pixels, such that nearly all edges are multiples of it; None if there is none."""
    if len(boxes) < FEWEST_FOR_GRID:
        return None
    boxes = boxes.take(np.linspace(0, len(boxes) - 1, min(len(boxes), MOST_FOR_GRID)).astype(np.int64))
    edges = np.concatenate([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]]).ravel()
    whole = np.rint(edges).astype(np.int64)
    if np.mean(np.abs(edges - whole) < 1e-6) < ON_GRID:
        return None
    most = int(np.median(boxes.ltwh[:, 3]))
    steps = (step for step in range(most, 1, -1) if np.mean(whole % step == 0) >= ON_GRID)
    return next(steps, None)
