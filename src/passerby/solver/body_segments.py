"""Scale and ground from trunks and arms, where no person is seen from head to feet.

Joints that several cameras share determine the relative poses of the cameras, and the joints of each body in space. One
similarity remains: its scale comes from the lengths of body segments as shares of stature, its up direction from the upright
parts of the body (`body_vertical`), and its ground from the height of hips, shoulders or heads. Posture does not change the
lengths of segments, but it changes these heights. The ground is therefore only an approximation; any better source replaces it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import MIN_JOINT_SCORE, Keypoints, Observations
from passerby.geometry.groups import NORMAL_BY_MAD, group_medians, group_numbers
from passerby.geometry.triangulation import angular_residuals, move_to_camera_frames, triangulate
from passerby.people.segments import BODY_HEIGHTS, HEAD

MOST_BODIES = 4000
"""Largest number of person-instants that are measured; of more, these are drawn at random."""
MOST_OFF = 5.0
"""Joints whose rays miss each other by more than this multiple of the median are left out: 3.4 sigmas of normal errors."""


@dataclass(frozen=True)
class Segment:
    """A part of the body of constant length."""

    name: str
    """Name in the plural, for reports."""
    ends: tuple[tuple[str, str], ...]
    """Joints at its ends; one pair for each side of the body where there are two."""
    share: float
    """Length as a share of stature: Drillis and Contini (1966), as in Winter, *Biomechanics and Motor Control of Human
    Movement*, figure 4.1."""
    sd: float
    """Standard deviation of the means of sources and of the joints of detectors from it, as a share of the length."""


SEGMENTS = (
    Segment("trunks", (("shoulders", "hips"), ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip")), 0.288, 0.08),
    # Between the joints; from acromion to acromion the share is 0.259.
    Segment("shoulders", (("left_shoulder", "right_shoulder"),), 0.21, 0.12),
    Segment("upper arms", (("left_shoulder", "left_elbow"), ("right_shoulder", "right_elbow")), 0.186, 0.07),
    Segment("forearms", (("left_elbow", "left_wrist"), ("right_elbow", "right_wrist")), 0.146, 0.08),
    # From 0.11 for the ears to 0.18 for the crown (`BODY_HEIGHTS`); heads also nod.
    Segment("heads over shoulders", (("shoulders", "head"),), 0.14, 0.25),
)
"""Segments of the upper body. Hips are the least certain: each detector puts them at a different distance from the joints."""
COMMON_SD = 0.05
"""Standard deviation of an error common to all segments: clothes, and joints that lie deeper in the body than detected."""
PROPORTION_SD = 0.04
"""Standard deviation of a person's proportions from the mean, as a share of lengths (Winter's tables: 3 to 5 %)."""
CONTRADICTORY = 4.0
"""Limit in sigmas: a segment whose scale differs from that of the others by more has wrong joint names. Rooms of ten keypoints
have up to 3.1 with the right names, 4.3 to 11 where elbows are exchanged with wrists, hips or shoulders (seeds 4711 to
4720)."""
OUTLIER_SIGMAS = 3.0
"""Distance in sigmas at which the scale from a person's segments has half its weight."""
MEDIAN_VARIANCE = np.pi / 2
"""Ratio of the variance of the median of normal deviates to that of their mean."""

