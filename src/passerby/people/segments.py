"""The two ends of an upright person in a picture, from boxes and from joints, and their velocity in the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Columns, Floats, Ints
from passerby.core.cameras import Camera, Lens
from passerby.core.observations import MIN_JOINT_SCORE, Boxes, CameraObservations, Keypoints

MIN_EXTENT_PX = 8.0
BODY_ASPECT = 0.36
"""Width over height of an upright person's box: the median is 0.34 on simulated terraces and 0.38 on basketball courts."""

BODY_HEIGHTS = {
    "head_top": 1.0, "head": 0.95, "nose": 0.93, "eye": 0.94, "ear": 0.93, "neck": 0.84, "shoulder": 0.82, "hip": 0.53,
    "knee": 0.28, "ankle": 0.045, "heel": 0.02, "big_toe": 0.01, "small_toe": 0.01,
}  # fmt: skip
"""Heights of the joints of a standing body, as shares of its height (after Drillis and Contini 1966). `head` is the top of the
head in some tools' layouts (Halpe, MPII) and the joint above the neck in others (SMPL): the mean of both is used."""

STEEP = 0.5
"""Least share of the vertical that lies in the image plane. The share is a half for a camera tilted by 60 degrees."""

HEAD, SHOULDERS, FEET = (
    ("head_top", "head", "nose", "eye", "ear"),
    ("neck", "shoulder"),
    ("ankle", "heel", "big_toe", "small_toe"),
)

# Least median, over people, of the correlation between names and image heights with which joint names count as right.
MIN_ORDER_CORRELATION = 0.9

# Heights of the highest and the lowest joint found, used where the names are wrong: about the eyes or crown, and the toes.
EXTREME_FRACTIONS = (0.96, 0.02)

HALF_WINDOW_S = 0.4
"""Velocities are taken over twice this. Over less, noise of 2 % of the extent would grow to a tenth of a walker's velocity and
bias the time offsets toward 0; over more, gait and turns would be lost."""
MAX_HALF_WINDOW_S = 1.0
"""Largest half window, seconds. Sparser samples do not give the velocity of a person between them."""
MAX_STRAY = 0.3
"""Largest distance of a sample from the line between its two neighbours, as a share of the extent. Beyond it the sample is
another person, or the person turned, and the neighbours do not give the velocity. Half of 3 m/s^2 times 0.4 s squared is 0.14
of a person's height."""

MIN_MOVE = 0.1
"""Least move between the neighbours, as a share of the extent; below it the person counts as standing still. It is five times
the effect of noise of 2 % in the edges. Velocities that are only noise would suggest that the clocks are known to be right."""


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
    """(M,) row of the box, or of the set of joints."""

    def velocity(self, fps: float) -> Floats:
        """Return the velocities (M, 2) of the middles in the picture, pixels a second."""
        extent = np.linalg.norm(self.bottom - self.top, axis=1)
        return image_velocity(self.frame, self.identity, 0.5 * (self.top + self.bottom), extent, fps)


def segments_of_boxes(boxes: Boxes, lens: Lens, *, unknown: bool = False, lean: float = 0.0) -> Segments:
    """Convert the boxes that the border does not cut to segments from top to bottom.

    Args:
        boxes: upright rectangles, for any lean of the people in them.
        lens: lens of the camera.
        unknown: whether to include boxes without an identity.
        lean: lean of people in the image, see `ends_of_boxes`.
    """
    whole = boxes.inside(lens.size) & (boxes.ltwh[:, 3] >= MIN_EXTENT_PX) & ((boxes.identity >= 0) | unknown)
    n, (top, bottom) = int(whole.sum()), ends_of_boxes(boxes.ltwh[whole], lean)
    return Segments(
        boxes.frame[whole], boxes.identity[whole], top, bottom, np.ones(n), np.zeros(n), np.ones(n), np.flatnonzero(whole)
    )


