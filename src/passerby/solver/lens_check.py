"""Does a camera's focal length fit what it saw? A score test at the optimum, which holds the focal lengths fixed.

One unknown a camera is added, the logarithm of its focal length, and one Gauss-Newton step of the reduced system tells where
it would go and how surely (Rao's score test). A wrong focal length hides well: poses, slack and learnt noise take it up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.solver.lens_columns import (
    by_focal,
    by_principal_point,
    lens_columns,
    widen_terms,
    widened_layout,
)
from passerby.solver.lens_sigmas import BOXES_MISLEAD, by_boxes
from passerby.solver.lens_unknowns import by_distortion
from passerby.solver.optimizer.least_squares import NormalEquations
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.uncertainty import downweight

# People do not look equally tall at all distances: hidden feet, slopes and a detector's habits change with depth by
# a few percent, which a focal length would explain as well. The less depth a camera sees, as a share of its distance, the more.
SIZE_DRIFT = 0.03
# Joints are off by what no more of them averages out: a detector puts each kind of joint beside the true one, by as much as
# pose and view make it. Steps of right lenses, over their random sigmas: 1.1 root mean square, 3.4 at the 99th percentile, in
# 78 simulated scenes whose joints are off by 1 to 3 % of the body, most of it constant by kind, camera and heading.
JOINTS_MISLEAD = 1.5
# A detector leaves a margin around people, some of it constant in pixels, so that those far off seem larger. Steps of right
# lenses over sigmas that do not know of it: 1.3, 1.4 and 1.6 root mean square where each edge of a camera's boxes is off by
# 0, 2 and 4 pixels throughout (27 simulated scenes of a minute, three presets, seeds 300 to 302).
MARGINS_MISLEAD = 1.5
# One step of a linear model says nothing where it goes farther than a factor of e, nor where the evidence is too thin for a
# sigma below this: there were 5 steps of 3.5 sigmas and more in 239 short scenes with right lenses, all of -0.6 to -2.
FARTHEST, KNOWN_FOCAL = 1.0, 0.1
# People that a camera sees, each instant counted: with fewer, errors of joints average out over too few poses and views. Of 70
# scenes with right lenses, boxes and joints, 8 to 12 s, two were accused, both with 60 to 67; one focal length 20 % too long is
# named in 15 instead of 18 of 36.
MIN_INSTANTS, JOINTS_OF_A_BODY = 100, 17
# Either of: sigmas, and change. A fifth too short in one camera of four is 3.1 to 4.4 sigmas (terrace, basketball,
# construction; 20 s, boxes with 2 % noise), and told in 7 of 7 scenes; all lenses a fifth too long are told in 7 of 7; right
# ones are at most 0.8 sigmas, and 1.5 in ordinary scenes of more noise. 5 % in one camera is never told, 10 % seldom.
# The lenses of two cameras exchanged come to 2.3 to 2.6 sigmas and 12 to 14 %.
WRONG = ((3.5, 0.05), (2.25, 0.115))
# What all cameras have in common is told by either of these, change and sigmas: -13 to -17 % by the median of 15 of 36 short
# scenes whose focal lengths are stated 15 % too long; at PETS2009 it was 5 %. There have to be three cameras that all change in
# one direction, and it has to be known to `KNOWN_COMMON`: the two of 239 short scenes with right lenses that came to as much
# had cameras of either direction.
COMMON, KNOWN_COMMON, MIN_CAMERAS = ((0.12, 2.0), (0.06, 3.0)), 0.1, 3
# Right distortions: at most 2.9 sigmas over simulated scenes, 1.8 at PETS2009; a first coefficient wrong by 0.1 is 2.9 to 4.3
# at basketball and construction, and below 1 at terrace, where people keep to the middle of the pictures and it costs 8 mm.
MIN_DISTORTION_SIGMAS, MIN_DISTORTION = 3.2, 0.01
# A principal point 30 pixels off is 1 to 1.6 sigmas by boxes, and wrong focal lengths move it by whole pictures: it is only
# told where it is known to this share of the width, as by joints.
MIN_POINT_SIGMAS, MIN_POINT, KNOWN_POINT = 3.5, 0.02, 0.01


@dataclass(frozen=True)
class FocalCheck:
    """Where one camera's focal length would go."""

    camera: str
    change: float
    """Relative change."""
    sigma: float
    """One sigma of it, with what the people's apparent size may drift over depth."""
    against_others: float
    """The change beyond the median of all cameras': what all have in common is the people's doing."""
    instants: int = MIN_INSTANTS
    """People that the camera sees, each instant counted."""
    widened: float = 1.0
    """Factor in the sigma for a detector's margins, which are no want of evidence."""

    @property
    def telling(self) -> bool:
        """Whether the step means anything: it is short enough for a linear model, its sigma small, and people were many."""
        known = self.sigma < KNOWN_FOCAL * self.widened
        return abs(self.change) < FARTHEST and known and self.instants >= MIN_INSTANTS

    @property
    def wrong(self) -> bool:
        """Whether the focal length contradicts the people."""
        # Of three cameras two may be right and make the third look wrong that changes little itself.
        least = min(abs(self.against_others), abs(self.change)) if self.against_others * self.change > 0 else 0.0
        return self.telling and any(least > max(sigmas * self.sigma, change) for sigmas, change in WRONG)