HIP_SHARE = BODY_HEIGHTS["hip"]
"""Height of the hips of a standing person, as a share of stature."""
STANDING_HEIGHTS = (
    ("hips", ("hips", "left_hip", "right_hip"), HIP_SHARE),
    ("shoulders", ("shoulders", "left_shoulder", "right_shoulder"), BODY_HEIGHTS["shoulder"]),
    ("heads", ("head",), BODY_HEIGHTS["head"]),
)
"""Parts of the body that give the ground, the lowest first, which moves least where people lean: name for reports, joints, and
height as a share of stature."""
STANDING_QUANTILE = 0.8
"""Quantile of each person's heights, and then of all people's, weighted by how often they were seen: standing people are
higher than seated ones."""
GROUND_SD_M = 0.25
"""Standard deviation of the ground from such heights, metres: all people may sit, 0.4 m lower."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Joints of N bodies in space, in the rig's frame and unit."""

    identity: Ints
    """(N,) identity of each body, ascending."""
    frame: Ints
    """(N,) instant of each body, ascending for each identity."""
    points: Floats
    """(N, J, 3) joints; NaN for a joint that fewer than two cameras see."""
    joints: tuple[str, ...]

    def at(self, name: str) -> Floats:
        """Return one joint (N, 3); `shoulders`, `hips`, `elbows` are the middles of both sides, `head` any joint of it."""
        if name == "shoulders":
            return self._middle("shoulder", "neck")
        if name == "hips":
            return self._middle("hip", "mid_hip")
        if name == "elbows":
            return self._middle("elbow")
        if name == "head":
            return _first_known(self._middle("ear"), *(self._joint(joint) for joint in HEAD))
        return self._joint(name)

    def _joint(self, name: str) -> Floats:
        if name not in self.joints:
            return np.full((len(self.points), 3), np.nan)
        return self.points[:, self.joints.index(name)]

    def _middle(self, part: str, instead: str = "") -> Floats:
        middle = 0.5 * (self._joint(f"left_{part}") + self._joint(f"right_{part}"))
        return _first_known(middle, self._joint(instead))


@dataclass(frozen=True)
class BodyScale:
    """Scale from the lengths of body segments."""

    log_factor: float
    """Logarithm of the factor that makes the rig's lengths metres."""
    sd: float
    people: int
    segments: tuple[str, ...]
    """Names of the segments that were measured."""


def bodies_in_space(rig: Rig, R: Floats, centre: Floats, observations: Observations, rng: np.random.Generator) -> Bodies | None:
    """Triangulate all bodies whose joints two or more cameras share; None where there are none.

    Args:
        rig: names and lenses.
        R: (C, 3, 3) world to camera, in the order of `rig`.
        centre: (C, 3) in any unit.
        observations: keypoints with identities.
        rng: draws bodies where there are more than `MOST_BODIES`.
    """
    seen = [(c, keypoints) for c, name in enumerate(rig.names) if len(keypoints := observations[name].keypoints)]
    if not seen:
        return None
    joints = tuple(dict.fromkeys(name for _, one in seen for name in one.joints))
    seen = [(c, _in_order(one, joints)) for c, one in seen]
    camera = np.concatenate([np.full(len(one), c) for c, one in seen])
    identity, frame = (np.concatenate([getattr(one, name) for _, one in seen]) for name in ("identity", "frame"))
    body = group_numbers(identity, frame)
    shared = (np.bincount(body)[body] >= 2) & (identity >= 0)
    numbers = np.unique(body[shared])
    if len(numbers) > MOST_BODIES:
        numbers = np.sort(rng.choice(numbers, MOST_BODIES, replace=False))
    if not len(numbers):
        return None
    place = np.full(int(body.max()) + 1, -1)
    place[numbers] = np.arange(len(numbers))
    rows = np.flatnonzero(place[body] >= 0)
    n, k = len(numbers), len(joints)
    xy, score = (np.concatenate([getattr(one, name) for _, one in seen]) for name in ("xy", "score"))
    row, joint = np.nonzero(score[rows] > MIN_JOINT_SCORE)
    row = rows[row]
    of, point = camera[row], place[body[row]] * k + joint
    bearing = np.zeros((len(row), 3))
    for c, item in enumerate(rig):
        bearing[of == c] = item.lens.bearings(xy[row, joint][of == c])
    points = _triangulated(of, point, bearing, R, centre, n * k)
    first = np.unique(place[body[rows]], return_index=True)[1]
    return Bodies(identity[rows[first]], frame[rows[first]], points.reshape(n, k, 3), joints)


