"""Check of a rig by prediction: whether people are detected where the other cameras place them, missed detections included.

A person who stands upright on the ground by one camera is predicted in every other camera that should see the person whole. The
outcome is a *hit*, a box near the prediction, or a *miss*. The identity of the box in the second camera is not used: a box of
another identity is a hit. Outcomes are counted by blocks, one person during one stretch of time, since the outcomes of one
person are correlated. A camera is doubtful if it has far fewer hits beyond chance, by its own detections or by those of others,
than the other cameras have with each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.special import stdtr

from passerby.common.arrays import Bools, Columns, Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.figures import NoiseFigures
from passerby.core.observations import UNKNOWN, Boxes, CameraObservations, Observations
from passerby.core.synchronisation import USUAL_FPS, sampling_distance
from passerby.findings.finding import Finding, doubt
from passerby.people.segments import BODY_ASPECT, ends_of_boxes, lean_in_image, segments_of_keypoints
from passerby.people.upright_body import ground_under, height_over, pixels_over
from passerby.solver.adjustment_problem import AGREE_SIGMAS

STRETCH_S, PARTS = (1.0, 10.0), 8
"""Least and largest duration of a block, seconds, and number of parts of the recording: a block is one person during one part,
within these limits. In less time people move too little to be independent evidence."""
MOST_BOXES = 400
"""Approximate number of boxes of each camera, at even steps: shares are then accurate to a few percent."""
LATER = 0.37
"""Hits by chance are counted with the boxes of another time, later by this share of the recording."""
NEAR, WITHIN = (0.08, 0.2), 0.9
"""Limits of a hit's distance from the prediction, as shares of the height (14 to 35 cm), and share of hits. For one camera, a
box is a hit if it is as near as the share `WITHIN` of the other cameras' hits. For the whole rig it is a hit if it agrees by
the noise of the boxes (`AGREE_SIGMAS`)."""
SEEN_NEAR = 0.3
"""A camera can detect a person at a place in its image if it did so at another time within this distance, as a share of the
height. With 1, people behind walls halve the hits of right cameras of simulated sites (24, 32 cameras; seeds 880, 882)."""
USUAL_SHARE, USUAL_BLOCKS = 0.6, 5.0
"""Prior share of people who are detected where they are predicted, and its weight as a number of blocks: detectors miss 5 to
30 %, and nearer people hide some."""
HARMFUL_SHARE = 0.7
"""A camera with less than this share of the expected hits predicts 30 % of the people wrongly, or more."""
LEAST_ODDS = 3.0
"""Least odds that the share is below `HARMFUL_SHARE`. The prior odds of one are divided among all cameras and all parts of the
recording. Effects of other limits of these two: docs/results/limits.md (simulated scenes, seeds from 880,000)."""
BODY_M, MIDDLE_M = 1.75, 0.88
FOOT_SHARE = 0.04
"""Error of a box's lower edge, as a share of its height; for a low camera it is a long distance along the ground."""
USUAL_SIZE = (0.75, 1.25)
"""Limits of a body's height, from foot to head, relative to the median. People beyond them are bent or half hidden, so that
their feet are not at the lower edge of the box."""


@dataclass(frozen=True, eq=False)
class Outcomes(Columns):
    """N predictions: one camera places a person at one instant where another camera should detect the person."""

    by: Ints
    """(N,) index of the camera that places the person."""
    within: Ints
    """(N,) index of the camera in which the person is predicted."""
    block: Ints
    """(N,) number of the block: the person and the stretch of time."""
    part: Ints
    """(N,) part of the recording in which the stretch begins, 0 to `PARTS` - 1."""
    residual: Floats
    """(N,) distance from the predicted middle to that of the nearest box, as a share of the predicted height; infinite without
    a box."""
    by_chance: Floats
    """(N,) the same distance to boxes of another time."""
    height_px: Floats
    """(N,) predicted height, pixels."""

    def __len__(self) -> int:
        return len(self.block)

    def of_camera(self, camera: int | None) -> Bools:
        """Return whether a camera is one of the two of each prediction (N,)."""
        return np.asarray((self.by == camera) | (self.within == camera))

    def tolerance(self, noise: NoiseFigures | None) -> Floats:
        """Return the distances (N,) within which a box is a hit, as shares of the height, by the noise from the adjustment.

        Two boxes have errors: the one that places the person, and the one that is found. Without noise it is the upper limit.
        """
        if noise is None:
            return np.full(len(self), NEAR[1])
        return np.asarray(np.clip(AGREE_SIGMAS * np.sqrt(2) * np.hypot(noise.box_px / self.height_px, noise.centre), *NEAR))


