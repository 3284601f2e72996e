"""Simulated conditions: a scene, what is done to its boxes, how it is solved, and how far the result lies from the truth.

A condition is a value and its outcome a pure function of it. All conditions of one filmed scene are one job of the executor, so
that people are filmed once for all faults of the detector.
"""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import tomli_w

from pages.kept import Kept
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.common.arrays import Ints
from passerby.common.errors import InputError
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.evaluation.metrics import Comparison, compare
from passerby.scene.scene import Scene
from passerby.simulation import SimulatedScene, SimulationOptions, simulate, write_scene
from passerby.simulation.scene import Filmed, film, remove_faults
from passerby.solver.geopose.correspondences import whole_boxes

LONGEST_STEP = 3
"""Pictures at uneven times are 1 to so many frames of the video's clock apart, at random: 17 to 50 a second of 50."""


def sampled(simulated: SimulatedScene, every: int, *, uneven: bool, rng: np.random.Generator) -> SimulatedScene:
    """The scene with what is seen in every `every`-th picture of each camera, from the first on; clocks are known.

    Args:
        simulated: a scene in which everybody is seen in every frame.
        every: 1 keeps all pictures.
        uneven: whether the pictures come at uneven times, other ones in each camera; else every frame is a picture.
        rng: draws those times.
    """
    cameras, true = {}, {}
    for name, seen in simulated.observations.cameras.items():
        frames = simulated.frames
        if uneven:
            frames = np.cumsum(rng.integers(1, LONGEST_STEP + 1, len(frames)))
        kept = [np.isin(part.frame, frames[::every]) for part in (seen.boxes, seen.keypoints)]
        cameras[name] = CameraObservations(seen.boxes.take(kept[0]), seen.keypoints.take(kept[1]))
        true[name] = simulated.true_identities[name][kept[0]]
    return replace(simulated, observations=replace(simulated.observations, cameras=cameras), true_identities=true)


def thinned(simulated: SimulatedScene, shared: int, rng: np.random.Generator) -> SimulatedScene:
    """The scene with so few boxes that every camera shares `shared` person-instants with the first one, the reference.

    A person-instant is one person at one instant; it is shared where both cameras have a box of the person that lies wholly
    inside the picture. All that the reference sees are put in one random order. Every other camera keeps the first `shared` of
    those that it sees too, and no other box; the reference keeps those that any camera has kept. So two cameras other than the
    reference share at most `shared` too: those among them that both see.

    Raises `InputError`: a camera shares fewer with the reference.
    """
    whole = {camera.name: simulated.observations[camera.name].boxes for camera in simulated.rig}
    whole = {name: boxes.take(whole_boxes(boxes, simulated.rig[name].lens)) for name, boxes in whole.items()}
    n_people = 1 + max(int(boxes.identity.max(initial=0)) for boxes in whole.values())
    reference, *others = simulated.rig.names
    order = rng.permutation(_numbers(whole[reference], n_people))
    kept: dict[str, Ints] = {}
    for name in others:
        common = order[np.isin(order, _numbers(whole[name], n_people))]
        if len(common) < shared:
            raise InputError(
                f"camera {name} shares {len(common)} person-instants with camera {reference}, {shared} are wanted: "
                "simulate more seconds or more people"
            )
        kept[name] = common[:shared]
    kept[reference] = np.unique(np.concatenate(list(kept.values())))
    return _taken(simulated, kept, n_people)


def _taken(simulated: SimulatedScene, kept: Mapping[str, Ints], n_people: int) -> SimulatedScene:
    """The scene with the kept person-instants alone, of whole boxes, and the joints that go with them."""
    cameras, true = {}, {}
    for name, seen in simulated.observations.cameras.items():
        inside = whole_boxes(seen.boxes, simulated.rig[name].lens) & np.isin(_numbers(seen.boxes, n_people), kept[name])
        joints = np.isin(_numbers(seen.keypoints, n_people), kept[name])
        cameras[name] = CameraObservations(seen.boxes.take(inside), seen.keypoints.take(joints))
        true[name] = simulated.true_identities[name][inside]
    return replace(simulated, observations=replace(simulated.observations, cameras=cameras), true_identities=true)


def _numbers(people: Boxes | Keypoints, n_people: int) -> Ints:
    """(N,) a number for each person-instant."""
    return np.asarray(people.frame * n_people + people.identity)


FAILED = float("inf")  # stands for an error that is undefined, so that no mean and no median hides a failure
THINNING, UNEVEN = 7, 8  # tell the generators of the thinning and of uneven times from those of the scene with the same seed

Method = Literal["people", "geopose"]

SomeOutcome = TypeVar("SomeOutcome", bound="Outcome")


@dataclass(frozen=True)
class Condition:
    """One simulated scene and how it is solved."""

    options: SimulationOptions
    method: Method = "people"
    points: Literal["boxes", "joints"] = "boxes"  # what the solver gets to see
    shared: int | None = None
    """Person-instants that each camera shares with the reference, the first camera: see `thinned`. None: all that there are."""
    search_s: float = 0.0  # largest difference of two clocks that is searched for
    solver: tuple[tuple[str, float], ...] = ()  # options of the solver, by name
    every: int = 1  # a detector looks at every so many-th picture,
    uneven: bool = False  # and pictures come at uneven times: see `sampled`

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
    reason: str  # the first that speaks against the result; empty where none does
    registered: int
    cameras: int
    similarity_mm: float = FAILED
    similarity_deg: float = FAILED
    metric_mm: float = FAILED
    metric_deg: float = FAILED
    scale_error: float = FAILED  # |estimated length / true length - 1|
    gravity_deg: float = FAILED  # of the vertical
    ground_mm: float = FAILED  # of the height of the ground
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

    Raises `InputError`: the condition asks for something that does not exist.
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
        with_pose_errors(outcome, against), gravity_deg=_defined(against.gravity_error_deg),
        ground_mm=_defined(against.ground_error_mm), clock_ms=_clock_error_ms(calibration, simulated),
    )  # fmt: skip


def with_pose_errors(outcome: SomeOutcome, against: Comparison) -> SomeOutcome:
    """The outcome with the errors that all kinds of them have; `FAILED` where one is undefined."""
    return replace(
        outcome, similarity_mm=_defined(against.similarity.mean_position_mm),
        similarity_deg=_defined(against.similarity.mean_orientation_deg), metric_mm=_defined(against.metric.mean_position_mm),
        metric_deg=_defined(against.metric.mean_orientation_deg),
        scale_error=_defined(None if against.scale_ratio is None else abs(against.scale_ratio - 1)),
    )  # fmt: skip


def _defined(value: float | None) -> float:
    return FAILED if value is None else value


def _clock_error_ms(calibration: Calibration, simulated: SimulatedScene) -> float:
    """Mean error of the offsets to the first camera's clock, milliseconds; clocks that were not searched for agree."""
    clocks = calibration.association.clocks if calibration.association else {}
    found = {name: clocks[name].offset_s if name in clocks else 0.0 for name in simulated.rig.names}
    true, first = simulated.clock_offsets, simulated.rig.names[0]
    wrong = [(found[name] - found[first]) - (true[name] - true[first]) for name in simulated.rig.names[1:]]
    return float(1000 * np.mean(np.abs(wrong)))