def _triangulated(camera: Ints, point: Ints, bearing: Floats, R: Floats, centre: Floats, n: int) -> Floats:
    """Triangulate points (n, 3); NaN where rays are too few, miss each other or meet behind a camera."""
    known = np.isfinite(bearing).all(axis=1)
    camera, point, bearing = camera[known], point[known], bearing[known]
    t = -np.einsum("cij,cj->ci", R, centre)
    points = triangulate(camera, point, bearing, R, t, n)
    there = np.isfinite(points[point]).all(axis=1)
    camera, point, bearing = camera[there], point[there], bearing[there]
    off = angular_residuals(move_to_camera_frames(points, camera, point, R, t), bearing)
    if len(off):
        points[point[~(off <= MOST_OFF * np.nanmedian(off))]] = np.nan
    return points


def _in_order(keypoints: Keypoints, joints: tuple[str, ...]) -> Keypoints:
    """Return the keypoints with these joints as columns; missing joints have a score of 0."""
    if keypoints.joints == joints:
        return keypoints
    at = [joints.index(name) for name in keypoints.joints]
    xy, score = np.zeros((len(keypoints), len(joints), 2)), np.zeros((len(keypoints), len(joints)))
    xy[:, at], score[:, at] = keypoints.xy, keypoints.score
    return replace(keypoints, xy=xy, score=score, joints=joints)


def body_scale(bodies: Bodies, height_mean: Floats, height_sd: Floats, people: Ints) -> BodyScale | None:
    """Estimate the scale from the lengths of segments; None where no segment is measured.

    Each segment of a person is weighted by the sigma of its kind and by how often it was measured. Where segments differ by
    more than their sigmas, these are enlarged accordingly (the scale factor of the Particle Data Group's averages).

    Args:
        bodies: bodies in space.
        height_mean: (P,) expected stature, metres.
        height_sd: (P,) its standard deviation, with the part common to all people (`expected_heights`), metres.
        people: (P,) identities of the people.
    """
    measured = _measured_segments(bodies, height_mean, people)
    known = np.isfinite(measured.log)
    who = known.any(axis=1)
    if not who.any():
        return None
    wider, _ = _disagreement(measured)
    log, noise = np.nan_to_num(measured.log[who]), measured.noise[who]
    weight = np.where(known[who], 1 / (measured.sd**2 + noise), 0.0)
    share = weight / weight.sum(axis=1, keepdims=True)
    own = (share * log).sum(axis=1)
    variance = (height_sd[who] / height_mean[who]) ** 2 + PROPORTION_SD**2 + (share**2 * noise).sum(axis=1)
    common = np.average(share, axis=0, weights=1 / variance)
    of_segments = np.hypot(COMMON_SD, max(wider, 1.0) * np.linalg.norm(common * measured.sd))
    sd = float(np.sqrt(1 / (1 / variance).sum() + of_segments**2))
    names = tuple(SEGMENTS[k].name for k in np.flatnonzero(known.any(axis=0)))
    return BodyScale(_robust_mean(own, variance), sd, int(np.count_nonzero(who)), names)


def segments_agree(bodies: Bodies, height_mean: Floats, people: Ints) -> bool:
    """Return whether all segments give about the same scale; they do not where joints are exchanged with others.

    The arguments are those of `body_scale`.
    """
    return _disagreement(_measured_segments(bodies, height_mean, people))[1] <= CONTRADICTORY


@dataclass(frozen=True, eq=False)
class _Measured:
    """Logarithm of the scale from each segment of each person."""

    log: Floats
    """(P, S) logarithm of the scale; NaN where the segment was not measured."""
    noise: Floats
    """(P, S) its variance due to noise, which falls with the number of measurements."""
    sd: Floats
    """(S,) standard deviation of the error common to all people's segments of a kind. It includes the bias of noise, which
    lengthens a segment by the square of the noise's share."""


