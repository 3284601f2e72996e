"""The two ends of an upright person in a picture, from boxes and from joints, and how fast they move through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Columns, Floats, Ints
from passerby.core.cameras import Camera, Lens
from passerby.core.observations import MIN_JOINT_SCORE, Boxes, CameraObservations, Keypoints

MIN_EXTENT_PX = 8.0
BODY_ASPECT = 0.36
"""Width over height of an upright person's box: in the median 0.34 on simulated terraces and 0.38 on basketball courts."""

BODY_HEIGHTS = {
    "head_top": 1.0, "head": 0.95, "nose": 0.93, "eye": 0.94, "ear": 0.93, "neck": 0.84, "shoulder": 0.82, "hip": 0.53,
    "knee": 0.28, "ankle": 0.045, "heel": 0.02, "big_toe": 0.01, "small_toe": 0.01,
}  # fmt: skip
"""Where joints of a standing body are, as a share of its height (after Drillis and Contini 1966). `head` is the top of the head
in some tools' layouts (Halpe, MPII) and the joint above the neck in others (SMPL): the mean of both."""

STEEP = 0.5
"""Share of the vertical that lies in the image plane: half of it for a camera tilted by 60 degrees."""

HEAD, SHOULDERS, FEET = (
    ("head_top", "head", "nose", "eye", "ear"),
    ("neck", "shoulder"),
    ("ankle", "heel", "big_toe", "small_toe"),
)

# Joint names count as right when, in the median person, they order the joints from head to feet at least this well.
MIN_ORDER_CORRELATION = 0.9

# Where the names are wrong the highest and lowest joints found stand in: about the eyes or crown, and the toes.
EXTREME_FRACTIONS = (0.96, 0.02)

HALF_WINDOW_S = 0.4
"""Velocities are taken over twice this. Over less, noise of 2 % of the extent would grow to a tenth of a walker's velocity and
bend the offsets toward 0; over more, a gait and a turn would be lost."""
MAX_HALF_WINDOW_S = 1.0
"""Sparser samples do not show how fast a person moves in between."""
MAX_STRAY = 0.3
"""Who is farther from the line between the two neighbours than this share of the extent is another person, or turned: the
neighbours then say nothing of the velocity. Half of 3 m/s^2 times 0.4 s squared is 0.14 of a person's height."""

MIN_MOVE = 0.1
"""Who moves by less than this share of the extent between the neighbours counts as standing still: five times what
noise of 2 % in the edges alone would do. Velocities of noise would pretend that the clocks are known to be right."""


@dataclass(frozen=True, eq=False)
class Segments(Columns):
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


def segments_of_boxes(boxes: Boxes, lens: Lens, *, unknown: bool = False, lean: float = 0.0) -> Segments:
    """Boxes not cut by the border, as segments from top to bottom.

    Args:
        boxes: upright rectangles, whatever way the people in them lean.
        lens: of the camera.
        unknown: whether those without an identity are wanted.
        lean: how people lean in the image, see `ends_of_boxes`.
    """
    whole = boxes.inside(lens.size) & (boxes.ltwh[:, 3] >= MIN_EXTENT_PX) & ((boxes.identity >= 0) | unknown)
    n, (top, bottom) = int(whole.sum()), ends_of_boxes(boxes.ltwh[whole], lean)
    return Segments(
        boxes.frame[whole], boxes.identity[whole], top, bottom, np.ones(n), np.zeros(n), np.ones(n), np.flatnonzero(whole)
    )


def ends_of_boxes(ltwh: Floats, lean: float = 0.0) -> tuple[Floats, Floats]:
    """(N, 2) highest and (N, 2) lowest points of the bodies in boxes, pixels.

    A body is taken to be an ellipse, `BODY_ASPECT` as wide as tall. Its long axis runs through the middle of the box; it joins
    the middles of the upper and the lower edge only where people do not lean in the image.

    Args:
        ltwh: (N, 4) left, top, width, height, pixels.
        lean: radians clockwise from the image's vertical: of a camera that is rolled about its viewing direction.
    """
    x, y, w, h = ltwh.T
    if lean == 0:
        return np.column_stack([x + w / 2, y]), np.column_stack([x + w / 2, y + h])
    c, s = np.cos(lean), np.sin(lean)
    half = (h / (2 * np.sqrt(c**2 + (BODY_ASPECT * s) ** 2)))[:, None] * np.array([s, -c])
    middle = np.column_stack([x + w / 2, y + h / 2])
    return middle + half, middle - half


