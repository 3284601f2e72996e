"""Vertical, ground and metric scale of a reconstruction from people's bodies.

The highest and the lowest point of a person at one instant, both triangulated, are a *segment*. Most people stand or walk, so
most segments are vertical and as long as the person is tall. Robust statistics ignore the minority who crouch, bend, sit or
jump.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Columns, Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import MIN_JOINT_SCORE, Observations
from passerby.findings.finding import Finding, doubt, refusal
from passerby.findings.ranking import RefusalError
from passerby.geometry.groups import cauchy_weights, group_sums, least_of_groups, residual_scale
from passerby.geometry.rotations import Similarity, direction_angle, rotation_between
from passerby.geometry.triangulation import angular_residuals, depths, move_to_camera_frames, triangulate
from passerby.people.segments import EXTREME_FRACTIONS, HEAD, MIN_ORDER_CORRELATION, SHOULDERS, nominal_heights
from passerby.solver.geopose.correspondences import BOTTOM, TOP, ImagePoints, box_points, joint_points

# Largest residual of a segment's ends in all their rays, in sigmas: larger ones are of swapped or half hidden people.
MAX_RESIDUAL_SIGMAS = 4.0
# Largest angle from the common vertical at which people count as upright; others do not show the standing height.
MAX_LEAN = np.deg2rad(15.0)
# Sigma of the mean direction from feet to heads: errors of 0.7 to 2 degrees in simulated scenes, 1.1 to 2.7 in real ones.
DIRECTION_SIGMA = np.deg2rad(2.0)
# Number of successive instants that count as one independent footprint, since they repeat one another.
INSTANTS_PER_STEP = 10
# Width of the kernel on a person's lengths, relative: box noise of 2 to 3 % in two views.
KERNEL = 0.02
# Adults differ less than this from the median; a person who differs more was confused with another or never stood.
MAX_HEIGHT_DEVIATION = 0.15
# Smallest number of measurements of a person for a meaningful most frequent length.
MIN_SEGMENTS = 8
# Joints within this share of the body's height above the lowest one count as feet, where joint names cannot be trusted.
FEET_BAND = 0.05


@dataclass(frozen=True, eq=False)
class BodyEndpoints:
    """Sightings of the upper and the lower ends of people."""

    points: ImagePoints
    is_top: NDArray[np.bool_]
    """(P,) whether a part belongs to the upper end; indexed by the part's number (negative parts count from the end)."""
    is_bottom: NDArray[np.bool_]
    """(P,) the same for the lower end."""
    shares: tuple[float, float]
    """Heights of the upper and the lower end of a standing body, as shares of its height."""
    finding: Finding | None = None
    """Finding about an error in the input; None without one."""

    @property
    def span(self) -> float:
        """Share of the standing height between the ends."""
        return self.shares[0] - self.shares[1]

    def role(self) -> Ints:
        """Return the end (M,) of each sighting: TOP, BOTTOM, or 0 for neither."""
        part = self.points.part % len(self.is_top)
        return np.where(self.is_top[part], TOP, np.where(self.is_bottom[part], BOTTOM, 0))

    def shared(self, camera_a: int, camera_b: int) -> int:
        """Count the person-instants of which both cameras see both ends, with a common part of each end."""
        keep = np.flatnonzero(np.isin(self.points.camera, (camera_a, camera_b)) & (self.role() != 0))
        points, role = self.points.take(keep), self.role()[keep]
        in_both = np.unique(points.labels()[0], return_counts=True)[1] == 2
        key = points.labels()[1][in_both]
        end = np.where(np.isin(key[:, 2], points.part[role == TOP]), TOP, BOTTOM)
        ends = np.unique(np.column_stack([key[:, :2], end]), axis=0)
        return int((np.unique(ends[:, :2], axis=0, return_counts=True)[1] == 2).sum())


