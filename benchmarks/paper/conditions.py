"""Simulated conditions: a scene, what is done to its boxes, how it is solved, and how far the result lies from the truth.

A condition is a value and its outcome a pure function of it. All conditions of one filmed scene are one job of the executor, so
that people are filmed once for all faults of the detector.
"""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import tomli_w

from pages.kept import Kept
from paper.sampling import sampled
from paper.thinning import thinned
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.evaluation.metrics import Comparison, compare
from passerby.scene.scene import Scene
from passerby.simulation import SimulatedScene, SimulationOptions, simulate, write_scene
from passerby.simulation.scene import Filmed, film, remove_faults

FAILED = float("inf")
"""Stands for an error that is undefined, so that no mean and no median hides a failure."""
THINNING, UNEVEN = 7, 8
"""Tell the generators of the thinning and of uneven times from those of the scene with the same seed."""

Method = Literal["people", "geopose"]

SomeOutcome = TypeVar("SomeOutcome", bound="Outcome")


@dataclass(frozen=True)
class Condition:
    """One simulated scene and how it is solved."""

    options: SimulationOptions
    method: Method = "people"
    points: Literal["boxes", "joints"] = "boxes"
    """What the solver gets to see."""
    shared: int | None = None
    """Person-instants that each camera shares with the reference, the first camera: see `thinned`. None: all that there are."""
    search_s: float = 0.0
    """Largest difference of two clocks that is searched for."""
    solver: tuple[tuple[str, float], ...] = ()
    """Options of the solver, by name."""
    every: int = 1
    """A detector looks at every so many-th picture,"""
    uneven: bool = False
    """and pictures come at uneven times: see `sampled`."""

    @property
    def scene(self) -> dict[str, Any]:
        """What the scene file says of association and solver."""
        mode = "combined" if self.options.unrelated_ids else "given"
        return {
            "association": {"mode": mode, "max_offset_s": self.search_s},
            "solver": {"method": self.method, "reference": "C1", "options": dict(self.solver)},
        }


@dataclass(frozen=True)
class Outcome:
    """What became of a condition. All errors are infinite where not every camera was registered."""

    verdict: str
    reason: str
    """The first that speaks against the result; empty where none does."""
    registered: int
    cameras: int
    similarity_mm: float = FAILED
    similarity_deg: float = FAILED
    metric_mm: float = FAILED
    metric_deg: float = FAILED
    scale_error: float = FAILED
    """|estimated length / true length - 1|."""
    gravity_deg: float = FAILED
    """Of the vertical."""
    ground_mm: float = FAILED
    """Of the height of the ground."""
    clock_ms: float = FAILED
    """Mean error over the other cameras of the clocks' offsets to the first camera's; 0 where all agree and are known to."""

    @property
    def failed(self) -> bool:
        """Whether the calibration was refused or a camera has no pose."""
        return self.registered < self.cameras


def run_conditions(
    conditions: Sequence[Condition], executor: Executor | None, tell: Progress, stage: str, kept: Path | None = None
) -> dict[Condition, Outcome]:
    """The outcomes of all conditions, each worked out once.

    Args:
        conditions: in any order.
        executor: works on filmed scenes side by side; None: one after the other. The outcomes do not depend on it.
        tell: told how many scenes are done.
        stage: what it is told to be.
        kept: folder of outcomes of an earlier run that was stopped; None: nothing is kept.

    Raises:
        InputError: a condition asks for something that does not exist.
    """
    jobs: dict[SimulationOptions, list[Condition]] = {}
    for condition in dict.fromkeys(conditions):
        jobs.setdefault(remove_faults(condition.options), []).append(condition)
    # The longest first, so that no process works on alone in the end.
    ordered = sorted(jobs.values(), key=_effort, reverse=True)
    found = side_by_side(_run_job, [_Job(tuple(alike), kept) for alike in ordered], executor, tell, stage)
    return {condition: outcome for outcomes in found for condition, outcome in outcomes.items()}


def _effort(conditions: Sequence[Condition]) -> float:
    """About how much work it is: views are most of the filming, and all boxes go into a solution."""
    options = conditions[0].options
    return options.n_cameras * options.n_people * options.n_frames * (1 + len(conditions))


