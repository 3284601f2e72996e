"""From observations with identities to what a solver weighs: sightings of upright people, and sightings of joints.

A *person-instant* is one identity at one frame. It counts when two cameras or more saw it; a box whose edge lies at the
picture's border is cut off there and says nothing about the body's extent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Lens, Rig
from passerby.errors import InputError
from passerby.observations import Boxes, Keypoints, Observations
from passerby.solver.bundle import PointObservations
from passerby.solver.image_motion import image_velocity
from passerby.solver.people_state import Sightings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BORDER_PX = 2.0
MIN_EXTENT_PX = 8.0
MIN_JOINT_SCORE = 0.3
MIN_JOINTS = 4
# How much farther off a joint is taken to be that was found with less confidence than usual: this power of the ratio, within a
# range. Residuals grow with the first power only. The power was chosen by the true position errors of just two sets, so it
# may not carry over: for powers 1, 2 and 3, Shelf 31.8, 31.3 and 31.1 mm, Pose2Sim (one person) 34.2, 31.2 and 28.7 mm.
DOUBT_POWER, DOUBT_RANGE = 3, (0.5, 10.0)

BODY_HEIGHTS = {
    "head_top": 1.0, "nose": 0.93, "eye": 0.94, "ear": 0.93, "neck": 0.84, "shoulder": 0.82, "hip": 0.53,
    "knee": 0.28, "ankle": 0.045, "heel": 0.02, "big_toe": 0.01, "small_toe": 0.01,
}  # fmt: skip
"""Where joints of a standing body are, as a share of its height (after Drillis and Contini 1966)."""

HEAD, SHOULDERS, FEET = ("head_top", "nose", "eye", "ear"), ("neck", "shoulder"), ("ankle", "heel", "big_toe", "small_toe")

# Joint names count as right when, in the median person, they order the joints from head to feet at least this well.
MIN_ORDER_CORRELATION = 0.9
# Where the names are wrong the highest and lowest joints found stand in: about the eyes or crown, and the toes.
EXTREME_FRACTIONS = (0.96, 0.02)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What M sightings of people and K sightings of joints say, over N person-instants and J joints."""

    sightings: Sightings
    person: Ints
    """(N,) index into `identities`."""
    frame: Ints
    """(N,) instants."""
    identities: Ints
    """(P,) identity of each person."""
    joints: PointObservations
    """K sightings; `sigma_px` holds the person's extent in the picture, larger for a doubtful joint."""
    joint_kind: Ints
    """(J,) which joint of the body each is, by its number in the files."""
    n_cameras: int
    notes: tuple[str, ...] = ()
    """What was odd about the input, one sentence each."""

    @property
    def n_people(self) -> int:
        """Number of persons."""
        return len(self.identities)

    @property
    def n_joints(self) -> int:
        """Number of 3D joints."""
        return len(self.joint_kind)


@dataclass(frozen=True, eq=False)
class Segments:
    """Highest and lowest points of people in one camera's picture, pixels."""

    frame: Ints
    identity: Ints
    top: Floats
    bottom: Floats
    top_fraction: Floats
    bottom_fraction: Floats
    has_foot: Floats
    row: Ints
    """Which box, or which set of joints, each is."""

    def velocity(self, fps: float) -> Floats:
        """(M, 2) how fast the middles move through the picture, pixels a second."""
        extent = np.linalg.norm(self.bottom - self.top, axis=1)
        return image_velocity(self.frame, self.identity, 0.5 * (self.top + self.bottom), extent, fps)