def lean_in_image(camera: Camera) -> float:
    """How people lean in the middle of the image of a camera with a pose: radians clockwise from the image's vertical.

    0 for a camera that looks more down than ahead: people in its image lean in all directions.
    """
    assert camera.pose is not None
    right, down, _ = camera.pose.R_cw[:, 2]
    return float(np.arctan2(right, -down)) if np.hypot(right, down) > STEEP else 0.0


def nominal_heights(joints: tuple[str, ...]) -> Floats:
    """(J,) share of the body's height of each named joint; NaN for joints that move freely or are unknown."""
    out = np.full(len(joints), np.nan)
    for index, name in enumerate(joints):
        bare = name.removeprefix("left_").removeprefix("right_").removeprefix("mid_")
        out[index] = BODY_HEIGHTS.get(bare, np.nan)
    return out


def order_correlations(keypoints: Keypoints, names: tuple[str, ...]) -> list[float]:
    """How well names order people's joints from head to feet as the image does: correlations of about 100 people.

    Args:
        keypoints: joints of one camera.
        names: (J,) what the joints are taken to be called.
    """
    nominal = nominal_heights(names)
    found = []
    for row in range(0, len(keypoints), max(1, len(keypoints) // 100)):
        use = (keypoints.score[row] > MIN_JOINT_SCORE) & np.isfinite(nominal)
        if np.count_nonzero(use) >= 6 and np.ptp(nominal[use]) > 0.5:
            found.append(float(np.corrcoef(nominal[use], -keypoints.xy[row, use, 1])[0, 1]))
    return found


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
    return segments.take(new)


def upright_segments(seen: CameraObservations, lens: Lens, lean: float = 0.0) -> Segments:
    """People with or without identity whose top and bottom are in the picture: by boxes first, then by joints where those lack.

    Args:
        seen: boxes and joints.
        lens: the camera's lens.
        lean: how people lean in their boxes, see `segments_of_boxes`; joints show it themselves.
    """
    boxes = segments_of_boxes(seen.boxes, lens, unknown=True, lean=lean)
    joints = segments_without(segments_of_keypoints(seen.keypoints, named=True, unknown=True), boxes)
    return Segments.joined([boxes, joints])


def image_velocity(frame: Ints, identity: Ints, points: Floats, extent: Floats, fps: float) -> Floats:
    """(N, 2) velocities in one camera's picture, pixels a second, by differences between samples before and after.

    The sample itself does not enter, so that its noise is not in its velocity.

    Args:
        frame: (N,) instants.
        identity: (N,) who, at most once a frame.
        points: (N, 2) pixels.
        extent: (N,) the person's size in the picture, pixels.
        fps: instants a second.

    Returns:
        Velocities; 0 where there is no sample on one of the two sides, none of the same motion, or almost no motion.
    """
    out = np.zeros((len(frame), 2))
    window = max(1, int(HALF_WINDOW_S * fps + 1e-9))
    if len(frame) == 0 or window > MAX_HALF_WINDOW_S * fps:
        return out
    span = int(np.ptp(frame)) + window + 1
    key = np.unique(identity, return_inverse=True)[1].ravel() * span + (frame - frame.min())
    order = np.argsort(key, kind="stable")
    ranked = key[order]
    before = order[np.searchsorted(ranked, key - window, side="left")]
    after = order[np.searchsorted(ranked, key + window, side="right") - 1]
    both = np.flatnonzero((frame[before] < frame) & (frame < frame[after]))
    before, after = before[both], after[both]
    seconds = (frame[after] - frame[before]) / fps
    velocity = (points[after] - points[before]) / seconds[:, None]
    middle = points[before] + velocity * ((frame[both] - frame[before]) / fps)[:, None]
    alike = np.linalg.norm(points[both] - middle, axis=1) <= MAX_STRAY * extent[both]
    moves = np.linalg.norm(points[after] - points[before], axis=1) >= MIN_MOVE * extent[both]
    out[both[alike & moves]] = velocity[alike & moves]
    return out
