"""Test whether a camera moved, zoomed or kept turning while it filmed, by comparison with a camera at rest.

All changes are paths of one camera (`camera_path`), fitted to its observations of people with positions by the other cameras.
They are compared by prediction of held-out blocks, one person during ten seconds, as all alternatives are. The times of a move
are found again without the held-out blocks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Pose, Rig
from passerby.core.measuring import MeasuringFigures, measure_change
from passerby.geometry.groups import find_runs
from passerby.geometry.rotations import angle_between, exp_rotation
from passerby.hypotheses.camera_path import (
    MOVES,
    STEPS_WITHOUT,
    TURN,
    TURNS,
    WITH_CLOCK,
    ZOOMS,
    CameraPath,
    Knots,
    Stretches,
    best_pairs,
    costs_along,
    fit_path,
    residuals_along,
    thinned,
)
from passerby.hypotheses.case import blocks_of
from passerby.hypotheses.comparison import FOLDS, LOG_ODDS, Comparison, effect, may_convince
from passerby.hypotheses.correspondences import Correspondences
from passerby.hypotheses.stretches import FOCALS, WINDOW_ROWS, find_stretches, fit_views, is_suspicious, refine_stretches

Kind = Literal["moved", "zoomed", "zoomed_and_moved", "drifts"]
PARTS: dict[Kind, tuple[int, ...]] = {
    "zoomed": ZOOMS, "moved": MOVES, "zoomed_and_moved": (*MOVES, *ZOOMS), "drifts": TURNS,
}  # fmt: skip
"""Columns of the change that are free."""
CHANGED_SITES: dict[Kind, float] = {"zoomed": 0.02, "moved": 0.05, "zoomed_and_moved": 0.005, "drifts": 0.02}
"""Share of recordings in which one of the cameras changes in this way."""
PIECES = 1, 2, 4, 8
"""Numbers of linear pieces of a drift that are tried."""
MOST_PAIRS = 4000
"""Largest number of pairs of an observation and a person that are compared; of more, observations at even steps are taken."""
ALIKE_FOCAL = 0.02
"""Two focal lengths count as equally far from the stated one if their distances, as logarithms, differ by less: a rig that a
zoom has deformed has errors of this size."""
MOST_PLACES = 200
"""Largest number of people's positions at which an effect is computed."""


@dataclass(frozen=True, eq=False)
class PoseChange:
    """A camera that had another pose, or another focal length, during one or more stretches of time."""

    spans: tuple[tuple[int, int], ...]
    """First and last instant of each stretch, in order."""
    at_start: bool
    """Whether the first stretch begins with the recording."""
    at_end: bool
    """Whether the last one ends with the recording."""
    main: Pose
    """Pose of the camera for the rest of the time."""
    other: Pose
    """Pose of the camera during the stretches."""
    gain: float
    """Gain in the prediction of people who were held out, nats."""
    sigmas: float
    """Mean gain of a block, in its standard errors."""
    shift: float
    """Shift of the people in the image, as a share of their extent (median)."""
    zoom: float = 1.0
    """Ratio of the focal length during the stretches to that of the rest."""

    @property
    def returns(self) -> bool:
        """Whether the camera came back to its main pose, once or several times."""
        return len(self.spans) > 1 or not (self.at_start or self.at_end)

    @property
    def metres(self) -> float:
        """Distance by which the camera centre moved, metres."""
        return float(np.linalg.norm(self.other.centre - self.main.centre))

    @property
    def degrees(self) -> float:
        """Angle by which the camera was turned."""
        return float(np.degrees(angle_between(self.other.R_cw, self.main.R_cw)))