@dataclass(frozen=True)
class ShapeCheck:
    """Where one camera's principal point or distortion would go."""

    camera: str
    part: Literal["principal point", "distortion"]
    change: tuple[float, ...]
    """Pixels in x and y; of the distortion, of its first coefficient."""
    sigma: tuple[float, ...]
    """One sigma of each."""
    moved: float
    """By how much the change moves points of the picture, as a share of its width: the principal point by itself, a distortion
    the middle of the picture's left and right edge."""

    known: bool = True
    """Whether people tell it well enough for a contradiction to mean anything."""

    @property
    def wrong(self) -> bool:
        """Whether it contradicts the people."""
        sigmas = max(abs(change) / sigma for change, sigma in zip(self.change, self.sigma, strict=True))
        if self.part == "distortion":
            return self.known and sigmas > MIN_DISTORTION_SIGMAS and self.moved > MIN_DISTORTION
        return self.known and sigmas > MIN_POINT_SIGMAS and self.moved > MIN_POINT


def common_change(focals: Sequence[FocalCheck]) -> float | None:
    """What all focal lengths would change by alike, where it is beyond what people and boxes explain; else None."""
    if len(focals) < MIN_CAMERAS:
        return None
    changes = np.array([check.change for check in focals])
    change, sigma = float(np.median(changes)), float(np.median([check.sigma for check in focals]))
    if np.median([check.instants for check in focals]) < MIN_INSTANTS:
        return None
    if sigma >= KNOWN_COMMON or abs(change) >= FARTHEST or not (changes * change > 0).all():
        return None
    return change if any(abs(change) > max(least, sigmas * sigma) for least, sigmas in COMMON) else None


def check_focals(rig: Rig, problem: PeopleProblem, state: AdjustmentState, inflation: float) -> list[FocalCheck]:
    """The step of each camera's focal length at the optimum.

    Args:
        rig: the lenses, in the order of the problem's cameras.
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
    """
    step, sd, misled = _score(
        problem, state, inflation, lens_columns(rig, problem, state, by_focal), _by_size_drift(problem, state)
    )
    boxes = by_boxes(problem)
    random, margins = np.where(boxes, 1.0, JOINTS_MISLEAD) * sd[:, 0], np.where(boxes, MARGINS_MISLEAD, 1.0)
    change, sigma = step[:, 0], margins * np.hypot(random, misled[:, 0])
    beyond = change - np.median(change)
    seen = _instants(problem)
    numbers = (column.tolist() for column in (change, sigma, beyond, seen, margins))
    columns = zip(rig.names, *numbers, strict=True)
    return [FocalCheck(*row) for row in columns]


def check_shapes(rig: Rig, problem: PeopleProblem, state: AdjustmentState, inflation: float) -> list[ShapeCheck]:
    """The steps of each camera's principal point, and of its distortion's first coefficient; arguments as of `check_focals`."""
    out: list[ShapeCheck] = []
    enough = _instants(problem) >= MIN_INSTANTS
    width = np.array([camera.lens.size[0] for camera in rig], dtype=np.float64)
    step, sd, _ = _score(problem, state, inflation, lens_columns(rig, problem, state, by_principal_point))
    for c, camera in enumerate(rig):
        moved = float(np.linalg.norm(step[c]) / width[c])
        sigma = BOXES_MISLEAD * sd[c]
        known = float(sigma.max()) < KNOWN_POINT * width[c] and bool(enough[c])
        out.append(ShapeCheck(camera.name, "principal point", tuple(step[c]), tuple(sigma), moved, known))
    step, sd, _ = _score(problem, state, inflation, lens_columns(rig, problem, state, by_distortion))
    for c, camera in enumerate(rig):
        lens = camera.lens
        edge = lens.bearings(np.array([[0.0, lens.size[1] / 2], [lens.size[0] - 1.0, lens.size[1] / 2]]))
        per_unit = np.nanmax(np.abs(by_distortion(lens, edge)), initial=0.0)
        moved = float(abs(step[c, 0]) * per_unit / width[c])
        out.append(ShapeCheck(camera.name, "distortion", tuple(step[c]), tuple(BOXES_MISLEAD * sd[c]), moved, bool(enough[c])))
    return out