def _measured_segments(bodies: Bodies, height_mean: Floats, people: Ints) -> _Measured:
    """Measure the segments of all people; the arguments are those of `body_scale`."""
    log, noise = np.full((len(people), len(SEGMENTS)), np.nan), np.zeros((len(people), len(SEGMENTS)))
    place = np.searchsorted(people, bodies.identity)
    sd = np.array([segment.sd for segment in SEGMENTS])
    for k, segment in enumerate(SEGMENTS):
        lengths = np.concatenate([np.linalg.norm(bodies.at(a) - bodies.at(b), axis=1) for a, b in segment.ends])
        use = np.isfinite(lengths) & (lengths > 0) & np.tile(np.isin(bodies.identity, people), len(segment.ends))
        if not use.any():
            continue
        person = np.tile(place, len(segment.ends))[use]
        each = np.log(segment.share * height_mean[person] / lengths[use])
        measured, number, count = np.unique(person, return_inverse=True, return_counts=True)
        log[measured, k] = group_medians(number, each, len(measured))
        scatter = NORMAL_BY_MAD * float(np.median(np.abs(each - np.median(each))))
        noise[measured, k] = MEDIAN_VARIANCE * scatter**2 / count
        sd[k] = np.hypot(sd[k], scatter**2)
    return _Measured(log, noise, sd)


def _disagreement(measured: _Measured) -> tuple[float, float]:
    """Return how many times the scales of segments differ more than their sigmas, and the distance in sigmas of the most
    different segment from the others; both 0 where only one kind of segment was measured.
    """
    known = np.isfinite(measured.log).any(axis=0)
    if np.count_nonzero(known) < 2:
        return 0.0, 0.0
    at = np.nanmedian(measured.log[:, known], axis=0)
    people = np.isfinite(measured.log[:, known]).sum(axis=0)
    noise = measured.noise[:, known].sum(axis=0) / people**2
    weight = 1 / (measured.sd[known] ** 2 + PROPORTION_SD**2 / people + noise)
    off = at - np.average(at, weights=weight)
    # Without a segment, the mean moves away from it in proportion to its share of the weight.
    others = 1 - weight / weight.sum()
    farthest = np.abs(off) * np.sqrt(weight / others)
    return float(np.sqrt((off**2 * weight).sum() / (len(at) - 1))), float(farthest.max())


def _robust_mean(values: Floats, variance: Floats) -> float:
    """Return the mean of values (N,) weighted by 1 / variance (N,); outliers beyond about `OUTLIER_SIGMAS` get less weight."""
    mean = float(np.median(values))
    for _ in range(10):
        weight = 1 / (variance + ((values - mean) / OUTLIER_SIGMAS) ** 2)
        mean = float(np.average(values, weights=weight))
    return mean


def ground_below(bodies: Bodies, up: Floats, factor: float, people: Ints, height_mean: Floats) -> tuple[float, str] | None:
    """Estimate the height of the ground along `up`, metres, and name the part of the body that gives it; None without any.

    The highest people are taken to stand.

    Args:
        bodies: bodies in space.
        up: (3,) unit vector.
        factor: length of the unit of `bodies`, metres.
        people: (P,) identities of the people.
        height_mean: (P,) expected stature, metres.
    """
    stature = height_mean[np.clip(np.searchsorted(people, bodies.identity), 0, len(people) - 1)]
    under = np.array([
        factor * (_first_known(*(bodies.at(name) for name in joints)) @ up) - share * stature
        for _, joints, share in STANDING_HEIGHTS
    ])  # fmt: skip
    known = np.isfinite(under) & np.isin(bodies.identity, people)
    use, first = known.any(axis=0), known.argmax(axis=0)
    if not use.any():
        return None
    ground = under[first, np.arange(len(first))]
    _, number, count = np.unique(bodies.identity[use], return_inverse=True, return_counts=True)
    own = [np.quantile(ground[use][number == person], STANDING_QUANTILE) for person in range(len(count))]
    by = STANDING_HEIGHTS[int(np.bincount(first[use]).argmax())][0]
    return float(np.quantile(np.repeat(own, count), STANDING_QUANTILE)), by


def _first_known(*choices: Floats) -> Floats:
    """Return for each body the first of these points (N, 3) that is known."""
    found = choices[0]
    for choice in choices[1:]:
        found = np.where(np.isfinite(found), found, choice)
    return found