@dataclass(frozen=True, eq=False)
class PoseDrift:
    """A camera that keeps turning: the rotation from its mean orientation, linear in time between knots."""

    knots: Floats
    """(K + 1,) instants of the knots."""
    turn: Floats
    """(K + 1, 3) rotation vectors at the knots, radians, in the camera frame: the camera's rotation is exp(turn) R_cw."""
    gain: float
    """Gain in the prediction of people who were held out, nats."""
    pixels: float
    """Shift of people in the image between the two knots that differ most (median)."""

    @property
    def degrees(self) -> float:
        """Largest rotation between two knots."""
        first, second = farthest(self.turn)
        R = exp_rotation(self.turn)
        return float(np.degrees(angle_between(R[first], R[second])))

    @property
    def steady(self) -> bool:
        """Whether it turns at a constant rate."""
        return len(self.knots) == 2

    def shift(self, lens: Lens, pixels: Floats, instants: Floats) -> Floats:
        """Return pixels (N, 2) of instants (N,) as they would be if the camera had kept its mean orientation.

        They are NaN where the lens model cannot be inverted.
        """
        turn = np.column_stack([np.interp(instants, self.knots, axis) for axis in self.turn.T])
        return lens.project_rays(np.einsum("nji,nj->ni", exp_rotation(turn), lens.bearings(pixels)))


@dataclass(frozen=True, eq=False)
class FoundChange:
    """A change that was fitted, and compared with a camera at rest."""

    kind: Kind
    path: CameraPath
    predicted: Floats
    """(B,) cost of each block when it was held out, nats."""
    over_base: Comparison
    log_prior: float

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds against a camera at rest."""
        return self.over_base.log_evidence + self.log_prior

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the change, including the times of its stretches."""
        times = self.path.times
        dates = times.switches if isinstance(times, Stretches) else 0
        return len(PARTS[self.kind]) * times.size + dates

    def explains_more(self, other: FoundChange) -> bool:
        """Check whether this change predicts significantly better than another one, priors included."""
        between = Comparison.of(self.predicted, other.predicted)
        return between.log_evidence + self.log_prior - other.log_prior > LOG_ODDS

    def effect(self, rig: Rig, camera: int, places: Floats, measuring: MeasuringFigures | None) -> float:
        """Compute how the rig's measurements differ between the two most different times, in their standard deviations.

        Args:
            rig: the rig with its poses.
            camera: index of the camera that changed.
            places: (N, 2) positions of people on the ground, metres.
            measuring: sigmas of the rig's measurements; None: the effect is infinite.
        """
        step = int(np.ceil(len(places) / MOST_PLACES))
        ends = [self.path.constant(one) for one in self._ends()]
        before, after = (_with_camera(rig, camera, end) for end in ends)
        moved = measure_change(before, after, places[::step])
        return np.inf if moved is None or measuring is None else effect(moved, measuring)

    def _ends(self) -> Floats:
        """Return the change (2, 7) at the two times between which it differs most."""
        times, c = self.path.times, self.path.coefficients
        if isinstance(times, Stretches):
            return np.vstack([np.zeros_like(c[0]), c[0]])
        at = self.path.changed(times.instant)
        return np.asarray(at[list(farthest(at[:, TURN]))])


def suspect_change(m: Correspondences, pose: Pose, per_second: float, n_cameras: int) -> SuspectedChange | None:
    """Find possible changes of a camera while it filmed, not yet compared; None without a sign of a change.

    Args:
        m: the camera's observations with the people of their instants.
        pose: pose of the camera for the whole recording, estimated without changes.
        per_second: instants a second.
        n_cameras: number of cameras of the rig; the prior odds of a change of the whole rig are divided among them.
    """
    if len(m) < 2 * WINDOW_ROWS:
        return None
    few = thinned(m, MOST_PAIRS)
    base = fit_path(few, CameraPath(pose, origin=float(few.own.step.mean())), own=WITH_CLOCK)
    trial = _Trial(few, base, blocks_of(few.own.step, few.own.identity, per_second)[0], n_cameras)
    if not is_suspicious(few, base, trial.block, max(map(trial.log_prior, CHANGED_SITES))):
        return None
    # All parts are free, and pieces are most numerous: if these are not significant, no simpler change is.
    steps = tuple(path for path in find_stretches(few, base) if trial.may_convince("moved", path))
    finest = next((path for pieces in reversed(PIECES) if (path := fit_drift(few, base, pieces)) is not None), None)
    drift = finest if finest is not None and trial.may_convince("drifts", finest) else None
    if not steps and drift is None:
        return None
    before = float(costs_along(few, base).sum())
    gain = max(before - float(costs_along(few, path).sum()) for path in (*steps, *([drift] if drift else [])))
    return SuspectedChange(trial, steps, drift, gain)