def _score(
    problem: PeopleProblem, state: AdjustmentState, inflation: float, columns: dict[str, Floats],
    biases: dict[str, Floats] | None = None,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Gauss-Newton steps of u more unknowns of each camera, all (C, u): steps, their standard deviations, and one sigma of what
    biases of the observations do to them.

    Args:
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
        columns: (M, k, u) whitened derivatives by the own camera's unknowns, for each kind of residual.
        biases: (M, k, 1) by one bias of each camera, in its sigmas: no unknown, but considered in the sigma (`systematic`).
    """
    n, u = problem.n_cameras, next(iter(columns.values())).shape[2]
    both = columns if biases is None else {k: np.concatenate([columns[k], biases[k]], axis=2) for k in columns}
    layout, places = widened_layout(problem, next(iter(both.values())).shape[2])
    terms = [downweight(widen_terms(term, problem, both), inflation) for term in problem.terms(state, jacobians=True)]
    reduced = NormalEquations(layout, terms).reduce()
    own, considered = places[:, :u], places[:, u:].ravel()
    kept = np.setdiff1d(np.arange(len(reduced.H)), considered)
    H = reduced.H[np.ix_(kept, kept)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-12))
    inverse = np.linalg.pinv(H * scale[:, None] * scale, rcond=1e-12, hermitian=True) * scale[:, None] * scale
    at = np.searchsorted(kept, own)
    step = -inverse @ reduced.gradient[kept]
    biased = (inverse @ reduced.H[np.ix_(kept, considered)])[at].reshape(n, u, -1)
    return step[at], np.sqrt(np.maximum(np.diag(inverse)[at], 1e-18)), np.sqrt((biased**2).sum(axis=2))


def _instants(problem: PeopleProblem) -> NDArray[np.int64]:
    """(C,) people that each camera sees, each instant counted: as upright people or, where there are none, by their joints."""
    upright = np.bincount(problem.sightings.camera, minlength=problem.n_cameras)
    joints = np.bincount(problem.joints.camera, minlength=problem.n_cameras) // JOINTS_OF_A_BODY
    return np.asarray(np.maximum(upright, joints), dtype=np.int64)


def _by_size_drift(problem: PeopleProblem, state: AdjustmentState) -> dict[str, Floats]:
    """Whitened derivatives (M, k, 1) by people who seem to grow by `SIZE_DRIFT` for a distance that is larger by a factor e."""
    s, n = problem.sightings, problem.n_cameras
    away = np.log(np.maximum(np.linalg.norm(state.people[s.block, :2] - state.centre[s.camera, :2], axis=1), 0.1))
    mean = np.bincount(s.camera, away, n) / np.maximum(np.bincount(s.camera, minlength=n), 1)
    return {
        "centres": np.zeros((len(s), 2, 1)),
        "heights": (SIZE_DRIFT * (away - mean[s.camera]) / problem.height_sigma())[:, None, None],
        "joints": np.zeros((len(problem.joints.camera), 2, 1)),
    }


def size_drift(problem: PeopleProblem, state: AdjustmentState) -> Floats:
    """(C,) one sigma of a focal length's logarithm for what people's apparent size may drift over depth."""
    return np.asarray(SIZE_DRIFT / np.maximum(_depth_spread(problem, state), 0.05))


def _depth_spread(problem: PeopleProblem, state: AdjustmentState) -> Floats:
    """(C,) range of the distances at which a camera sees people (10 to 90 %), as a share of their median."""
    out = np.zeros(problem.n_cameras)
    for c in range(problem.n_cameras):
        people = state.people[problem.sightings.block[problem.sightings.camera == c], :2]
        joints = state.joints[problem.joints.point[problem.joints.camera == c], :2]
        distance = np.linalg.norm(np.concatenate([people, joints]) - state.centre[c, :2], axis=1)
        if len(distance):
            near, middle, far = np.quantile(distance, (0.1, 0.5, 0.9))
            out[c] = (far - near) / max(middle, 1e-6)
    return out