@dataclass(frozen=True, eq=False)
class BodySegments3D(Columns):
    """K person-instants with both ends triangulated."""

    identity: Ints
    """(K,) person of each segment."""
    top: Floats
    """(K, 3) upper ends."""
    bottom: Floats
    """(K, 3) lower ends."""

    def __len__(self) -> int:
        return len(self.identity)

    def scaled(self, factor: float) -> BodySegments3D:
        """Return the segments with all lengths multiplied by `factor`."""
        return BodySegments3D(self.identity, self.top * factor, self.bottom * factor)


def box_extents(rig: Rig, observations: Observations) -> BodyEndpoints:
    """Return the top and bottom edges of boxes as the ends of people."""
    part = np.arange(3)
    return BodyEndpoints(box_points(rig, observations, (TOP, BOTTOM)), part == TOP + 3, part == BOTTOM + 3, (1.0, 0.0))


def joint_extents(rig: Rig, observations: Observations) -> BodyEndpoints:
    """Return head (or shoulders, where heads are not seen) and feet as the ends of people.

    The names of the joints are tested first: some files have one layout under the names of another. Where the names contradict
    the vertical order in the images, the joint with the highest and those with the lowest median height are used instead.
    """
    points = joint_points(rig, observations)
    names = next((observations[c.name].keypoints.joints for c in rig if c.name in observations.cameras), ())
    height = _relative_heights(rig, observations, len(names))
    nominal = nominal_heights(names)
    known = np.isfinite(height) & np.isfinite(nominal)
    bare = [name.removeprefix("left_").removeprefix("right_") for name in names]
    if np.count_nonzero(known) >= 4 and np.ptp(nominal[known]) > 0 and np.ptp(height[known]) > 0:
        order = float(np.corrcoef(nominal[known], height[known])[0, 1])
    else:
        order = 0.0
    if order >= MIN_ORDER_CORRELATION:
        seen = np.bincount(points.part, minlength=len(names))
        heads = np.array([name in HEAD for name in bare])
        shoulders = np.array([name in SHOULDERS for name in bare])
        ankles = np.array([name == "ankle" for name in bare])
        top = heads if seen[heads].max(initial=0) >= 0.5 * seen[shoulders].max(initial=0) else shoulders
        if top.any() and ankles.any():
            return BodyEndpoints(points, top, ankles, (float(np.mean(nominal[top])), float(np.mean(nominal[ankles]))))
    if not np.isfinite(height).any():
        return BodyEndpoints(points, np.zeros(len(names), bool), np.zeros(len(names), bool), (1.0, 0.0))
    top = np.arange(len(names)) == int(np.nanargmax(height))
    bottom = np.nan_to_num(height, nan=np.inf) <= np.nanmin(height) + FEET_BAND
    return BodyEndpoints(points, top, bottom, EXTREME_FRACTIONS, doubt("keypoint_names_unfit", correlation=order))