def gather_evidence(
    rig: Rig, observations: Observations, rng: np.random.Generator, *, max_sightings: int = 30_000, max_joints: int = 24_000,
    moving: bool = False,
) -> Evidence:  # fmt: skip
    """Collect the evidence of all cameras.

    Args:
        rig: lenses; poses are not read.
        observations: boxes and keypoints with identities.
        rng: draws the person-instants that are kept where there are more than the limits allow.
        max_sightings: most sightings of people; keeps time and memory flat in the length of a recording.
        max_joints: the same for sightings of joints.
        moving: whether to find out how fast everything moves, which errors of the clocks show by.

    Raises:
        InputError: `moving`, and the observations' frame rate is not known.
    """
    if moving and not observations.fps:
        raise InputError("clocks cannot be refined without a frame rate: give the instants' fps")
    fps = observations.fps if moving else None
    named, note = _names_hold(rig, observations)
    tables: list[tuple[int, Segments]] = []
    velocity = []
    for index, camera in enumerate(rig):
        seen = observations[camera.name]
        boxes = segments_of_boxes(seen.boxes, camera.lens)
        keypoints = segments_without(segments_of_keypoints(seen.keypoints, named), boxes)
        tables += [(index, boxes), (index, keypoints)]
        velocity += [segments.velocity(fps) for segments in (boxes, keypoints)] if fps else []
    camera_of = np.concatenate([np.full(len(s.frame), c, dtype=np.int64) for c, s in tables])
    frame, identity = (np.concatenate([getattr(s, name) for _, s in tables]) for name in ("frame", "identity"))
    keep, block, key = _shared_instants(camera_of, frame, identity, rng, max_sightings)
    identities, person = np.unique(key[:, 0], return_inverse=True)
    sightings = _sightings(rig, tables, camera_of, keep, block, np.concatenate(velocity)[keep] if fps else None)
    joints, kind = _joints(rig, observations, rng, max_joints, fps)
    return Evidence(sightings, person, key[:, 1], identities, joints, kind, len(rig), note)


def segments_of_boxes(boxes: Boxes, lens: Lens, *, unknown: bool = False) -> Segments:
    """Boxes not cut by the border, as segments from top to bottom at the middle of their width.

    Those without an identity are left out unless `unknown` are wanted.
    """
    x, y, w, h = boxes.ltwh.T
    whole = (
        (x > BORDER_PX) & (y > BORDER_PX) & (x + w < lens.size[0] - BORDER_PX) & (y + h < lens.size[1] - BORDER_PX)
        & (h >= MIN_EXTENT_PX) & ((boxes.identity >= 0) | unknown)
    )  # fmt: skip
    x, y, w, h = x[whole], y[whole], w[whole], h[whole]
    n = len(x)
    return Segments(
        boxes.frame[whole], boxes.identity[whole], np.column_stack([x + w / 2, y]), np.column_stack([x + w / 2, y + h]),
        np.ones(n), np.zeros(n), np.ones(n), np.flatnonzero(whole),
    )  # fmt: skip


def nominal_heights(joints: tuple[str, ...]) -> Floats:
    """(J,) share of the body's height of each named joint; NaN for joints that move freely or are unknown."""
    out = np.full(len(joints), np.nan)
    for index, name in enumerate(joints):
        bare = name.removeprefix("left_").removeprefix("right_").removeprefix("mid_")
        out[index] = BODY_HEIGHTS.get(bare, np.nan)
    return out