def predict_people(rig: Rig, observations: Observations, unrecorded: Mapping[str, Ints]) -> Outcomes:
    """Predict the people that each camera sees in every other one, and compare the predictions with its boxes.

    Args:
        rig: world z up, ground z = 0, metres; cameras without a pose are left out.
        observations: observations at common instants. Boxes of unknown identity count as detections, but predict no person.
        unrecorded: by camera, the instants at which it recorded nothing.
    """
    every = {c: _boxes_of(observations[camera.name]) for c, camera in enumerate(rig) if camera.pose is not None}
    seen = {c: boxes.take(np.argsort(boxes.frame, kind="stable")) for c, boxes in every.items() if len(boxes)}
    standing = [_standing(c, rig.cameras[c], boxes) for c, boxes in seen.items()]
    if not any(map(len, standing)):
        return Outcomes(*(np.zeros(0, np.int64),) * 4, *(np.zeros(0),) * 3)
    people = _Standing.joined(standing)
    first, last = int(people.frame.min()), int(people.frame.max())
    length = last - first + 1
    steps = float(np.clip(length / PARTS, *((observations.fps or USUAL_FPS) * np.array(STRETCH_S))))
    stretch = ((people.frame - first) // steps).astype(np.int64)
    part = (stretch * steps * PARTS / length + 1e-6).astype(np.int64)
    _, block = np.unique(np.column_stack([people.identity, stretch]), axis=0, return_inverse=True)
    found = []
    for c, boxes in seen.items():
        recorded = _recorded(people.frame, boxes, steps / 2, unrecorded.get(rig.names[c]))
        rows = np.flatnonzero((people.by != c) & recorded)
        view = _InView.of(people.take(rows), rig.cameras[c], boxes, steps / 2)
        rows, within = rows[view.row], np.full(len(view.row), c)
        residuals = view.residual(0.0), view.residual(LATER)
        found.append(Outcomes(people.by[rows], within, block.reshape(-1)[rows], part[rows], *residuals, view.tall))
    return Outcomes.joined(found)


@dataclass(frozen=True)
class PoorPrediction:
    """A camera, or all of them (None), that predicts people poorly, during some parts of the recording."""

    camera: int | None
    first: int
    """Number of the first part of the recording, 0 to `PARTS` - 1."""
    last: int
    """Number of the last part, included."""
    share: float
    """Share of people who are detected where they are predicted, chance excluded."""
    expected: float
    """The same share by the other cameras and by usual detectors."""
    log_odds: float
    """Logarithm of the odds that `share` is below the harmful share of `expected`."""

    @property
    def significant(self) -> bool:
        """Whether it is reported as a finding."""
        return bool(self.log_odds > np.log(LEAST_ODDS))


def findings_of_predictions(rig: Rig, outcomes: Outcomes, noise: NoiseFigures | None = None) -> list[Finding]:
    """Return a doubt about each camera that predicts people poorly, worst first; one about the rig if most of them do."""
    return [
        doubt(
            "people_not_predicted", *([] if one.camera is None else [rig.names[one.camera]]), share=one.share,
            expected=one.expected, from_percent=100 * one.first / PARTS, to_percent=100 * (one.last + 1) / PARTS,
        )
        for one in find_poor_predictions(outcomes, noise)
    ]  # fmt: skip


def find_poor_predictions(outcomes: Outcomes, noise: NoiseFigures | None = None) -> list[PoorPrediction]:
    """Find the cameras that predict people poorly, worst first, each without the outcomes of those before; or the whole rig."""
    cameras = len(np.unique(np.append(outcomes.by, outcomes.within)))
    whole = worst_part(outcomes, None, cameras, noise=noise)
    if whole is None or whole.significant:
        return [] if whole is None else [whole]
    found = list[PoorPrediction]()
    while len(outcomes):
        each = [worst_part(outcomes, int(camera), cameras) for camera in np.unique(outcomes.by)]
        worst = max((one for one in each if one is not None), key=lambda one: one.log_odds, default=None)
        if worst is None or not worst.significant:
            return found
        found.append(worst)
        if 2 * len(found) > cameras:
            return [whole]
        outcomes = outcomes.take(~outcomes.of_camera(worst.camera))
    return found


def worst_part(
    outcomes: Outcomes, camera: int | None, cameras: int, harmful: float = HARMFUL_SHARE, noise: NoiseFigures | None = None
) -> PoorPrediction | None:
    """Find the part of the recording during which a camera most significantly predicts people worse than the other cameras.

    Args:
        outcomes: outcomes of all cameras.
        camera: index of the camera; None: the whole rig, compared with the usual share.
        cameras: number of cameras of the rig.
        harmful: see `HARMFUL_SHARE`.
        noise: noise of the boxes that the adjustment used. If these are few of all boxes, the others are far off by this noise.

    Returns:
        None without outcomes, or if all are of this camera.
    """
    own = np.ones(len(outcomes), dtype=bool) if camera is None else outcomes.of_camera(camera)
    rest = outcomes.residual[~own & (outcomes.residual < NEAR[1])]
    if not own.any() or (camera is not None and own.all()):
        return None
    near = np.clip(np.quantile(rest, WITHIN), *NEAR) if len(rest) else outcomes.tolerance(noise)
    _, pair = np.unique(outcomes.by * (outcomes.within.max() + 1) + outcomes.within, return_inverse=True)
    chance = (np.bincount(pair, outcomes.by_chance < near) / np.bincount(pair))[pair]
    hits, due = (outcomes.residual < near) - chance, 1.0 - chance
    elsewhere = np.array([np.bincount(outcomes.part[~own], one[~own], PARTS) for one in (hits, due)])
    _, row, block = np.unique(outcomes.block[own], return_index=True, return_inverse=True)
    part = outcomes.part[own][row]
    own_hits, own_due = (np.bincount(block, one[own]).astype(np.float64) for one in (hits, due))
    found = []
    for first, last in (parts := list(combinations_with_replacement(range(PARTS), 2))):
        rows = (part >= first) & (part <= last)
        if np.count_nonzero(rows) < 2:
            continue
        usual = USUAL_BLOCKS * own_due[rows].mean() * np.array([USUAL_SHARE, 1.0])
        others = (usual + elsewhere[:, first : last + 1].sum(axis=1)) if camera is not None else usual
        expected = float(others[0] / others[1])
        log_odds = _log_odds(own_hits[rows], own_due[rows], harmful * expected)
        prior = -np.log((1 if camera is None else cameras) * (1 if last - first == PARTS - 1 else len(parts)))
        share = float(own_hits[rows].sum() / own_due[rows].sum())
        found.append(PoorPrediction(camera, first, last, share, expected, float(log_odds + prior)))
    return max(found, key=lambda one: one.log_odds, default=None)


def _log_odds(hits: Floats, due: Floats, limit: float) -> float:
    """Compute the log-odds that the share of hits is below a limit, by Student's distribution of the mean score of N blocks.

    The score of a block is the number of missed people above that which the limit allows. One block without a miss is added, so
    that a few blocks are not significant.
    """
    score = np.append(limit * due - hits, (limit - 1.0) * due.mean())
    z = score.mean() / max(score.std(ddof=1) / np.sqrt(len(score)), 1e-9)
    below, above = (max(float(stdtr(len(hits), side * z)), 1e-300) for side in (1, -1))
    return float(np.log(below / above))


def _recorded(frame: Ints, boxes: Boxes, silent: float, unrecorded: Ints | None) -> Bools:
    """Return whether a camera recorded at frames (N,): not in its gaps, nor without a box for more than `silent` frames."""
    steps = np.unique(boxes.frame)
    after = np.searchsorted(steps, frame)
    inside = (after < len(steps)) & (frame >= steps[0])
    nearest = steps[np.minimum(after, len(steps) - 1)], steps[np.maximum(after - 1, 0)]
    recorded = inside & ((nearest[0] - nearest[1] <= silent) | (nearest[0] == frame))
    if sampling_distance(boxes.frame) > 1:  # a slower camera has no frame in between
        recorded &= np.isin(frame, steps)
    return np.asarray(recorded if unrecorded is None else recorded & ~np.isin(frame, unrecorded))


def _boxes_of(seen: CameraObservations) -> Boxes:
    """Return a camera's boxes; from joints alone, boxes from the heads to the feet of the same people."""
    if len(seen.boxes) or not len(seen.keypoints):
        return seen.boxes
    people = segments_of_keypoints(seen.keypoints, named=True, unknown=True)
    body = (people.bottom - people.top) / (people.top_fraction - people.bottom_fraction)[:, None]
    middle = people.bottom + (0.5 - people.bottom_fraction)[:, None] * -body
    size = np.column_stack([BODY_ASPECT * body[:, 1], body[:, 1]])
    return Boxes(people.frame, people.identity, np.column_stack([middle - size / 2, size]), np.ones(len(body)))


@dataclass(frozen=True, eq=False)
class _Standing(Columns):
    """N people who stand upright on the ground by one camera's boxes."""

    by: Ints
    """(N,) index of the camera."""
    frame: Ints
    identity: Ints
    nearest: Floats
    """(N, 2) positions on the ground if the box's lower edge is too high, metres."""
    farthest: Floats
    """(N, 2) positions on the ground if it is too low, metres."""

    def __len__(self) -> int:
        return len(self.by)


def _standing(number: int, camera: Camera, boxes: Boxes) -> _Standing:
    """Return the people who stand upright on the ground, by the boxes of one camera with an index."""
    rows = np.flatnonzero((boxes.identity > UNKNOWN) & boxes.inside(camera.lens.size))
    rows = rows[:: max(1, len(rows) // MOST_BOXES)]
    top, bottom = ends_of_boxes(boxes.ltwh[rows], lean_in_image(camera))
    places = [ground_under(camera, top + (1 + share) * (bottom - top)) for share in (FOOT_SHARE, 0.0, -FOOT_SHARE)]
    tall = height_over(camera, places[1], top)
    sound = np.isfinite(tall) & np.isfinite(places[0]).all(axis=1) & np.isfinite(places[2]).all(axis=1)
    usual = float(np.median(tall[sound])) if sound.any() else BODY_M
    sound &= (tall > USUAL_SIZE[0] * usual) & (tall < USUAL_SIZE[1] * usual)
    rows = rows[sound]
    return _Standing(np.full(len(rows), number), boxes.frame[rows], boxes.identity[rows], places[0][sound], places[2][sound])


@dataclass(frozen=True, eq=False)
class _InView:
    """M people who should be seen whole by a camera, in its pixels."""

    boxes: Boxes
    """Boxes of the camera, sorted by frame."""
    row: Ints
    """(M,) rows of the people in `_Standing`."""
    frame: Ints
    nearest: Floats
    """(M, 2) the body's middle if the person stands nearest to the camera that places it."""
    farthest: Floats
    """(M, 2) the body's middle if the person stands farthest from that camera."""
    tall: Floats
    """(M,) expected height, pixels."""

    @property
    def middle(self) -> Floats:
        """(M, 2) the body's middle at the most likely position."""
        return 0.5 * (self.nearest + self.farthest)

    @classmethod
    def of(cls, standing: _Standing, camera: Camera, boxes: Boxes, apart: float) -> _InView:
        """Select the people with feet and head well inside the image who are not hidden and can be detected there."""
        place = 0.5 * (standing.nearest + standing.farthest)
        feet, head = pixels_over(camera, place, 0.0), pixels_over(camera, place, BODY_M)
        size = np.array(camera.lens.size, dtype=np.float64)
        tall = np.linalg.norm(feet - head, axis=1)
        margin = 0.25 * np.nan_to_num(tall)[:, None] + 3.0
        ends = [pixels_over(camera, at, MIDDLE_M) for at in (standing.nearest, standing.farthest)]
        with np.errstate(invalid="ignore"):
            due = tall > 0
            for end in (feet, head):
                due &= ((end > margin) & (end < size - margin)).all(axis=1)
        row = np.flatnonzero(due & np.isfinite(ends[0]).all(axis=1) & np.isfinite(ends[1]).all(axis=1))
        found = cls(boxes, row, standing.frame[row], ends[0][row], ends[1][row], tall[row])
        keep = found.detectable(apart) & ~found.hidden(feet[row])
        return cls(boxes, row[keep], found.frame[keep], found.nearest[keep], found.farthest[keep], found.tall[keep])

    def detectable(self, apart: float) -> Bools:
        """Return whether a person of similar place and size was detected more than `apart` frames earlier or later (M,).

        People behind a wall or a pillar are never detected.
        """
        known = self.boxes.take(np.arange(0, len(self.boxes), max(1, len(self.boxes) // (5 * MOST_BOXES))))
        known = known.take(np.argsort(known.ltwh[:, 3]))
        tall, middle = known.ltwh[:, 3], known.ltwh[:, :2] + known.ltwh[:, 2:] / 2
        out = np.zeros(len(self.row), dtype=bool)
        for rows in np.array_split(np.argsort(self.tall), len(out) // 50 + 1):
            # People and boxes are sorted by size: each group of people is compared only with boxes of similar size.
            least, most = (self.tall[rows, None] * factor for factor in USUAL_SIZE)
            about = slice(*np.searchsorted(tall, (least.min(initial=np.inf), most.max(initial=0.0))))
            dx, dy = (middle[about, k] - self.middle[rows, k : k + 1] for k in (0, 1))
            near = dx**2 + dy**2 < (SEEN_NEAR * self.tall[rows, None]) ** 2
            alike = (tall[about] > least) & (tall[about] < most)
            out[rows] = (near & alike & (np.abs(known.frame[about] - self.frame[rows, None]) > apart)).any(axis=1)
        return out

    def hidden(self, feet: Floats) -> Bools:
        """Return whether the box of another person, nearer to the camera, covers the middle (M,); `feet` (M, 2), pixels."""
        out = np.zeros(len(self.row), dtype=bool)
        for rows, boxes in self._at_once(0.0):
            x, y, w, h = self.boxes.ltwh[boxes].T
            dx, dy = x + w / 2 - self.middle[rows, 0], y + h / 2 - self.middle[rows, 1]
            nearer = (y + h > feet[rows, 1]) & (np.hypot(dx, dy) > NEAR[1] * self.tall[rows])
            out[rows] |= nearer & (np.abs(dx) < w / 2) & (np.abs(dy) < h / 2)
        return out

    def residual(self, later: float) -> Floats:
        """Return the distances (M,) to the nearest box, as shares of the predicted height; `later`: share of the recording."""
        out = np.full(len(self.row), np.inf)
        middles = self.boxes.ltwh[:, :2] + self.boxes.ltwh[:, 2:] / 2
        for rows, boxes in self._at_once(later):
            away = _from_segment(middles[boxes], self.nearest[rows], self.farthest[rows])
            out[rows] = np.minimum(out[rows], away / self.tall[rows])
        return out

    def _at_once(self, later: float) -> Iterator[tuple[Ints, Ints]]:
        """Yield pairs of people and boxes at one instant, or that share of the recording later; a person once in each batch."""
        begin, end = int(self.boxes.frame[0]), int(self.boxes.frame[-1])
        length = end - begin + 1
        frame = begin + (self.frame - begin + round(later * length)) % length
        first, last = (np.searchsorted(self.boxes.frame, frame, side=side) for side in ("left", "right"))
        for k in range(int((last - first).max(initial=0))):
            rows = np.flatnonzero(first + k < last)
            yield rows, first[rows] + k


def _from_segment(point: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distances (N,) of points (N, 2) from segments with ends (N, 2)."""
    along = end - start
    length = np.maximum(np.einsum("nk,nk->n", along, along), 1e-9)
    share = np.clip(np.einsum("nk,nk->n", point - start, along) / length, 0.0, 1.0)
    return np.asarray(np.linalg.norm(point - start - share[:, None] * along, axis=1))