def triangulate_segments(
    rig: Rig,
    extents: BodyEndpoints,
    cameras: Ints,
    rotations: Floats,
    translations: Floats,
    min_parallax: float = np.deg2rad(2.0),
) -> BodySegments3D:
    """Triangulate the ends of all people that two or more of the posed cameras see.

    Args:
        rig: the lenses.
        extents: sightings of the ends.
        cameras: (C,) indices in the rig of the cameras that have a pose.
        rotations: (C, 3, 3) world to camera.
        translations: (C, 3) world to camera.
        min_parallax: ends whose rays all lie within this angle (radians) are left out.
    """
    local = np.full(len(rig), -1)
    local[cameras] = np.arange(len(cameras))
    points = extents.points.take(np.flatnonzero((local[extents.points.camera] >= 0) & (extents.role() != 0)))
    if len(points) == 0:
        return BodySegments3D(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    label, key = points.labels()
    camera = local[points.camera]
    focal = np.array([item.lens.focal for item in rig])[points.camera]
    ends = triangulate(camera, label, points.bearing, rotations, translations, len(key), weights=(focal / points.sigma_px) ** 2)
    seen = move_to_camera_frames(ends, camera, label, rotations, translations)
    with np.errstate(invalid="ignore"):
        fits = angular_residuals(seen, points.bearing) * focal <= MAX_RESIDUAL_SIGMAS * points.sigma_px
        fits &= depths(seen, points.bearing) > 0
    sound = np.bincount(label, ~fits, len(key)) == 0
    sound &= np.isfinite(ends).all(axis=1)
    directions = np.einsum("mji,mj->mi", np.asarray(rotations)[camera], points.bearing)
    sound &= _ray_spread(label, directions, len(key)) >= min_parallax
    is_top = extents.is_top[key[:, 2] % len(extents.is_top)]
    return _pair_ends(key, ends, sound & is_top, sound & ~is_top)


def vertical(segments: BodySegments3D) -> Floats:
    """Estimate the unit vector up (3,) from the direction from feet to heads, and from the plane of the feet.

    The robust mean direction of the segments is right within 1 to 3 degrees for all kinds of activity, but not better: boxes
    differ from bodies, and each camera has its own errors. The plane through the feet is right within 0.1 degrees where people
    spread over the ground. The plane is therefore fitted with the direction as its prior: in a small area the direction
    dominates, on a wide floor the feet.

    Raises:
        RefusalError: fewer than 8 segments.
    """
    if len(segments) < MIN_SEGMENTS:
        raise RefusalError(refusal("few_whole_people", seen=len(segments), needed=MIN_SEGMENTS))
    up = _mean_direction(segments)
    turn = rotation_between(up, np.array([0.0, 0.0, 1.0]))
    length = float(np.median(np.linalg.norm(segments.top - segments.bottom, axis=1)))
    feet = segments.bottom @ turn.T / length
    design = np.column_stack([feet[:, :2] - np.median(feet[:, :2], axis=0), np.ones(len(feet))])
    prior = np.diag([1.0, 1.0, 0.0]) / DIRECTION_SIGMA**2
    plane = np.array([0.0, 0.0, np.median(feet[:, 2])])
    for _ in range(20):
        miss = feet[:, 2] - design @ plane
        scale = residual_scale(miss, 0.02)
        weight = cauchy_weights((miss / (2 * scale)) ** 2) / (INSTANTS_PER_STEP * scale**2)
        plane = np.linalg.solve(design.T @ (weight[:, None] * design) + prior, design.T @ (weight * feet[:, 2]))
    normal = turn.T @ np.array([-plane[0], -plane[1], 1.0])
    return np.asarray(normal / np.linalg.norm(normal))


def standing_length(segments: BodySegments3D, up: Floats) -> float:
    """Estimate the length of a standing person in the unit of the reconstruction: the mean of each person's standing length.

    A mean or a median over all instants would be too short because of people who crouch: by 5 % in a simulated scene in which
    four tenths of the workers are bent. Standing and walking is the *longest* posture that a person holds for a long time; a
    stretched arm or a jump is longer, but each time different. Each person's standing length is therefore the longest peak of
    the density of lengths that is at least half as high as the highest peak. People far from the median of all are left out of
    the mean.

    Args:
        segments: segments from feet to heads.
        up: (3,) the vertical; segments that lean from it by more than 15 degrees are left out.

    Raises:
        RefusalError: fewer than 8 upright segments.
    """
    upright = segments.take(direction_angle(segments.top - segments.bottom, up) <= MAX_LEAN)
    if len(upright) < MIN_SEGMENTS:
        raise RefusalError(refusal("few_upright_people", seen=len(upright), needed=MIN_SEGMENTS))
    length = np.linalg.norm(upright.top - upright.bottom, axis=1)
    people = [length[upright.identity == identity] for identity in np.unique(upright.identity)]
    standing = np.array([longest_peak(lengths) for lengths in people if len(lengths) >= MIN_SEGMENTS])
    if len(standing) == 0:
        return longest_peak(length)
    middle = float(np.median(standing))
    return float(np.mean(standing[np.abs(standing - middle) <= MAX_HEIGHT_DEVIATION * middle]))


def longest_peak(lengths: Floats) -> float:
    """Return the longest of the high peaks of the density of `lengths` (N,), N at least 1, all above 0.

    The density has a Gaussian kernel of the width `KERNEL` on the logarithms. A high peak is at least half as high as the
    highest one.
    """
    logs = np.log(lengths)
    grid = np.arange(logs.min() - 2 * KERNEL, logs.max() + 2 * KERNEL, KERNEL / 10)
    density = np.exp(-0.5 * ((grid[:, None] - logs) / KERNEL) ** 2).sum(axis=1)
    peaks = np.flatnonzero((density[1:-1] >= density[:-2]) & (density[1:-1] > density[2:])) + 1
    high = peaks[density[peaks] >= 0.5 * density[peaks].max()]
    return float(np.exp(grid[high[-1]]))


def place_world(segments: BodySegments3D, up: Floats, reference: Floats, ends_above_ground: float = 0.0) -> Similarity:
    """Return the rigid motion to the world with z up, the ground at z = 0 (median of the feet), the reference above the origin.

    Args:
        segments: segments from feet to heads, metres.
        up: (3,) the vertical.
        reference: (3,) centre of the reference camera.
        ends_above_ground: height of the lower ends of standing people, metres: that of ankles, 0 for boxes.
    """
    rotation = rotation_between(up, np.array([0.0, 0.0, 1.0]))
    feet = segments.bottom @ rotation[2]
    at = rotation @ reference
    return Similarity(1.0, rotation, np.array([-at[0], -at[1], ends_above_ground - float(np.median(feet))]))


def _mean_direction(segments: BodySegments3D) -> Floats:
    """Return the geometric median (3,) of the unit vectors from feet to heads (Weiszfeld's iteration)."""
    direction = segments.top - segments.bottom
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    up = np.median(direction, axis=0)
    for _ in range(50):
        weight = 1.0 / np.maximum(np.linalg.norm(direction - up, axis=1), 1e-3)
        up = weight @ direction / weight.sum()
    return np.asarray(up / np.linalg.norm(up))


def _relative_heights(rig: Rig, observations: Observations, n_joints: int) -> Floats:
    """Return the median height (J,) of each joint in the skeletons: 1 highest, 0 lowest joint; NaN if never seen."""
    rows = [np.full((1, n_joints), np.nan)]
    for camera in rig:
        if camera.name not in observations.cameras or not len(observations[camera.name].keypoints):
            continue
        people = observations[camera.name].keypoints
        height = np.where(people.score >= MIN_JOINT_SCORE, -people.xy[:, :, 1], np.nan)
        height = height[np.isfinite(height).sum(axis=1) >= 6]
        low, high = _nan_extremes(height)
        rows.append((height - low) / np.maximum(high - low, 1e-9))
    stacked = np.concatenate(rows)
    return np.array([np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else np.nan for column in stacked.T])


def _nan_extremes(values: Floats) -> tuple[Floats, Floats]:
    low = np.where(np.isfinite(values), values, np.inf).min(axis=1, keepdims=True, initial=np.inf)
    high = np.where(np.isfinite(values), values, -np.inf).max(axis=1, keepdims=True, initial=-np.inf)
    return low, high


def _ray_spread(label: Ints, directions: Floats, count: int) -> Floats:
    """Return twice the angle (N,) of the ray farthest from the mean ray: for two rays, the angle between them."""
    angle = direction_angle(directions, group_sums(label, directions, count)[label])
    spread = np.zeros(count)
    np.maximum.at(spread, label, angle)
    return 2 * spread


def _pair_ends(key: Ints, ends: Floats, top: NDArray[np.bool_], bottom: NDArray[np.bool_]) -> BodySegments3D:
    """Join the mean upper end of each identity and frame with the lower end farthest from it: the foot that is stood on."""
    instant, number = np.unique(key[:, :2], axis=0, return_inverse=True)
    number = number.reshape(-1)
    upper = group_sums(number[top], ends[top], len(instant))
    count = np.bincount(number[top], minlength=len(instant))
    with np.errstate(invalid="ignore", divide="ignore"):
        upper /= count[:, None]
    lower = np.flatnonzero(bottom & (count[number] > 0))
    length = np.linalg.norm(ends[lower] - upper[number[lower]], axis=1)
    longest = lower[least_of_groups(number[lower], -length)]
    both = number[longest]
    return BodySegments3D(instant[both, 0], upper[both], ends[longest])