@dataclass(frozen=True)
class _Job:
    """Conditions that are filmed alike."""

    conditions: tuple[Condition, ...]
    kept: Path | None


def _run_job(job: _Job) -> dict[Condition, Outcome]:
    """The outcomes of conditions that are filmed alike; what was kept is not worked out again."""
    kept = Kept(job.kept)
    outcomes = {}
    filmed: Filmed | None = None
    for condition in job.conditions:
        known = kept.get(repr(condition))
        if known is not None:
            outcomes[condition] = Outcome(**known)
            continue
        filmed = filmed or film(condition.options)
        outcomes[condition] = outcome_of(condition, filmed)
        kept.put(repr(condition), asdict(outcomes[condition]))
    return outcomes


def outcome_of(condition: Condition, filmed: Filmed | None = None) -> Outcome:
    """Simulate, write the scene, calibrate it as `passerby calibrate` does, and compare.

    Args:
        condition: what to do.
        filmed: the scene's views, where they are at hand.

    Raises:
        InputError: the condition asks for something that does not exist.
    """
    simulated = simulate(condition.options, filmed)
    if condition.shared is not None:
        # A generator of its own: the scene is the same for every number that is shared, and a smaller number is a part of a
        # larger one.
        simulated = thinned(simulated, condition.shared, np.random.default_rng((condition.options.seed, THINNING)))
    if condition.every > 1 or condition.uneven:
        rng = np.random.default_rng((condition.options.seed, UNEVEN))
        simulated = sampled(simulated, condition.every, uneven=condition.uneven, rng=rng)
    with tempfile.TemporaryDirectory(prefix="passerby-condition-") as folder:
        calibration = calibrate(_scene(condition, simulated, Path(folder) / "scene"))
    return _judged(calibration, simulated)


def _scene(condition: Condition, simulated: SimulatedScene, folder: Path) -> Scene:
    """The scene as files, as a user would hand it in."""
    joints = condition.points == "joints"
    path = write_scene(simulated, folder, keypoints=joints)
    content = tomllib.loads(path.read_text())
    if joints:
        for table in content["cameras"].values():
            del table["tracks"]
    path.write_text(tomli_w.dumps(content | condition.scene))
    return Scene.load(path)


def _judged(calibration: Calibration, simulated: SimulatedScene) -> Outcome:
    """The figures of a calibration against the truth."""
    registered = sum(camera.pose is not None for camera in calibration.rig)
    outcome = Outcome(calibration.verdict, next(iter(calibration.reasons), ""), registered, len(simulated.rig))
    if outcome.failed:
        return outcome
    against = compare(calibration.rig, simulated.rig)
    return replace(
        with_pose_errors(outcome, against),
        gravity_deg=_defined(against.gravity_error_deg),
        ground_mm=_defined(against.ground_error_mm),
        clock_ms=_clock_error_ms(calibration, simulated),
    )


def with_pose_errors(outcome: SomeOutcome, against: Comparison) -> SomeOutcome:
    """The outcome with the errors that all kinds of them have; `FAILED` where one is undefined."""
    return replace(
        outcome,
        similarity_mm=_defined(against.similarity.mean_position_mm),
        similarity_deg=_defined(against.similarity.mean_orientation_deg),
        metric_mm=_defined(against.metric.mean_position_mm),
        metric_deg=_defined(against.metric.mean_orientation_deg),
        scale_error=_defined(None if against.scale_ratio is None else abs(against.scale_ratio - 1)),
    )


def _defined(value: float | None) -> float:
    return FAILED if value is None else value


def _clock_error_ms(calibration: Calibration, simulated: SimulatedScene) -> float:
    """Mean error of the offsets to the first camera's clock, milliseconds; clocks that were not searched for agree."""
    clocks = calibration.association.clocks if calibration.association else {}
    found = {name: clocks[name].offset_s if name in clocks else 0.0 for name in simulated.rig.names}
    true, first = simulated.clock_offsets, simulated.rig.names[0]
    wrong = [(found[name] - found[first]) - (true[name] - true[first]) for name in simulated.rig.names[1:]]
    return float(1000 * np.mean(np.abs(wrong)))