@dataclass(frozen=True, eq=False)
class SuspectedChange:
    """Possible changes of a camera while it filmed."""

    trial: _Trial
    steps: tuple[CameraPath, ...]
    drift: CameraPath | None
    """Drift with the largest number of pieces; None if it is not significant."""
    gain: float
    """Gain in the fit of the best change, nats; the gain of held-out people is smaller."""

    def compared(self) -> FoundChange | None:
        """Find the change that predicts people best; None if none is ten times as probable as a camera at rest."""
        kinds: tuple[Kind, ...] = ("zoomed", "moved", "zoomed_and_moved")
        steps = [found for path in self.steps for kind in kinds if (found := self.trial.step(kind, path)) is not None]
        drifts = [found for path in self._drifts() if (found := self.trial.drift(path)) is not None]
        likely = [one for family in (steps, drifts) if (one := _simplest(family)) is not None]
        return max(likely, key=lambda one: one.over_base.gain + one.log_prior, default=None)

    def _drifts(self) -> list[CameraPath]:
        """Return the drifts with all numbers of pieces."""
        if self.drift is None:
            return []
        fewer = (pieces for pieces in PIECES if pieces < self.drift.times.size)
        coarse = (fit_drift(self.trial.m, self.trial.base, pieces) for pieces in fewer)
        return [*(path for path in coarse if path is not None), self.drift]


@dataclass(frozen=True, eq=False)
class _Trial:
    """One camera's observations in blocks, and the path of the camera at rest."""

    m: Correspondences
    base: CameraPath
    block: Ints
    n_cameras: int

    def step(self, kind: Kind, path: CameraPath) -> FoundChange | None:
        """Fit a change in a stretch of time, near an initial path, and compare it; None if it is not significant."""
        parts = PARTS[kind]
        change = np.zeros_like(path.coefficients)
        change[:, parts] = path.coefficients[:, parts]
        first = replace(path, change=change)
        if kind == "zoomed":
            first = replace(first, pose=self.base.pose)
        full = refine_stretches(self.m, first, parts)
        if full is None or not self.may_convince(kind, full):
            return None
        return self._compared(kind, full, [refine_stretches(self.m, full, parts, held=held) for held in self._folds()])

    def elsewhere(self, kind: Kind, start: CameraPath) -> FoundChange:
        """Fit and compare a camera that differs from the base all of the time, near an initial path; the base is fixed."""
        parts = PARTS[kind]
        full = fit_path(self.m, start, own=parts, widening=4.0)
        return self._compared(kind, full, self._without_folds(full, own=parts), base_held=True)

    def drift(self, path: CameraPath) -> FoundChange | None:
        """Compare a drift with the camera at rest; None if it is not significant."""
        if not self.may_convince("drifts", path):
            return None
        return self._compared("drifts", path, self._without_folds(path, TURNS))

    def _folds(self) -> list[np.ndarray]:
        """Return masks (M,) of the held-out observations, one for each fold."""
        return [self.block % FOLDS == fold for fold in range(FOLDS) if (self.block % FOLDS == fold).any()]

    @cached_property
    def _still(self) -> list[CameraPath]:
        """The paths of the camera at rest, fitted without each fold."""
        return self._without_folds(self.base)

    def _without_folds(
        self, path: CameraPath, parts: tuple[int, ...] = (), own: tuple[int, ...] = WITH_CLOCK
    ) -> list[CameraPath]:  # fmt: skip
        """Fit a path, which was fitted to all observations, again without each fold."""
        return [fit_path(self.m.part(~held), path, parts, own=own, steps=STEPS_WITHOUT) for held in self._folds()]

    def _costs(self, path: CameraPath) -> Floats:
        """Return the cost (B,) of each block by a path that was fitted to all of them."""
        return np.asarray(np.bincount(self.block, costs_along(self.m, path)), dtype=np.float64)

    def may_convince(self, kind: Kind, full: CameraPath) -> bool:
        """Check whether a change is significant on the observations that it was fitted to; only then folds are predicted."""
        return may_convince(self._costs(full), self._costs(self.base), self.log_prior(kind))

    def log_prior(self, kind: Kind) -> float:
        """Return the logarithm of the prior odds of a change of this camera."""
        return float(np.log(CHANGED_SITES[kind] / self.n_cameras))

    def _compared(
        self, kind: Kind, full: CameraPath, folds: Sequence[CameraPath | None], *, base_held: bool = False
    ) -> FoundChange:
        """Predict each fold by a path that was fitted to the others, or by the base if that path is None."""
        n = int(self.block.max()) + 1
        predicted, before = np.zeros(n), np.zeros(n)
        still_paths = [self.base] * len(folds) if base_held else self._still
        for held, path, still in zip(self._folds(), folds, still_paths, strict=True):
            part, block = self.m.part(held), self.block[held]
            before += np.bincount(block, costs_along(part, still), n)
            predicted += np.bincount(block, costs_along(part, still if path is None else path), n)
        return FoundChange(kind, full, predicted, Comparison.of(predicted, before), self.log_prior(kind))


