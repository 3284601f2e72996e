"""An inner solve that is refused, in whatever round, ends in a refusal that is written like any other result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import passerby.calibration.camera_motion as camera_motion
import passerby.calibration.scene_solver as scene_solver
import passerby.solver.initialisation as stages
import passerby.solver.people as people
from passerby.association.clocks.drift import Drift
from passerby.association.result import Association
from passerby.calibration.camera_motion import DetectedMotion, MotionRepair
from passerby.calibration.clock_skew import MOST_CORRECTIONS, clock_rate_figures, find_clock_skew
from passerby.calibration.estimation import Estimate
from passerby.calibration.in_memory import calibrate_observations
from passerby.calibration.repairs import Repair, apply_repairs
from passerby.core.cameras import Lens, Pose, Rig
from passerby.core.figures import AdjustedFigures, ClockCorrection
from passerby.core.observations import Clock
from passerby.core.solution import Solution
from passerby.findings.finding import refusal
from passerby.findings.ranking import RefusalError
from passerby.hypotheses.changes import PoseChange
from passerby.scene.inputs import SceneInputs
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, solve, without_poses

pytestmark = pytest.mark.system

FORCED = refusal("too_little_evidence", why="forced")


def refused(rig: Rig) -> Solution:
    return Solution("people", without_poses(rig), "refused", (FORCED,))


@cache
def scene(given: bool) -> SimulatedScene:
    return simulate(
        SimulationOptions(
            preset="terrace", seed=3, cameras=3, people=6, seconds=10.0, box_noise=0.02, joint_noise_px=1.0,
            unrelated_ids=not given, embeddings="distinct",
        )
    )  # fmt: skip


class Solver:
    """The true rig in place of a solve, with clocks where these are asked for; a refusal in one round."""

    def __init__(self, truth: Rig, refuse_at: int) -> None:
        self.truth, self.refuse_at, self.calls = truth, refuse_at, 0

    def __call__(self, scene: Any, rig: Rig, instants: Any, options: Any, *rest: Any) -> Solution:
        self.calls += 1
        if self.calls == self.refuse_at + 1:
            return refused(rig)
        timed = getattr(options, "refine_time", False)
        clocks = {
            name: ClockCorrection(correction_s=0.0, sigma_s=0.01 if name != rig.names[0] else 0.0)
            for name in (rig.names if timed else ())
        }
        figures = AdjustedFigures(clocks=clocks)
        return Solution("people", replace(self.truth, verdict="accepted"), "accepted", figures=figures)


MODES: list[dict[str, Any]] = [
    {"mode": "trajectory", "max_offset_s": 0.0},
    {"mode": "combined", "max_offset_s": 1.0},
    {"mode": "appearance", "max_offset_s": 0.0},
    {"mode": "given", "max_offset_s": 0.0},
    {"mode": "given", "max_offset_s": 1.0},
]
SOLVERS: dict[str, dict[str, Any]] = {
    "plain": {},
    "lens": {"refine": ["focal", "principal_point"]},
    "clock_rate": {"refine": ["clock_rate"]},
    "geopose": {"method": "geopose", "reference": "C1"},
}
QUICK = MODES[0], MODES[3]
"""In which the other solvers are tried too: the rounds are the mode's, not the solver's."""


@pytest.mark.parametrize(
    ("association", "table"),
    [(mode, SOLVERS[name]) for mode in MODES for name in (SOLVERS if mode in QUICK else ("clock_rate",))],
    ids=lambda table: "-".join(str(value) for value in table.values()) or "plain",
)
def test_a_refused_solve_in_any_round_is_a_refusal(
    association: dict[str, Any], table: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = scene(association["mode"] == "given")
    boxes = {name: seen.boxes for name, seen in simulated.observations.cameras.items()}
    rounds = 0
    while True:
        solver = Solver(simulated.rig, rounds)
        monkeypatch.setattr(scene_solver, "solve_scene", solver)
        found = calibrate_observations(
            simulated.rig, boxes, fps=5.0, association=association, solver=table, world={"camera": "C1", "towards": "C2"}
        )
        if solver.calls <= rounds:
            break  # that round did not come
        if solver.calls == rounds + 1:  # later solves, of a moved camera or of another frame rate, may hold
            assert found.verdict == "refused"
            assert FORCED in found.diagnostics
            assert not len(found.rig.posed())
            found.write(tmp_path / f"round{rounds}")
            assert (tmp_path / f"round{rounds}" / "calibration.json").is_file()
        rounds += 1
    # First guesses, the rounds between and the last solve were refused in turn.
    assert rounds >= (1 if association == MODES[3] else 2)


def inputs() -> SceneInputs:
    seen = scene(True)
    clocks = {name: Clock(5.0) for name in seen.rig.names}
    return SceneInputs(without_poses(seen.rig), replace(seen.observations, clocks=clocks), ())


def in_turn(first: Estimate, refusals: Callable[[], Association]) -> Callable[[SceneInputs], Estimate]:
    answers: Iterator[Estimate] = iter([first])

    def estimate(given: SceneInputs) -> Estimate:
        return next(answers, None) or Estimate(refused(given.rig), refusals())

    return estimate


@pytest.mark.unit
def test_a_solve_that_is_refused_after_a_clock_was_corrected() -> None:
    whole = inputs()
    seen = whole.observations
    drifts = {name: Drift(rate, 1e-5, 8.0) for name, rate in zip(whole.rig.names, (0.0, 0.02, 0.0), strict=True)}
    first = Estimate(Solution("people", scene(True).rig, "accepted"), Association(seen, seen, seen.clocks, drifts=drifts))
    estimates = in_turn(first, lambda: Association(seen, seen, seen.clocks))
    repaired = apply_repairs(whole, estimates, [Repair(find_clock_skew, MOST_CORRECTIONS)])
    assert repaired.estimate.solution.verdict == "refused"
    assert len(repaired.corrections) == 1
    assert clock_rate_figures(whole, repaired.inputs, repaired.estimate) == {}


@pytest.mark.unit
@pytest.mark.parametrize("given", [False, True])
def test_a_solve_that_is_refused_after_a_move_was_left_out(given: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = inputs()
    seen, pose = whole.observations, scene(True).rig["C2"].pose
    assert pose is not None
    other = Pose.from_centre(pose.R_cw, pose.centre + 1.0)
    change = PoseChange(20, 40, False, True, pose, other, 99.0, 99.0, 0.5)
    real, found = camera_motion._most_certain, iter([DetectedMotion("C2", 20, 40, 5.0, change)])
    monkeypatch.setattr(camera_motion, "_most_certain", lambda *args: next(found, None) or real(*args))
    first = Estimate(Solution("people", scene(True).rig, "accepted"), Association(seen, seen, seen.clocks))
    motion = MotionRepair(whole, given, 1.72)
    estimates = in_turn(first, lambda: Association(seen, seen, seen.clocks))
    repaired = apply_repairs(whole, estimates, [Repair(motion, len(whole.rig))])
    assert repaired.estimate.solution.verdict == "refused"
    assert [one.camera for one in motion.measured_again(repaired.corrections, repaired.estimate)] == ["C2"]


@pytest.mark.slow
@pytest.mark.unit
def test_lenses_from_which_no_first_guess_can_be_made_anew_leave_a_doubtful_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lenses without intrinsics are too far from the first guess, and with them no arrangement of the cameras agrees."""
    truth = simulated("basketball")
    stated = Rig(tuple(replace(camera, lens=Lens.unknown(camera.lens.size), pose=None) for camera in truth.rig))
    calls: list[Any] = []
    select = stages.select_initial_rig

    def only_once(*args: Any) -> Any:
        calls.append(args)
        if len(calls) > 1:
            raise RefusalError(FORCED)
        return select(*args)

    monkeypatch.setattr(people, "select_initial_rig", only_once)
    monkeypatch.setattr(stages.Initialisation, "near", lambda start, other: False)
    options = PeopleOptions(max_sightings=2000, coarse_people=200, refine_lens=LENS_PARTS)
    solution = solve(stated, part(truth.observations), options=options)
    assert len(calls) == 2
    assert solution.verdict == "doubtful"
    assert "reinitialisation_failed" in [doubt.code for doubt in solution.findings]
    assert len(solution.rig.posed()) == len(truth.rig)