def _names_hold(rig: Rig, observations: Observations) -> tuple[bool, tuple[str, ...]]:
    """Whether the joints' names order them from head to feet as the pictures do.

    Some tools write one joint layout under the names of another; a head that is a hip would ruin vertical and scale.
    """
    correlations = []
    for camera in rig:
        keypoints = observations[camera.name].keypoints
        nominal = nominal_heights(keypoints.joints)
        for row in range(0, len(keypoints), max(1, len(keypoints) // 100)):
            use = (keypoints.score[row] > MIN_JOINT_SCORE) & np.isfinite(nominal)
            if np.count_nonzero(use) >= 6 and np.ptp(nominal[use]) > 0.5:
                correlations.append(np.corrcoef(nominal[use], -keypoints.xy[row, use, 1])[0, 1])
    if not correlations:
        return True, ()
    order = float(np.median(correlations))
    if order >= MIN_ORDER_CORRELATION:
        return True, ()
    return False, (
        f"the joints' names do not fit the pictures (they order them from head to feet with a correlation of {order:.2f}): "
        "is it another layout than the file says? Joints are matched by their number, head and feet by position",
    )


def segments_of_keypoints(keypoints: Keypoints, named: bool, *, unknown: bool = False) -> Segments:
    """People with head and feet found, as segments between them; those without an identity only if `unknown` are wanted."""
    score, xy = keypoints.score, keypoints.xy
    found = score > MIN_JOINT_SCORE
    nominal = nominal_heights(keypoints.joints)
    if named:
        head = found & _is_any(keypoints.joints, HEAD)
        head |= found & _is_any(keypoints.joints, SHOULDERS) & (head.sum(axis=1) == 0)[:, None]
        feet = found & _is_any(keypoints.joints, FEET)
        use = head.any(axis=1) & feet.any(axis=1)
        top, top_fraction = _mean_joint(xy, head, nominal)
        bottom, bottom_fraction = _mean_joint(xy, feet, nominal)
    else:
        use = found.sum(axis=1) >= 10
        rows = np.arange(len(xy))
        y = xy[:, :, 1]
        top = xy[rows, np.where(found, y, np.inf).argmin(axis=1)]
        bottom = xy[rows, np.where(found, y, -np.inf).argmax(axis=1)]
        top_fraction, bottom_fraction = (np.full(len(xy), value) for value in EXTREME_FRACTIONS)
    use &= ((keypoints.identity >= 0) | unknown) & (bottom[:, 1] - top[:, 1] >= MIN_EXTENT_PX)
    return Segments(
        keypoints.frame[use], keypoints.identity[use], top[use], bottom[use], top_fraction[use], bottom_fraction[use],
        np.zeros(np.count_nonzero(use)), np.flatnonzero(use),
    )  # fmt: skip


def _is_any(joints: tuple[str, ...], names: tuple[str, ...]) -> NDArray[np.bool_]:
    return np.array([joint.removeprefix("left_").removeprefix("right_") in names for joint in joints])


def _mean_joint(xy: Floats, use: NDArray[np.bool_], nominal: Floats) -> tuple[Floats, Floats]:
    """Mean position (N, 2) and mean nominal height (N,) of the joints in use."""
    count = np.maximum(use.sum(axis=1), 1)
    mean = (xy * use[:, :, None]).sum(axis=1) / count[:, None]
    return mean, np.where(use, np.nan_to_num(nominal), 0.0).sum(axis=1) / count


def segments_without(segments: Segments, other: Segments) -> Segments:
    """The segments of people that `other` does not hold."""
    pairs = np.column_stack([segments.frame, segments.identity])
    both = np.concatenate([np.column_stack([other.frame, other.identity]), pairs])
    _, number = np.unique(both, axis=0, return_inverse=True)
    number = number.ravel()
    new = ~np.isin(number[len(other.frame) :], number[: len(other.frame)])
    return Segments(**{name: getattr(segments, name)[new] for name in segments.__dataclass_fields__})


def _shared_instants(
    camera: Ints, frame: Ints, identity: Ints, rng: np.random.Generator, limit: int
) -> tuple[Ints, Ints, Ints]:
    """Rows of person-instants that two cameras saw, their block number, and (identity, frame) of each block.

    Above the limit whole person-instants are drawn at random.
    """
    if len(frame) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
    base = frame.min()
    span = int(frame.max() - base) + 1
    key, number, count = np.unique(identity * span + (frame - base), return_inverse=True, return_counts=True)
    shared = count >= 2
    if count[shared].sum() > limit:
        order = rng.permutation(np.flatnonzero(shared))
        shared = np.zeros(len(key), dtype=bool)
        shared[order[: np.searchsorted(np.cumsum(count[order]), limit)]] = True
    rows = np.flatnonzero(shared[number])
    rows = rows[np.argsort(camera[rows], kind="stable")]
    renumbered = np.cumsum(shared) - 1
    kept = key[shared]
    return rows, renumbered[number[rows]], np.column_stack([kept // span, kept % span + base])


def _sightings(
    rig: Rig, tables: list[tuple[int, Segments]], camera_of: Ints, keep: Ints, block: Ints, velocity: Floats | None
) -> Sightings:
    """Rays and tangents of the kept rows; a row whose ray cannot be found is dropped."""

    def column(name: str) -> Floats:
        return np.concatenate([np.asarray(getattr(s, name), dtype=np.float64) for _, s in tables])[keep]

    camera = camera_of[keep]
    top, bottom = column("top").reshape(-1, 2), column("bottom").reshape(-1, 2)
    top_ray, bottom_ray = np.zeros((len(keep), 3)), np.zeros((len(keep), 3))
    top_tangent, bottom_tangent = np.zeros((len(keep), 2, 3)), np.zeros((len(keep), 2, 3))
    for index, item in enumerate(rig):
        rows = camera == index
        top_ray[rows], bottom_ray[rows] = item.lens.bearings(top[rows]), item.lens.bearings(bottom[rows])
        top_tangent[rows], bottom_tangent[rows] = item.lens.tangents(top_ray[rows]), item.lens.tangents(bottom_ray[rows])
    sightings = Sightings(
        camera, block, top_ray, bottom_ray, top_tangent, bottom_tangent, np.linalg.norm(bottom - top, axis=1),
        column("top_fraction"), column("bottom_fraction"), column("has_foot"), velocity,
    )  # fmt: skip
    return sightings.take(np.isfinite(np.concatenate([top_ray, bottom_ray], axis=1)).all(axis=1))


def _joints(
    rig: Rig, observations: Observations, rng: np.random.Generator, limit: int, fps: float | None
) -> tuple[PointObservations, Ints]:
    """Every joint that two cameras saw, as a point of its own."""
    columns: list[tuple[Ints, ...]] = []
    xy, size_px, velocity = [], [], []
    for index, camera in enumerate(rig):
        keypoints = observations[camera.name].keypoints
        found = (keypoints.score > MIN_JOINT_SCORE) & (keypoints.identity >= 0)[:, None]
        found &= (found.sum(axis=1) >= MIN_JOINTS)[:, None]
        row, joint = np.nonzero(found)
        columns.append((np.full(len(row), index), keypoints.frame[row], keypoints.identity[row], joint))
        xy.append(keypoints.xy[row, joint])
        y = keypoints.xy[:, :, 1]
        height = np.where(found, y, -np.inf).max(axis=1, initial=-np.inf) - np.where(found, y, np.inf).min(
            axis=1, initial=np.inf
        )
        usual = float(np.median(keypoints.score[found])) if len(row) else 1.0
        doubt = np.clip((usual / keypoints.score[row, joint]) ** DOUBT_POWER, *DOUBT_RANGE)
        size = np.maximum(height[row], MIN_EXTENT_PX)
        size_px.append(size * doubt)
        if fps:
            whose = keypoints.identity[row] * len(keypoints.joints) + joint
            velocity.append(image_velocity(keypoints.frame[row], whose, xy[-1], size, fps))
    camera_of, frame, identity, joint = (np.concatenate(parts).astype(np.int64) for parts in zip(*columns, strict=True))
    if len(frame) == 0:
        still = np.zeros((0, 2)) if fps else None
        empty = PointObservations(camera_of[:0], camera_of[:0], np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros(0), still)
        return empty, np.zeros(0, np.int64)
    n_joints = int(joint.max()) + 1
    rows, point, key = _shared_instants(camera_of, frame, identity * n_joints + joint, rng, limit)
    pixels, size = np.concatenate(xy)[rows], np.concatenate(size_px)[rows]
    camera_of = camera_of[rows]
    bearing, tangent = np.zeros((len(rows), 3)), np.zeros((len(rows), 2, 3))
    for index, item in enumerate(rig):
        own = camera_of == index
        bearing[own] = item.lens.bearings(pixels[own])
        tangent[own] = item.lens.tangents(bearing[own])
    good = np.flatnonzero(np.isfinite(bearing).all(axis=1))
    motion = np.concatenate(velocity)[rows] if fps else None
    sightings = PointObservations(camera_of, point, bearing, tangent, size, motion)
    return sightings.take(good), key[:, 0] % n_joints