def _simplest(family: Sequence[FoundChange]) -> FoundChange | None:
    """Return the simplest significant change that no other change explains more than; None without any."""
    counted = [one for one in family if one.log_odds > LOG_ODDS]
    ordered = sorted(counted, key=lambda one: one.unknowns)
    for number, one in enumerate(ordered):
        if not any(other.explains_more(one) for other in ordered[number + 1 :]):
            return one
    return None


def step_of(m: Correspondences, found: FoundChange, *, stated: bool) -> PoseChange:
    """Return a change in stretches of time for reports.

    Args:
        m: the camera's observations with the people of their instants.
        found: the change, not a drift.
        stated: whether the lens was calibrated: then the stretch is the time for which it does not hold, of any length.
    """
    path, zooms, t = found.path, found.kind != "moved", m.own.step
    if not zooms:  # the size of the motion with the lens and the clock as they are
        path = fit_path(m, replace(path, log_focal=0.0, late=(0.0, 0.0)), MOVES, own=MOVES)
    inside = path.times.at(t)[:, 0] > 0
    longer = inside.sum() > (~inside).sum()
    if zooms and stated:
        rest, stretch = abs(path.log_focal), abs(path.log_focal + float(path.coefficients[0, 6]))
        if abs(rest - stretch) > ALIKE_FOCAL:
            longer = stretch < rest
    if np.count_nonzero(np.diff(inside)) != 2 and longer:  # else the camera has its pose before and after the stretch
        path, inside = path.exchanged(), ~inside
    main, there = path.constant(np.zeros_like(path.coefficients[0])), path.constant(path.coefficients[0])
    a, b = (residuals_along(m, one).found for one in (main, there))
    pairs = best_pairs(m, residuals_along(m, replace(path, times=Stretches.of(t, inside))).found.square)
    apart = np.linalg.norm(a.residual[:, pairs] - b.residual[:, pairs], axis=0)
    spans = tuple((int(t[first]), int(t[last])) for first, last in find_runs(inside))
    return PoseChange(
        spans, bool(inside[0]), bool(inside[-1]), main.pose, there.pose, found.over_base.gain,
        found.over_base.z, float(np.median(apart / m.own.extent_px)),
        float(np.exp(there.log_focal - main.log_focal)) if zooms else 1.0,
    )  # fmt: skip