def ends_of_boxes(ltwh: Floats, lean: float = 0.0) -> tuple[Floats, Floats]:
    """Compute the highest (N, 2) and the lowest points (N, 2) of the bodies in boxes, pixels.

    A body is taken to be an ellipse, `BODY_ASPECT` as wide as tall. Its long axis runs through the middle of the box. The axis
    ends at the middles of the upper and the lower edge only where people do not lean in the image.

    Args:
        ltwh: (N, 4) left, top, width, height, pixels.
        lean: radians clockwise from the image's vertical, for a camera that is rolled about its viewing direction.
    """
    x, y, w, h = ltwh.T
    if lean == 0:
        return np.column_stack([x + w / 2, y]), np.column_stack([x + w / 2, y + h])
    c, s = np.cos(lean), np.sin(lean)
    half = (h / (2 * np.sqrt(c**2 + (BODY_ASPECT * s) ** 2)))[:, None] * np.array([s, -c])
    middle = np.column_stack([x + w / 2, y + h / 2])
    return middle + half, middle - half


def lean_in_image(camera: Camera) -> float:
    """Compute the lean of people in the middle of the image of a camera with a pose: radians clockwise from the vertical.

    It is 0 for a camera that looks steeply down: people in its image lean in all directions.
    """
    assert camera.pose is not None
    right, down, _ = camera.pose.R_cw[:, 2]
    return float(np.arctan2(right, -down)) if np.hypot(right, down) > STEEP else 0.0


def nominal_heights(joints: tuple[str, ...]) -> Floats:
    """Return the height (J,) of each named joint as a share of the body's; NaN for joints that move freely or are unknown."""
    out = np.full(len(joints), np.nan)
    for index, name in enumerate(joints):
        bare = name.removeprefix("left_").removeprefix("right_").removeprefix("mid_")
        out[index] = BODY_HEIGHTS.get(bare, np.nan)
    return out


def order_correlations(keypoints: Keypoints, names: tuple[str, ...]) -> list[float]:
    """Compute, for about 100 people, the correlation of the joints' heights by their names with those in the image.

    Args:
        keypoints: joints of one camera.
        names: (J,) assumed names of the joints.
    """
    nominal = nominal_heights(names)
    found = []
    for row in range(0, len(keypoints), max(1, len(keypoints) // 100)):
        use = (keypoints.score[row] > MIN_JOINT_SCORE) & np.isfinite(nominal)
        if np.count_nonzero(use) >= 6 and np.ptp(nominal[use]) > 0.5:
            found.append(float(np.corrcoef(nominal[use], -keypoints.xy[row, use, 1])[0, 1]))
    return found


def segments_of_keypoints(keypoints: Keypoints, named: bool, *, unknown: bool = False) -> Segments:
    """Return segments between head and feet of people with both found; people without an identity only if `unknown`."""
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
    """Return the mean position (N, 2) and the mean nominal height (N,) of the joints in use."""
    count = np.maximum(use.sum(axis=1), 1)
    mean = (xy * use[:, :, None]).sum(axis=1) / count[:, None]
    return mean, np.where(use, np.nan_to_num(nominal), 0.0).sum(axis=1) / count


def segments_without(segments: Segments, other: Segments) -> Segments:
    """Return the segments whose frame and identity are not in `other`."""
    pairs = np.column_stack([segments.frame, segments.identity])
    both = np.concatenate([np.column_stack([other.frame, other.identity]), pairs])
    _, number = np.unique(both, axis=0, return_inverse=True)
    number = number.ravel()
    new = ~np.isin(number[len(other.frame) :], number[: len(other.frame)])
    return segments.take(new)


def upright_segments(seen: CameraObservations, lens: Lens, lean: float = 0.0) -> Segments:
    """Return people with or without identity whose top and bottom are in the picture: boxes, and joints of people without box.

    Args:
        seen: boxes and joints.
        lens: the camera's lens.
        lean: lean of people in their boxes, see `segments_of_boxes`; joints show it themselves.
    """
    boxes = segments_of_boxes(seen.boxes, lens, unknown=True, lean=lean)
    joints = segments_without(segments_of_keypoints(seen.keypoints, named=True, unknown=True), boxes)
    return Segments.joined([boxes, joints])


def image_velocity(frame: Ints, identity: Ints, points: Floats, extent: Floats, fps: float) -> Floats:
    """Compute velocities (N, 2) in one camera's picture, pixels a second, from the samples before and after each sample.

    The sample itself is not used, so that its noise is not in its velocity.

    Args:
        frame: (N,) instants.
        identity: (N,) person, at most once a frame.
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