def measure_step(part: Correspondences, pose: Pose, change: PoseChange, per_second: float, n_cameras: int) -> PoseChange:
    """Measure a change again by a rig without it; with fewer than `WINDOW_ROWS` observations it is not changed.

    Args:
        part: the camera's observations during the stretch.
        pose: pose of the camera for the rest of the time.
        change: the change as measured by a rig that it deformed.
        per_second: instants a second.
        n_cameras: number of cameras of the rig.
    """
    if len(part) < WINDOW_ROWS:
        return change
    # The world frames of the old and the new rig differ: the change is applied relative to the camera's pose.
    main, other = change.main, change.other
    turned = other.R_cw @ main.R_cw.T @ pose.R_cw
    moved = Pose.from_centre(turned, pose.centre + pose.R_cw.T @ main.R_cw @ (other.centre - main.centre))
    held, few = CameraPath(pose), thinned(part, MOST_PAIRS)
    zooms = [CameraPath(pose, float(focal)) for focal in (np.log(change.zoom), *FOCALS)]
    moves = [CameraPath(moved, float(np.log(change.zoom))), *(replace(one, late=(0.0, 0.0)) for one in fit_views(few, [held]))]

    def best_of(paths: Iterable[CameraPath]) -> CameraPath:
        return min(paths, key=lambda one: costs_along(few, one).sum())

    starts: dict[Kind, CameraPath] = {
        "zoomed": best_of(zooms), "moved": best_of(replace(one, log_focal=0.0) for one in moves),
        "zoomed_and_moved": best_of(moves),
    }  # fmt: skip
    trial = _Trial(few, held, blocks_of(few.own.step, few.own.identity, per_second)[0], n_cameras)
    tried = {kind: trial.elsewhere(kind, start) for kind, start in starts.items()}
    found = _simplest(list(tried.values())) or tried["moved" if change.zoom == 1.0 else "zoomed_and_moved"]
    return replace(change, main=pose, other=found.path.pose, zoom=float(np.exp(found.path.log_focal)))


def fit_drift(m: Correspondences, base: CameraPath, pieces: int) -> CameraPath | None:
    """Fit a drift of linear pieces of equal length; None for fewer than `2 * WINDOW_ROWS` observations a piece."""
    if len(m) < 2 * WINDOW_ROWS * pieces or m.own.step[0] == m.own.step[-1]:
        return None
    start = replace(base, origin=float(m.own.step.mean()), times=Knots.even(m.own.step, pieces), change=None)
    return fit_path(m, start, TURNS, own=WITH_CLOCK, widening=16.0)


def drift_of(m: Correspondences, path: CameraPath, gain: float) -> PoseDrift:
    """Return a drift for reports."""
    assert isinstance(path.times, Knots)
    turn = path.changed(path.times.instant)[:, TURN]
    first, second = farthest(turn)
    # A rotation by `turn` moves a ray by their cross product.
    moved = np.einsum("nij,nj->ni", m.own.middle_tangent, np.cross(turn[first] - turn[second], m.own.middle))
    return PoseDrift(path.times.instant, turn, gain, float(np.median(np.linalg.norm(moved, axis=1))))


def farthest(turn: Floats) -> tuple[int, int]:
    """Return the indices of the two rotation vectors (K, 3) that differ most."""
    apart = np.linalg.norm(turn[:, None] - turn[None], axis=2)
    first, second = np.unravel_index(int(apart.argmax()), apart.shape)
    return int(first), int(second)


def _with_camera(rig: Rig, camera: int, at: CameraPath) -> Rig:
    """Return a rig with another pose and focal length of one camera."""
    lens = rig.cameras[camera].lens
    matrix = lens.matrix.copy()
    matrix[:2, :2] *= np.exp(at.log_focal)
    changed = replace(rig.cameras[camera], pose=at.pose, lens=replace(lens, matrix=matrix))
    return replace(rig, cameras=tuple(changed if c == camera else one for c, one in enumerate(rig)))
